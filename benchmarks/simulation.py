"""Flights of the F-4-like aircraft, one and many at once: `python -m benchmarks.simulation
[--json]`.

The report's lateral case 1 in Dryden gusts, each flight with its own gusts and its own instrument
errors at the base level. The table shows time and memory by number and length of the flights, and
the same flight in plain NumPy and SciPy. Our time includes the draws of errors, gusts and noise;
NumPy and SciPy use the same draws without this cost.
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
from jaxid.aircraft.air.turbulence import GUSTS, dryden
from jaxid.aircraft.airframes.shared import DATA
from jaxid.aircraft.flight.aircraft import Aircraft
from jaxid.aircraft.flight.report_cases import (
    CASE_ALTITUDE,
    CASES,
    REPORT_SAMPLE_TIME,
    initial_condition,
)
from jaxid.aircraft.flight.simulate_flight import SUBSTEPS, FlightSolution, flight_solution
from jaxid.aircraft.instruments.noise_levels import BASE, draw
from jaxid.aircraft.vehicle.aerodynamics_tables import read_coefficients
from jaxid.aircraft.vehicle.controls import SURFACES
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
    """A batch of flights with its time and memory.

    Attributes:
        flights: arrays with a leading axis of flights.
        seconds: of one pass, the median.
        compile_seconds: tracing and compiling.
        megabytes: memory of the compiled function without its arguments [MB]; None if the backend
            does not report it.
    """

    flights: FlightSolution
    seconds: float
    compile_seconds: float
    megabytes: float | None


def make_problem() -> Problem:
    """Return the aircraft of the case and its initial state."""
    aircraft, state = initial_condition(CASE)
    return Problem(aircraft.disturbed(*GUSTS), state)


def sample_times(seconds: float) -> jax.Array:
    """Ten samples a second, both ends included [s]."""
    return REPORT_SAMPLE_TIME * jnp.arange(round(seconds / REPORT_SAMPLE_TIME) + 1)


def conditions(problem: Problem, t: jax.Array, key: jax.Array) -> tuple[Aircraft, jax.Array]:
    """One flight's own aircraft and inputs: instrument errors and gusts drawn from a key."""
    for_errors, for_gusts = jax.random.split(key)
    pilot = [CASE.pilot[name](t) if name in CASE.pilot else jnp.zeros_like(t) for name in SURFACES]
    gusts = dryden(
        for_gusts, t, CASE.V, CASE_ALTITUDE, "moderate", span=problem.aircraft.airframe.b
    )
    instruments = draw(for_errors, problem.aircraft.instruments, BASE)
    aircraft = eqx.tree_at(lambda one: one.instruments, problem.aircraft, instruments)
    return aircraft, jnp.concatenate([jnp.stack(pilot, axis=1), gusts], axis=1)


def one_flight(problem: Problem, t: jax.Array, key: jax.Array) -> FlightSolution:
    """Errors and gusts, the flight, and its noise."""
    own, for_noise = jax.random.split(key)
    aircraft, u = conditions(problem, t, own)
    return flight_solution(aircraft, t, u, problem.state, for_noise)


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
        jax.jit(alone if count == 1 else jax.vmap(one_flight, in_axes=(None, None, 0)))
        .lower(*arguments)
        .compile()
    )
    compile_seconds = time.perf_counter() - begin
    memory = function.memory_analysis()
    megabytes = (
        None
        if memory is None
        else (memory.temp_size_in_bytes + memory.output_size_in_bytes) / MEGABYTE
    )
    times = []
    result = jax.block_until_ready(function(*arguments))
    for _ in range(repeats):
        taken, result = _timed(lambda: jax.block_until_ready(function(*arguments)))
        times.append(taken)
    return Outcome(result, statistics.median(times), compile_seconds, megabytes)


def peers(
    problem: Problem, seconds: float, key: jax.Array
) -> dict[str, Callable[[], tuple[np.ndarray, np.ndarray]]]:
    """Each peer as a function without arguments that flies the flight of a key: states and readings
    without noise.
    """
    t = sample_times(seconds)
    own, _ = jax.random.split(key)
    aircraft, u = jax.jit(conditions)(problem, t, own)
    numbers = dict(
        zip(parameter_names(aircraft), np.asarray(flatten(aircraft)[0]).tolist(), strict=True)
    )
    peer = FlightInNumpy(numbers, read_coefficients(DATA / "f4"), aircraft.outputs)
    given = (np.asarray(t), np.asarray(u), np.asarray(problem.state))
    return {
        NUMPY: lambda: peer.fly(*given, SUBSTEPS),
        SCIPY: lambda: peer.fly_adaptively(*given, 1e-6),
    }


def disagreement(one: tuple, other: tuple) -> float:
    """Largest difference in any state or reading at any time, relative to the largest value of that
    signal in `other`.
    """
    worst = 0.0
    for a, b in zip(one, other, strict=True):
        a, b = np.asarray(a), np.asarray(b)
        size = np.max(np.abs(b), axis=0)
        worst = max(
            worst, float(np.max(np.max(np.abs(a - b), axis=0) / np.where(size > 0, size, 1.0)))
        )
    return worst


def measure(problem: Problem, counts: list[int], lengths: list[float], repeats: int) -> list[dict]:
    """One row for each peer, each number of flights of the first length, and each further length of
    a middle number.

    `times_numpy` is how many times as many seconds of flight are flown in a second as by NumPy in
    this same run.
    """
    usual, middle = lengths[0], counts[len(counts) // 2]
    by_length = {seconds: peers(problem, seconds, keys(1)[0]) for seconds in lengths}
    references = {seconds: functions[NUMPY]() for seconds, functions in by_length.items()}
    single, rows = fly_many(problem, 1, usual, repeats), []
    for name, function in by_length[usual].items():
        times = [_timed(function) for _ in range(min(repeats, 5))]
        flight, seconds = times[-1][1], statistics.median(taken for taken, _ in times)
        rows.append(
            _row(problem, name, 1, usual, seconds, flight, single.flights, references[usual])
        )
    for count, length in [(count, usual) for count in counts] + [
        (middle, length) for length in lengths[1:]
    ]:
        outcome = (
            single if (count, length) == (1, usual) else fly_many(problem, count, length, repeats)
        )
        first = (outcome.flights.solution.x[0], outcome.flights.solution.y[0])
        row = _row(
            problem,
            JAXID,
            count,
            length,
            outcome.seconds,
            first,
            outcome.flights,
            references[length],
        )
        rows.append(
            row | {"compile_seconds": outcome.compile_seconds, "megabytes": outcome.megabytes}
        )
    numpy = rows[0]["flights_per_second"] * usual
    return [
        row | {"times_numpy": row["flights_per_second"] * row["length"] / numpy} for row in rows
    ]


def _row(
    problem: Problem,
    name: str,
    count: int,
    length: float,
    seconds: float,
    first,
    flights: FlightSolution,
    reference,
) -> dict:
    """Return the entries of all rows; the misfit is in standard deviations of the noise."""
    outputs, y = (
        problem.aircraft.outputs,
        flights.solution.y if name == JAXID else np.asarray(first[1])[None],
    )
    columns, sigma = [outputs.index(name) for name in BASE.noise], np.array([*BASE.noise.values()])
    residual = (np.asarray(flights.z) - np.asarray(y))[..., columns] / sigma
    apart = disagreement(first, reference)
    good = apart <= TOLERANCES[name] and bool(np.all(flights.solution.finite))
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
    """Return the rows as a text table."""
    heads = (
        f"{'misfit':>7} {'disagreement':>13} {'s':>8} {'flights/s':>10} {'x NumPy':>8} "
        f"{'compile s':>10}"
    )
    lines = [
        f"{'way':<18} {'flights':>7} {'length s':>8} {'status':<8} {heads} {'MB':>8} "
        f"{'process MB':>11}"
    ]
    for row in rows:
        memory = "-" if row["megabytes"] is None else f"{row['megabytes']:.1f}"
        lines.append(
            f"{row['way']:<18} {row['flights']:>7} {row['length']:>8g} {row['status']:<8} "
            f"{row['misfit']:>7.4f} "
            f"{row['disagreement']:>13.1e} {row['seconds']:>8.4f} "
            f"{row['flights_per_second']:>10.1f} "
            f"{row['times_numpy']:>8.1f} {row['compile_seconds']:>10.2f} {memory:>8} "
            f"{row['peak_process_megabytes']:>11.0f}"
        )
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return 0 if all methods agree."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.simulation", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object and nothing else"
    )
    parser.add_argument(
        "--flights",
        type=int,
        nargs="+",
        default=[1, 10, 100, 1000],
        help="numbers of flights at once",
    )
    parser.add_argument(
        "--seconds",
        type=float,
        nargs="+",
        default=[10, 5, 20, 40],
        help="lengths, the usual one first",
    )
    parser.add_argument(
        "--repeats", type=int, default=7, help="passes of which the median is taken (default: 7)"
    )
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    # compile times are measured, not read from a file
    jax.config.update("jax_enable_compilation_cache", False)
    rows = measure(make_problem(), options.flights, options.seconds, options.repeats)
    status = "agrees" if all(row["status"] == "agrees" for row in rows) else "differs"
    device = jax.devices()[0]
    machine = {
        "cores": os.cpu_count(),
        "device": device.platform,
        "device_kind": device.device_kind,
    }
    machine |= {"jax": jax.__version__, "python": platform.python_version()}
    setting = {
        "case": "lateral 1",
        "samples_per_second": round(1 / REPORT_SAMPLE_TIME),
        "substeps": SUBSTEPS,
    }
    if options.json:
        print(json.dumps({"status": status, **setting, **machine, "rows": rows}))
    else:
        print(table(rows))
        print(
            "x NumPy: seconds of flight in a second, as a multiple of NumPy's; disagreement: with "
            "NumPy, of the first flight, "
            f"relative; MB: temporary and results, by the compiler; {machine}"
        )
    return 0 if status == "agrees" else 1


if __name__ == "__main__":
    sys.exit(main())
