"""Wall time per case of `estimate_many` on a GPU and on the CPU of the same machine, by number of
cases: `python -m benchmarks.many_cases --gpu [--json]`.

Two problems: the spring of `many_cases`, and the aircraft of `reference_problem` with 30 free
coefficients; each case is a record with independent noise. Up to three processes measure at the
same time, each on processors of its own: JAX's default device, one core of the CPU, and as many
cores as are left, one device of JAX on each. A number of cases for which no time is left is not
measured. The first call compiles; the shortest of the later ones counts.

The result is written to a file whenever there is a new figure. The programs are compared by their
estimates, in standard errors.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.many_cases_rows import PROBLEMS

ROOT = Path(__file__).resolve().parents[1]
CASES = (1, 10, 100, 1000, 10_000, 30_000)
GRACE = 20.0  # after its time is up, a process is given as long to end [s]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print one table, or with `--json` one object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, nargs="+", default=list(CASES))
    parser.add_argument("--cpu-cases", type=int, default=1000, help="largest number on the CPU")
    parser.add_argument("--problems", nargs="+", choices=PROBLEMS, default=list(PROBLEMS))
    parser.add_argument("--samples", type=int, default=751, help="of the reference problem")
    parser.add_argument("--seconds", type=float, default=320.0, help="time of all processes")
    parser.add_argument("--no-cpu-devices", action="store_true", help="one core of the CPU only")
    parser.add_argument("--output", type=Path, help="file of the result, by default temporary")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        result = measure(options, Path(folder))
    print(json.dumps(result) if options.json else table(result))


def measure(options: argparse.Namespace, folder: Path) -> dict:
    """Return all figures that the processes reach in their time."""
    sharing = processor_shares(not options.no_cpu_devices)
    begin = time.monotonic()
    running = {name: start(name, cores, options, folder) for name, cores in sharing.items()}
    result, count = {}, -1
    while any(process.poll() is None for process in running.values()):
        time.sleep(0.5)
        result = collected(folder, list(sharing))
        rows = sum(len(one["rows"]) for one in result["devices"].values())
        if rows > count:
            save(result, options.output)
            count = rows
        if time.monotonic() - begin > options.seconds + GRACE:
            for process in running.values():
                process.kill()
    result = collected(folder, list(sharing))
    for name, process in running.items():
        result["devices"][name]["exit_code"] = process.wait()
        log = (folder / f"{name}.log").read_text()
        result["devices"][name]["log"] = log[-2000:] if process.returncode else ""
    save(result, options.output)
    return result


def processor_shares(with_cpu_devices: bool) -> dict[str, list[int]]:
    """Return the processors of each process: half of them for the host side of the GPU."""
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) < 3:
        return {"default": cores, "cpu": cores}
    half = len(cores) // 2
    shares = {"default": cores[:half], "cpu": cores[half : half + 1]}
    if with_cpu_devices and len(cores) > half + 2:
        shares["cpu_cores"] = cores[half + 1 :]
    return shares


def start(name: str, cores: list[int], options: argparse.Namespace, folder: Path):
    """Start the process of one device."""
    environment = dict(os.environ)
    if name != "default":
        environment |= {"JAX_PLATFORMS": "cpu", "CUDA_VISIBLE_DEVICES": ""}
    if name == "cpu_cores":
        environment["JAX_NUM_CPU_DEVICES"] = str(len(cores))
    cases = [n for n in options.cases if name == "default" or n <= options.cpu_cases]
    command = [sys.executable, "-m", "benchmarks.many_cases_rows", str(folder / name)]
    command += ["--cores", *map(str, cores), "--cases", *map(str, cases)]
    command += ["--problems", *options.problems, "--samples", str(options.samples)]
    command += ["--seconds", str(options.seconds)]
    with (folder / f"{name}.log").open("w") as log:
        return subprocess.Popen(command, cwd=ROOT, env=environment, stdout=log, stderr=log)


def collected(folder: Path, names: Sequence[str]) -> dict:
    """Return the figures that stand in the files of the processes."""
    devices = {}
    for name in names:
        path = folder / f"{name}.jsonl"
        lines = [json.loads(line) for line in complete_lines(path)]
        head = lines[0] if lines else {}
        devices[name] = {**head, "rows": lines[1:]}
    return {"devices": devices, "summary": summary(devices, folder)}


def complete_lines(path: Path) -> list[str]:
    """Return the lines of a file but for one that is being written."""
    if not path.exists():
        return []
    return [line for line in path.read_text().splitlines(keepends=True) if line.endswith("\n")]


def summary(devices: dict, folder: Path) -> list[dict]:
    """Return for each problem and each way to use the CPU: the crossing and the differences."""
    found = []
    for problem in PROBLEMS:
        gpu = costs(devices["default"]["rows"], problem)
        for name in devices:
            cpu = costs(devices[name]["rows"], problem)
            if name == "default" or not gpu or not cpu:
                continue
            # beyond the largest number of cases on the CPU its cost per case no longer changes
            pairs = [(n, gpu[n], cpu.get(n, cpu[max(cpu)])) for n in gpu if n >= min(cpu)]
            faster = [n for n, ours, theirs in pairs if ours < theirs]
            row = {
                "problem": problem,
                "cpu": name,
                "faster_from": min(faster) if faster else None,
                "slower_up_to": max((n for n, a, b in pairs if a >= b), default=None),
                "times_as_fast": {str(n): theirs / ours for n, ours, theirs in pairs},
            }
            found.append(row | differences(folder, problem, name))
    return found


def costs(rows: list[dict], problem: str) -> dict[int, float]:
    """Return the milliseconds per case by number of cases."""
    return {
        row["cases"]: row["ms_per_case"]
        for row in rows
        if row["problem"] == problem and "ms_per_case" in row
    }


def differences(folder: Path, problem: str, name: str) -> dict:
    """Return the largest difference of the estimates of the same cases on two devices."""
    paths = [folder / f"{one}-{problem}.npz" for one in ("default", name)]
    if not all(path.exists() for path in paths):
        return {}
    ours, theirs = (np.load(path) for path in paths)
    count = min(len(ours["values"]), len(theirs["values"]))
    change = np.abs(ours["values"][:count] - theirs["values"][:count])
    errors = theirs["standard_errors"][:count]
    return {
        "compared": count,
        "largest_difference": float(np.max(change / np.abs(theirs["values"][:count]))),
        "largest_difference_in_standard_errors": float(np.max(change / errors)),
        "same_status": bool(np.all(ours["status"][:count] == theirs["status"][:count])),
    }


def save(result: dict, path: Path | None) -> None:
    """Replace the file of the result as a whole."""
    if path is not None:
        partial = path.with_name(path.name + ".partial")
        partial.write_text(json.dumps(result, indent=1))
        partial.replace(path)


def table(result: dict) -> str:
    """Return the figures as text."""
    lines = []
    for name, device in result["devices"].items():
        head = f"{device.get('device', '?')} ({device.get('backend', '?')})"
        lines.append(f"{name}: {head}, {device.get('count', '?')} device(s)")
        lines.append(f"  {'problem':<10} {'cases':>7} {'ms/case':>9} {'wall s':>8} {'first s':>8}")
        for row in device["rows"]:
            left = f"  {row['problem']:<10} {row['cases']:>7}"
            if "ms_per_case" not in row:
                lines.append(f"{left} {row['reason']}")
                continue
            lines.append(
                f"{left} {row['ms_per_case']:>9.4f} {row['seconds']:>8.2f} "
                f"{row['first_seconds']:>8.2f}  {row['statuses']}"
            )
        if device.get("log"):
            lines.append(device["log"])
    for row in result["summary"]:
        start_of_gain = row["faster_from"] or "no number of cases"
        line = f"{row['problem']}, default against {row['cpu']}: faster from {start_of_gain}"
        if "compared" in row:
            line += (
                f"; largest difference of {row['compared']} cases "
                f"{row['largest_difference']:.1e}, "
                f"{row['largest_difference_in_standard_errors']:.1e} standard errors"
            )
        lines.append(line)
    return "\n".join(lines)


if __name__ == "__main__":
    main()
