"""What a closed loop costs: `python -m benchmarks.loop_cost [--json] [--sizes 60,750,3 ...]`.

The coupled flight of `python -m jaxid` (six degrees of freedom, 26 free parameters) with so many candidates, samples and
records. Each size runs twice in a process of its own, without a compilation cache, as in a user's notebook: the
first study is a cold start but for the imports, the second is warm. Beside the seconds: where they go, how often the pass of
sensitivities was compiled, which is once for all rounds, and what was found; in the JSON also the largest error on the test
records over the noise that stands in them.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple
from unittest import mock

import jax
import numpy as np

from jaxid import OutputError, close_loop
from jaxid.aircraft.coupled_flight import coupled_flight
from jaxid.aircraft.simulated_flight import realised_noise
from jaxid.estimation.estimate import as_stack
from jaxid.models.effects import Effect
from jaxid.study.close_loop import candidates
from jaxid.study.workbench import Workbench

TRUTH = "beta^2 in Cm"
PASS = "jit(sensitivities)"  # as JAX calls the program that scores all candidates
WINDOW = 50  # samples in which a flight's initial state is fitted
STEPS = ("compile", "fit", "score", "where", "predict", "read", "set_shapes")


class Size(NamedTuple):
    """How much a study has to do."""

    candidates: int
    samples: int
    records: int


ASKED = Size(60, 750, 3)
GROWTH = (
    ASKED,
    *(ASKED._replace(candidates=count) for count in (15, 30, 120)),
    *(ASKED._replace(samples=count) for count in (250, 500)),
    *(ASKED._replace(records=count) for count in (1, 5)),
)


def study(size: Size, among: Callable[[Effect], bool] = lambda effect: True) -> dict[str, Any]:
    """One study of a size, cold and again warm, in this process; its candidates are drawn among some of the library."""
    compiled: Counter[str] = Counter()

    def listen(event: str, duration: float, **details: Any) -> None:
        if event.endswith("jaxpr_to_mlir_module_duration"):  # once for each program, also where a cache holds it
            compiled[str(details.get("fun_name"))] += 1

    jax.monitoring.register_event_duration_secs_listener(listen)
    flight = coupled_flight(jax.random.key(0), size.samples)
    train, check = (*flight.train, *flight.check)[: size.records], flight.check
    known = candidates(flight.model, flight.free, as_stack(list(flight.train)))
    others = [one for one in known if one.name != TRUTH and among(one)]
    drawn = np.random.default_rng(0).choice(len(others), size.candidates - 1, replace=False)
    library = [one for one in known if one.name == TRUTH] + [others[i] for i in sorted(drawn)]
    runs = []
    for _ in ("cold", "warm"):
        compiled.clear()
        with timed() as seconds:
            begin = time.perf_counter()
            found = close_loop(
                flight.model,
                flight.free,
                OutputError(),
                train=train,
                check=check,
                test=flight.test,
                effects=library,
                window=WINDOW,
            )
            whole = time.perf_counter() - begin
        passes = {"passes_compiled": compiled[PASS], "rounds": len(found.rounds)}
        runs.append({"seconds": whole, **passes, "steps": dict(seconds)})
    cold, warm = runs
    noise = realised_noise(flight, flight.test, skip=WINDOW)
    over = max(found.after.rms["test"][name] / own for name, own in zip(flight.model.outputs, noise, strict=True))
    said = {"effects": list(found.effects), "outcome": found.outcome, "over_noise": float(over)}
    return {**size._asdict(), **said, "cold": cold, "warm": warm}


@contextmanager
def timed():
    """Seconds by step of the workbench."""
    seconds: Counter[str] = Counter()

    def measured(name):
        step = getattr(Workbench, name)

        def wrapped(self, *arguments, **options):
            begin = time.perf_counter()
            found = step(self, *arguments, **options)
            jax.block_until_ready([leaf for leaf in jax.tree.leaves(found) if isinstance(leaf, jax.Array)])
            seconds[name] += time.perf_counter() - begin
            return found

        return mock.patch.object(Workbench, name, wrapped)

    with ExitStack() as stack:
        for name in STEPS:
            stack.enter_context(measured(name))
        yield seconds


def apart(size: Size) -> dict[str, Any]:
    """One size in a process of its own, with nothing compiled before."""
    environment = os.environ | {"JAX_ENABLE_COMPILATION_CACHE": "0"}
    command = [sys.executable, "-m", "benchmarks.loop_cost", "--here", ",".join(map(str, size))]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"The study of {size} failed:\n{done.stderr[-2000:]}")
    return json.loads(done.stdout)


def table(rows: list[dict[str, Any]]) -> str:
    """The figures in lines."""
    head = f"{'candidates':>10} {'samples':>8} {'records':>8} {'cold':>8} {'warm':>8}  {'passes compiled':>15}  found"
    lines = [head, "-" * len(head)]
    for one in rows:
        cold, warm = one["cold"], one["warm"]
        passes = f"{cold['passes_compiled']} in {cold['rounds']} rounds"
        lines.append(
            f"{one['candidates']:>10} {one['samples']:>8} {one['records']:>8} {cold['seconds']:>6.1f} s "
            f"{warm['seconds']:>6.1f} s  {passes:>15}  {', '.join(one['effects']) or '-'}"
        )
    first = rows[0]
    for name in ("cold", "warm"):
        parts = sorted(first[name]["steps"].items(), key=lambda part: -part[1])
        told = ", ".join(f"{step} {seconds:.1f} s" for step, seconds in parts)
        lines += ["", f"{name}, {first['candidates']} candidates, of these: {told}"]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; 0 where every study ran."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.loop_cost", description=__doc__.splitlines()[0])

    def size(value: str) -> Size:
        return Size(*map(int, value.split(",")))

    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    parser.add_argument("--sizes", type=size, nargs="+", default=list(GROWTH), help="candidates,samples,records")
    parser.add_argument("--here", type=size, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    if options.here:
        print(json.dumps(study(options.here)))
        return 0
    rows = []
    for one in options.sizes:
        print(f"{one.candidates} candidates, {one.samples} samples, {one.records} records", file=sys.stderr, flush=True)
        rows.append(apart(one))
    if options.json:
        print(json.dumps({"status": "measured", "cores": os.cpu_count(), "machine": platform.machine(), "sizes": rows}))
    else:
        print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
