"""Time and memory of one joint estimate of many records:
`python -m benchmarks.many_records [--json]`.

The aircraft of `reference_problem`, 30 coefficients that all records share, and independent noise
in each record. Each number of records is estimated twice in a process of its own: the first time
with compilation (`--once`: no second time). The peak memory is measured of the process, and of the
GPU if there is one. The estimates are compared with the truth in standard errors.
"""

import argparse
import json
import math
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.reference_problem.clocks import MEGABYTE, peak_megabytes
from benchmarks.reference_problem.growth import exponent

ROOT = Path(__file__).resolve().parents[1]
RECORDS = (64, 256, 1024, 4096)
COLUMNS = (  # key, head of the table's column, digits after the point
    ("records", "records", 0),
    ("first_seconds", "first [s]", 1),
    ("seconds", "last [s]", 1),
    ("iterations", "iterations", 0),
    ("peak_mb", "memory [MB]", 0),
    ("peak_before_estimate_mb", "before the estimate", 0),
    ("peak_of_device_mb", "of the GPU", 0),
    ("largest_deviation", "largest deviation", 2),
)


def estimate(count: int, samples: int, calls: int) -> dict[str, Any]:
    """Return the figures of one joint estimate, in this process."""
    import jax

    import jaxid
    from benchmarks.many_cases_rows import reference
    from benchmarks.reference_problem.problem import THETA
    from jaxid.data import stack

    jaxid.configure()
    problem = reference(samples)
    records = stack([problem.record(number) for number in range(count)])
    before = peak_megabytes()
    seconds = []
    for _ in range(calls):
        begin = time.perf_counter()
        found = jaxid.estimate(problem.model, problem.free, records, jaxid.OutputError())
        seconds.append(time.perf_counter() - begin)
    deviation = (np.asarray(found.values) - THETA) / np.asarray(found.standard_errors)
    statistics = jax.devices()[0].memory_stats() or {}
    return {
        "records": count,
        "first_seconds": seconds[0],
        "seconds": seconds[-1],
        "converged": bool(found.successful),
        "iterations": int(found.iterations),
        "peak_mb": peak_megabytes(),
        "peak_before_estimate_mb": before,
        "peak_of_device_mb": statistics.get("peak_bytes_in_use", math.nan) / MEGABYTE,
        "largest_deviation": float(np.max(np.abs(deviation))),
        "device": jax.devices()[0].device_kind,
    }


def measure(options: argparse.Namespace) -> list[dict[str, Any]]:
    """Return the figures of all numbers of records."""
    rows = []
    for count in options.records:
        command = [sys.executable, "-m", __spec__.name, "--one", str(count)]
        command += ["--samples", str(options.samples), *(["--once"] if options.once else [])]
        done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
        rows.append(json.loads(done.stdout.splitlines()[-1]))
        print(row(rows[-1]), file=sys.stderr, flush=True)
    return rows


def row(one: dict[str, Any]) -> str:
    """Return the figures of one number of records as a line."""
    cells = (f"{one[name]:>{len(head)}.{digits}f}" for name, head, digits in COLUMNS)
    return "  ".join(cells) + ("" if one["converged"] else "  not converged")


def growth(rows: Sequence[dict[str, Any]]) -> float:
    """Return the exponent of the time of an iteration in the number of records."""
    return exponent(
        [one["records"] for one in rows], [one["seconds"] / one["iterations"] for one in rows]
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print a table, or with `--json` one object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, nargs="+", default=list(RECORDS))
    parser.add_argument("--samples", type=int, default=751)
    parser.add_argument("--once", action="store_true", help="estimate once, with compilation")
    parser.add_argument("--one", type=int, help="number of records to estimate in this process")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    if options.one is not None:
        print(json.dumps(estimate(options.one, options.samples, 1 if options.once else 2)))
        return
    rows = measure(options)
    grown = growth(rows) if len(rows) > 1 else math.nan
    if options.json:
        print(json.dumps({"rows": rows, "exponent": grown}))
        return
    print("  ".join(head for _, head, _ in COLUMNS))
    print("\n".join(map(row, rows)))
    print(f"the time of a step grows with the power {grown:.2f} of the number of records")


if __name__ == "__main__":
    main()
