"""Flights of the F-4-like aircraft, one and many at once: `python -m benchmarks.simulation [--json]`.

The report's lateral case 1 in Dryden gusts, each flight with its own gusts and its own instrument errors at the base level: how
time and memory grow with the number of flights and with their length, and the same flight in plain NumPy and SciPy. Drawing
errors, gusts and noise is part of our time and not of theirs; they are given ours.
"""

import argparse
import json
import os
import platform
import resource
import statistics
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.flight_in_numpy import FlightInNumpy
from jaxid.aircraft.aerodynamics_tables import read_coefficients
from jaxid.aircraft.aircraft import Aircraft
from jaxid.aircraft.airframes.shared import DATA
from jaxid.aircraft.controls import SURFACES
from jaxid.aircraft.flights import ALTITUDE, CASES, SAMPLE_TIME, start
from jaxid.aircraft.fly import SUBSTEPS, Flown, flown
from jaxid.aircraft.noise_levels import BASE, draw
from jaxid.aircraft.turbulence import GUSTS, dryden
from jaxid.models.names import flatten, parameter_names

CASE = CASES["lateral 1"]
JAXID, NUMPY, SCIPY = "jaxid", "NumPy, same steps", "SciPy, solve_ivp"
TOLERANCES = {
    JAXID: 1e-9,
    NUMPY: 1e-9,
    SCIPY: 1e-2,
}  # relative; solve_ivp takes steps of its own, at a tolerance of 1e-6
MEGABYTE = 1e6


class Problem(NamedTuple):
    """The aircraft in trim before anything is drawn.

    Attributes:
        aircraft: with gusts among its inputs.
        state: at the start.
    """

    aircraft: Aircraft
    state: jax.Array


class Outcome(NamedTuple):
    """A batch of flights and what it took.

    Attributes:
        flown: arrays with a leading axis of flights.
        seconds: of one pass, the median.
        compile_seconds: tracing and compiling.
        megabytes: what the compiled function takes beside its arguments; None where the backend does not say.
    """

    flown: Flown
    seconds: float
    compile_seconds: float
    megabytes: float | None


def make_problem() -> Problem:
    """The case's aircraft and where it starts."""
    aircraft, state = start(CASE)
    return Problem(aircraft.disturbed(*GUSTS), state)


def sample_times(seconds: float) -> jax.Array:
    """Ten samples a second, both ends included [s]."""
    return SAMPLE_TIME * jnp.arange(round(seconds / SAMPLE_TIME) + 1)


def conditions(problem: Problem, t: jax.Array, key: jax.Array) -> tuple[Aircraft, jax.Array]:
    """One flight's own aircraft and inputs: instrument errors and gusts drawn from a key."""
    for_errors, for_gusts = jax.random.split(key)
    pilot = [CASE.pilot[name](t) if name in CASE.pilot else jnp.zeros_like(t) for name in SURFACES]
    gusts = dryden(for_gusts, t, CASE.V, ALTITUDE, "moderate", span=problem.aircraft.airframe.b)
    instruments = draw(for_errors, problem.aircraft.instruments, BASE)
    aircraft = eqx.tree_at(lambda one: one.instruments, problem.aircraft, instruments)
    return aircraft, jnp.concatenate([jnp.stack(pilot, axis=1), gusts], axis=1)


def one_flight(problem: Problem, t: jax.Array, key: jax.Array) -> Flown:
    """Errors and gusts, the flight, and its noise."""
    own, for_noise = jax.random.split(key)
    aircraft, u = conditions(problem, t, own)
    return flown(aircraft, t, u, problem.state, for_noise)


def keys(count: int, seed: int = 0) -> jax.Array:
    """One key for each flight; the first flight is the same in any number of them."""
    return jax.vmap(lambda i: jax.random.fold_in(jax.random.key(seed), i))(jnp.arange(count))


def fly_many(problem: Problem, count: int, seconds: float, repeats: int) -> Outcome:
    """Compile and fly; a single flight without `vmap`."""

    def alone(problem, t, keys):
        return jax.tree.map(lambda leaf: leaf[None], one_flight(problem, t, keys[0]))

    arguments = (problem, sample_times(seconds), keys(count))
    begin = time.perf_counter()
    function = (
        jax.jit(alone if count == 1 else jax.vmap(one_flight, in_axes=(None, None, 0))).lower(*arguments).compile()
    )
    compile_seconds = time.perf_counter() - begin
    memory = function.memory_analysis()
    megabytes = None if memory is None else (memory.temp_size_in_bytes + memory.output_size_in_bytes) / MEGABYTE
    times = []
    result = jax.block_until_ready(function(*arguments))
    for _ in range(repeats):
        taken, result = _timed(lambda: jax.block_until_ready(function(*arguments)))
        times.append(taken)
    return Outcome(result, statistics.median(times), compile_seconds, megabytes)


def peers(problem: Problem, seconds: float, key: jax.Array) -> dict[str, Callable[[], tuple[np.ndarray, np.ndarray]]]:
    """Each peer as a function without arguments that flies the flight of a key: states and readings without noise."""
    t = sample_times(seconds)
    own, _ = jax.random.split(key)
    aircraft, u = jax.jit(conditions)(problem, t, own)
    numbers = dict(zip(parameter_names(aircraft), np.asarray(flatten(aircraft)[0]).tolist(), strict=True))
    peer = FlightInNumpy(numbers, read_coefficients(DATA / "f4"), aircraft.outputs)
    given = (np.asarray(t), np.asarray(u), np.asarray(problem.state))
    return {NUMPY: lambda: peer.fly(*given, SUBSTEPS), SCIPY: lambda: peer.fly_adaptively(*given, 1e-6)}


def disagreement(one: tuple, other: tuple) -> float:
    """Largest difference in any state or reading at any time, relative to the largest value of that signal in `other`."""
    worst = 0.0
    for a, b in zip(one, other, strict=True):
        a, b = np.asarray(a), np.asarray(b)
        size = np.max(np.abs(b), axis=0)
        worst = max(worst, float(np.max(np.max(np.abs(a - b), axis=0) / np.where(size > 0, size, 1.0))))
    return worst


def measure(problem: Problem, counts: list[int], lengths: list[float], repeats: int) -> list[dict]:
    """One row for each peer, each number of flights of the first length, and each further length of a middle number.

    `times_numpy` is how many times as many seconds of flight are flown in a second as by NumPy in this same run.
    """
    usual, middle = lengths[0], counts[len(counts) // 2]
    by_length = {seconds: peers(problem, seconds, keys(1)[0]) for seconds in lengths}
    references = {seconds: functions[NUMPY]() for seconds, functions in by_length.items()}
    single, rows = fly_many(problem, 1, usual, repeats), []
    for name, function in by_length[usual].items():
        times = [_timed(function) for _ in range(min(repeats, 5))]
        found, seconds = times[-1][1], statistics.median(taken for taken, _ in times)
        rows.append(_row(problem, name, 1, usual, seconds, found, single.flown, references[usual]))
    for count, length in [(count, usual) for count in counts] + [(middle, length) for length in lengths[1:]]:
        outcome = single if (count, length) == (1, usual) else fly_many(problem, count, length, repeats)
        first = (outcome.flown.solution.x[0], outcome.flown.solution.y[0])
        row = _row(problem, JAXID, count, length, outcome.seconds, first, outcome.flown, references[length])
        rows.append(row | {"compile_seconds": outcome.compile_seconds, "megabytes": outcome.megabytes})
    numpy = rows[0]["flights_per_second"] * usual
    return [row | {"times_numpy": row["flights_per_second"] * row["length"] / numpy} for row in rows]


def _row(
    problem: Problem, name: str, count: int, length: float, seconds: float, first, flown: Flown, reference
) -> dict:
    """What every row has. The misfit is that of the record, in standard deviations of its noise."""
    outputs, y = problem.aircraft.outputs, flown.solution.y if name == JAXID else np.asarray(first[1])[None]
    columns, sigma = [outputs.index(name) for name in BASE.noise], np.array([*BASE.noise.values()])
    residual = (np.asarray(flown.z) - np.asarray(y))[..., columns] / sigma
    apart = disagreement(first, reference)
    good = apart <= TOLERANCES[name] and bool(np.all(flown.solution.finite))
    return {
        "way": name,
        "flights": count,
        "length": length,
        "status": "agrees" if good else "differs",
        "misfit": float(np.sqrt(np.mean(residual**2))),
        "disagreement": apart,
        "seconds": seconds,
        "flights_per_second": count / seconds,
        "compile_seconds": 0.0,
        "megabytes": None,
        "peak_process_megabytes": _peak(),
    }


def _peak() -> float:
    """Most memory that this process has held so far [MB]; Linux counts kilobytes, macOS bytes."""
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / MEGABYTE


def _timed(function: Callable) -> tuple:
    begin = time.perf_counter()
    result = function()
    return time.perf_counter() - begin, result


def table(rows: list[dict]) -> str:
    """The rows in columns."""
    heads = f"{'misfit':>7} {'disagreement':>13} {'s':>8} {'flights/s':>10} {'x NumPy':>8} {'compile s':>10}"
    lines = [f"{'way':<18} {'flights':>7} {'length s':>8} {'status':<8} {heads} {'MB':>8} {'process MB':>11}"]
    for row in rows:
        memory = "-" if row["megabytes"] is None else f"{row['megabytes']:.1f}"
        lines.append(
            f"{row['way']:<18} {row['flights']:>7} {row['length']:>8g} {row['status']:<8} {row['misfit']:>7.4f} "
            f"{row['disagreement']:>13.1e} {row['seconds']:>8.4f} {row['flights_per_second']:>10.1f} "
            f"{row['times_numpy']:>8.1f} {row['compile_seconds']:>10.2f} {memory:>8} {row['peak_process_megabytes']:>11.0f}"
        )
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; 0 where all ways agree."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.simulation", description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    parser.add_argument("--flights", type=int, nargs="+", default=[1, 10, 100, 1000], help="numbers of flights at once")
    parser.add_argument(
        "--seconds", type=float, nargs="+", default=[10, 5, 20, 40], help="lengths, the usual one first"
    )
    parser.add_argument("--repeats", type=int, default=7, help="passes of which the median is taken (default: 7)")
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_enable_compilation_cache", False)  # compile times are measured, not read from a file
    rows = measure(make_problem(), options.flights, options.seconds, options.repeats)
    status = "agrees" if all(row["status"] == "agrees" for row in rows) else "differs"
    device = jax.devices()[0]
    machine = {"cores": os.cpu_count(), "device": device.platform, "device_kind": device.device_kind}
    machine |= {"jax": jax.__version__, "python": platform.python_version()}
    setting = {"case": "lateral 1", "samples_per_second": round(1 / SAMPLE_TIME), "substeps": SUBSTEPS}
    if options.json:
        print(json.dumps({"status": status, **setting, **machine, "rows": rows}))
    else:
        print(table(rows))
        print(
            "x NumPy: seconds of flight in a second, as a multiple of NumPy's; disagreement: with NumPy, of the first flight, "
            f"relative; MB: temporary and results, by the compiler; {machine}"
        )
    return 0 if status == "agrees" else 1


if __name__ == "__main__":
    sys.exit(main())
