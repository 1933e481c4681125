"""Run time and compilations of a closed loop.

`python -m benchmarks.loop_cost [--json] [--sizes 60,750,3 ...]`.

The coupled flight of `python -m jaxid` (six degrees of freedom, 26 free parameters) with a given
number of candidates, samples and records. Each size runs twice in a separate process, without a
compilation cache, as in a user's notebook: the first study is a cold start except for the imports,
the second is warm. The table shows the seconds, their split over the steps, the number of
compilations of the sensitivity pass (for all rounds one of the records, and one of the window in
which a check record's initial state is fitted) and the added effects; the JSON also has the largest
error on the test records over the realised noise of these records.
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
from jaxid.aircraft.flight.coupled_flight import coupled_flight
from jaxid.aircraft.flight.simulated_flight import realised_noise
from jaxid.diagnosis.validation import Predictor
from jaxid.effects.base import Effect
from jaxid.estimation.estimate import as_stack
from jaxid.loop import fit as loop_fit
from jaxid.loop import linear_motion, moves
from jaxid.study import assembly
from jaxid.study.candidates import candidates

TRUTH = "beta^2 in Cm"
PASS = "jit(sensitivities)"  # JAX's name of the program of all fits and scores
WINDOW = 50  # samples in which a flight's initial state is fitted
# Steps of a study, none within another, and where the function of each is looked up.
STEPS: dict[str, tuple[Any, str]] = {
    "fit": (loop_fit, "fit_by_steps"),
    "columns": (linear_motion.LinearMotion, "columns_of"),
    "localise": (moves, "localise"),
    "predict": (Predictor, "predict"),
    "analyse_residual": (assembly, "analyse_residual"),
}


class Size(NamedTuple):
    """Number of candidates, samples and records of a study."""

    candidates: int
    samples: int
    records: int


REQUESTED = Size(60, 750, 3)
GROWTH = (
    REQUESTED,
    *(REQUESTED._replace(candidates=count) for count in (15, 30, 120)),
    *(REQUESTED._replace(samples=count) for count in (250, 500)),
    *(REQUESTED._replace(records=count) for count in (1, 5)),
)


def study(size: Size, among: Callable[[Effect], bool] = lambda effect: True) -> dict[str, Any]:
    """Run one study cold and then warm in this process; return its costs.

    The candidates are drawn from the effects of the library for which `among` is True.
    """
    compiled: Counter[str] = Counter()

    def listen(event: str, duration: float, **details: Any) -> None:
        # JAX emits this event once per program, also if a cache holds the program.
        if event.endswith("jaxpr_to_mlir_module_duration"):
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
            result = close_loop(
                flight.model,
                flight.free,
                OutputError(),
                train=train,
                check=check,
                test=flight.test,
                effects=library,
                window=WINDOW,
            )
            duration = time.perf_counter() - begin
        passes = {"passes_compiled": compiled[PASS], "rounds": len(result.rounds)}
        runs.append({"seconds": duration, **passes, "steps": dict(seconds)})
    cold, warm = runs
    noise = realised_noise(flight, flight.test, skip=WINDOW)
    over = max(
        result.after.rms["test"][name] / noise_rms
        for name, noise_rms in zip(flight.model.outputs, noise, strict=True)
    )
    summary = {
        "effects": list(result.effects),
        "outcome": result.outcome.value,
        "over_noise": float(over),
    }
    return {**size._asdict(), **summary, "cold": cold, "warm": warm}


@contextmanager
def timed():
    """Yield the seconds spent in each step of a study."""
    seconds: Counter[str] = Counter(dict.fromkeys(STEPS, 0.0))

    def measured(name, place, attribute):
        step = getattr(place, attribute)

        def wrapped(*arguments, **options):
            begin = time.perf_counter()
            result = step(*arguments, **options)
            jax.block_until_ready(
                [leaf for leaf in jax.tree.leaves(result) if isinstance(leaf, jax.Array)]
            )
            seconds[name] += time.perf_counter() - begin
            return result

        return mock.patch.object(place, attribute, wrapped)

    with ExitStack() as stack:
        for name, (place, attribute) in STEPS.items():
            stack.enter_context(measured(name, place, attribute))
        yield seconds


def apart(size: Size) -> dict[str, Any]:
    """Run one size in a separate process, where nothing is compiled yet; return its costs."""
    environment = os.environ | {"JAX_ENABLE_COMPILATION_CACHE": "0"}
    command = [sys.executable, "-m", "benchmarks.loop_cost", "--here", ",".join(map(str, size))]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"The study of {size} failed:\n{done.stderr[-2000:]}")
    return json.loads(done.stdout)


def table(rows: list[dict[str, Any]]) -> str:
    """Return the costs as a text table, one line per size."""
    head = (
        f"{'candidates':>10} {'samples':>8} {'records':>8} {'cold':>8} {'warm':>8}  "
        f"{'passes compiled':>15}  found"
    )
    lines = [head, "-" * len(head)]
    for one in rows:
        cold, warm = one["cold"], one["warm"]
        passes = f"{cold['passes_compiled']} in {cold['rounds']} rounds"
        lines.append(
            f"{one['candidates']:>10} {one['samples']:>8} {one['records']:>8} "
            f"{cold['seconds']:>6.1f} s "
            f"{warm['seconds']:>6.1f} s  {passes:>15}  {', '.join(one['effects']) or '-'}"
        )
    first = rows[0]
    for name in ("cold", "warm"):
        parts = sorted(first[name]["steps"].items(), key=lambda part: -part[1])
        step_times = ", ".join(f"{step} {seconds:.1f} s" for step, seconds in parts)
        lines += ["", f"{name}, {first['candidates']} candidates, of these: {step_times}"]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; 0 where every study ran."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.loop_cost", description=__doc__.splitlines()[0]
    )

    def size(value: str) -> Size:
        return Size(*map(int, value.split(",")))

    parser.add_argument(
        "--json", action="store_true", help="print one JSON object and nothing else"
    )
    parser.add_argument(
        "--sizes", type=size, nargs="+", default=list(GROWTH), help="candidates,samples,records"
    )
    parser.add_argument("--here", type=size, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    if options.here:
        print(json.dumps(study(options.here)))
        return 0
    rows = []
    for one in options.sizes:
        print(
            f"{one.candidates} candidates, {one.samples} samples, {one.records} records",
            file=sys.stderr,
            flush=True,
        )
        rows.append(apart(one))
    if options.json:
        print(
            json.dumps(
                {
                    "status": "measured",
                    "cores": os.cpu_count(),
                    "machine": platform.machine(),
                    "sizes": rows,
                }
            )
        )
    else:
        print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
