"""Estimates and standard errors side by side with aeroid 0.5: `python -m benchmarks.rival_errors
[--json] [--draws 200]`.

Two problems, each with many records that differ in their noise: the example of aeroid's README, a
short period that starts at rest, and the short period of `benchmarks.coverage` with unknown initial
states and different sensors. Both libraries estimate the same four derivatives by output error from
the same records and starts. Counted are the 95 % intervals that hold the truth. aeroid starts a
simulation at the first sample if no initial state is given; the first problem gives it to both.
It must be installed (`pip install aeroid==0.5.0`).
"""

import argparse
import importlib.util
import json
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.stats import t as t_distribution

from benchmarks.coverage.__main__ import band
from benchmarks.coverage.flights import DERIVATIVES, NOISE, SPEED, ShortPeriod, fly
from benchmarks.reference_problem.__main__ import machine
from jaxid import AbstractModel, OutputError, configure, estimate, free, record, simulate
from jaxid._foundation.types import Array

LEVEL = 0.95
# The README prints the start, and -6 as truth of M_alpha; the other true values are chosen.
README_START = {"Z_alpha": -0.8, "M_alpha": -4.0, "M_q": -1.5, "M_delta": -6.0}
README_TRUTH = {"Z_alpha": -1.0, "M_alpha": -6.0, "M_q": -2.0, "M_delta": -8.0}
README_NOISE = np.array([0.002, 0.005])  # rad, rad/s; chosen


class Readme(AbstractModel):
    """The model of aeroid's README: dalpha/dt = Z_alpha alpha + q, dq/dt = M_alpha alpha + M_q q +
    M_delta elevator.
    """

    Z_alpha: Array
    M_alpha: Array
    M_q: Array
    M_delta: Array
    states, inputs, outputs = ("alpha", "q"), ("elevator",), ("alpha", "q")

    def rhs(self, t, x, u):
        moment = self.M_alpha * x[0] + self.M_q * x[1] + self.M_delta * u[0]
        return jnp.stack([self.Z_alpha * x[0] + x[1], moment])


class Comparison(NamedTuple):
    """A problem for both libraries.

    Attributes:
        t, u: times and elevator.
        z: measured alpha and q of each record.
        model: the model with the starts.
        truth: true values of the parameters.
        own: initial states that jaxid estimates in each record.
        x0: initial state that is given; None where it is unknown.
        rates: the equations, for aeroid.
    """

    t: np.ndarray
    u: np.ndarray
    z: np.ndarray
    model: AbstractModel
    truth: dict[str, float]
    own: tuple[str, ...]
    x0: np.ndarray | None
    rates: Callable


def readme(draws: int, seed: int) -> Comparison:
    """Return the problem of aeroid's README: a doublet from rest, 10 s."""
    rng, t = np.random.default_rng(seed), 0.05 * np.arange(200)
    u = 0.05 * (((t > 1) & (t < 2)) * 1.0 - ((t >= 2) & (t < 3)) * 1.0)
    y = np.asarray(simulate(Readme(**README_TRUTH), t, u[:, None], np.zeros(2)).y)
    z = y + README_NOISE * rng.normal(size=(draws, *y.shape))

    def rates(t, x, u, p):
        moment = p["M_alpha"] * x[0] + p["M_q"] * x[1] + p["M_delta"] * u[0]
        return np.array([p["Z_alpha"] * x[0] + x[1], moment])

    return Comparison(t, u, z, Readme(**README_START), README_TRUTH, (), np.zeros(2), rates)


def small_aircraft(draws: int, seed: int) -> Comparison:
    """Return the short period of `benchmarks.coverage`, 300 samples, initial state unknown."""
    flights = fly(draws, 300, seed)

    def rates(t, x, u, p):
        q = p["Mw"] * SPEED * x[0] + p["Mq"] * x[1] + p["Md"] * u[0]
        return np.array([p["Zw"] * x[0] + x[1], q])

    start = ShortPeriod(**{name: 0.7 * value for name, value in DERIVATIVES.items()})
    own = ("initial_state",)
    return Comparison(flights.t, flights.u[:, 0], flights.z, start, DERIVATIVES, own, None, rates)


PROBLEMS = {"aeroid's README": readme, "small aircraft, initial state unknown": small_aircraft}


class Answers(NamedTuple):
    """Estimates of all records: values, half widths of the 95 % intervals, success, CPU s."""

    values: np.ndarray
    widths: np.ndarray
    successful: np.ndarray
    seconds: float


def by_jaxid(problem: Comparison) -> Answers:
    """Return the estimates of jaxid, one call for each record."""
    names, rows = tuple(problem.truth), []
    chosen = free(problem.model, *names, per_record=problem.own)

    def fit(z):
        data = record(problem.t, problem.u, z, inputs=("elevator",), outputs=("alpha", "q"))
        return estimate(problem.model, chosen, data, OutputError())

    fit(problem.z[0])  # compiles
    begin = time.process_time()
    for z in problem.z:
        result = fit(z)
        low, high = np.asarray(result.interval(LEVEL)).T
        rows.append((np.asarray(result.values), (high - low) / 2, bool(result.successful)))
    values, widths, successful = (np.array(column) for column in zip(*rows, strict=True))
    return Answers(values, widths, successful, time.process_time() - begin)


def by_aeroid(problem: Comparison) -> Answers:
    """Return the estimates of aeroid, with the true weights of the sensors."""
    import aeroid  # pyright: ignore[reportMissingImports]  (optional)

    names, rows = tuple(problem.truth), []
    starts = {name: float(getattr(problem.model, name)) for name in names}
    model = aeroid.Model(
        states=["alpha", "q"], controls=["elevator"], parameters=starts, dynamics=problem.rates
    )
    size = README_NOISE if problem.x0 is not None else np.array(list(NOISE.values()))
    weights = {"alpha": 1.0 / size[0], "q": 1.0 / size[1]}
    begin = time.process_time()
    for z in problem.z:
        channels = {"alpha": z[:, 0], "q": z[:, 1], "elevator": problem.u}
        data = aeroid.FlightData(time=problem.t, channels=channels)
        result = aeroid.identify(model, data, list(names), weights=weights, x0=problem.x0)
        quantile = t_distribution.ppf(0.5 * (1.0 + LEVEL), result.dof)
        values = np.array([result.parameters[name] for name in names])
        errors = np.array([result.stderr[name] for name in names])
        rows.append((values, quantile * errors, bool(result.success)))
    values, widths, successful = (np.array(column) for column in zip(*rows, strict=True))
    return Answers(values, widths, successful, time.process_time() - begin)


LIBRARIES = {"jaxid": by_jaxid, "aeroid 0.5": by_aeroid}


def measure(name: str, draws: int, seed: int = 1974) -> dict:
    """Return the row of one problem: shares, biases and times of both libraries."""
    problem = PROBLEMS[name](draws, seed)
    truth, rows = np.array(list(problem.truth.values())), {}
    for library, run in LIBRARIES.items():
        answers = run(problem)
        mistakes = answers.values - truth
        rows[library] = {
            "coverage": np.mean(np.abs(mistakes) <= answers.widths, axis=0).tolist(),
            "bias_in_scatter": (mistakes.mean(axis=0) / mistakes.std(axis=0)).tolist(),
            "rms_error": np.sqrt(np.mean(mistakes**2, axis=0)).tolist(),
            "converged": float(answers.successful.mean()),
            "processor_seconds_each": answers.seconds / draws,
        }
    low, high = band(draws, truth.size)
    return {
        "problem": name,
        "draws": draws,
        "band": [low, high],
        "parameters": list(problem.truth),
    } | {"rows": rows}


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return 0 if the intervals of jaxid hold the truth as they state."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rival_errors")
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")
    parser.add_argument("--draws", type=int, default=200, help="records of each problem (200)")
    options = parser.parse_args(arguments)
    if importlib.util.find_spec("aeroid") is None:
        print("aeroid is not installed: pip install aeroid==0.5.0", file=sys.stderr)
        return 2
    configure()
    results = [measure(name, options.draws) for name in PROBLEMS]
    if options.json:
        print(json.dumps({**machine(), "results": results}))
    else:
        for result in results:
            print(table(result))
    low, high = results[0]["band"]
    shares = [share for one in results for share in one["rows"]["jaxid"]["coverage"]]
    return 0 if all(low <= share <= high for share in shares) else 1


def table(result: dict) -> str:
    """Return the row of one problem as text."""
    low, high = result["band"]
    lines = [f"{result['problem']}: {result['draws']} records, band {low:.3f} to {high:.3f}"]
    lines.append(f"{'':<12}" + "".join(f"{name:>12}" for name in result["parameters"]))
    for library, row in result["rows"].items():
        for key in ("coverage", "bias_in_scatter", "rms_error"):
            cells = "".join(f"{value:>12.3g}" for value in row[key])
            lines.append(f"{library:<12}{cells}  {key}")
        lines.append(
            f"{library:<12}{row['converged']:.1%} converged, "
            f"{1e3 * row['processor_seconds_each']:.0f} ms of processor time each"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
