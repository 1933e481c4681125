"""Share of 95 % intervals that contain the truth: `python -m benchmarks.coverage [--json]
[--draws 2000] [--only NAME ...]`.

Each case simulates many records of a known system, estimates from all of them in one program, and
counts for each parameter the intervals `value -/+ 1.96 standard errors` that contain the truth. A
correct share lies within the band with 99.9 % probability, Bonferroni over the parameters of the
case.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import expm
from scipy.stats import binom

from benchmarks.reference_problem.__main__ import machine
from jaxid import AbstractModel, FilterError, FirstOrder, GaussNewton, OutputError, Record, free
from jaxid._foundation.types import Array
from jaxid.estimation.estimate import estimate

WIDTH, LEVEL = 1.959963984540054, 0.95
SPEED, STEP = 50.0, 0.05  # m/s, s
NOISE = {"alpha": 0.004, "q": 0.004}  # rad, rad/s
GUST, GUST_TIME = 1.0, 0.6  # m/s, s
DERIVATIVES = {"Zw": -1.0, "Mw": -0.1, "Mq": -1.5, "Md": -8.0}
INITIAL = np.array([0.5, 0.02])  # m/s, rad/s


class ShortPeriod(AbstractModel):
    """The short period of a small aircraft, in vertical gusts if they are among the inputs.

    dw/dt = Zw (w - gust) + V q,    dq/dt = Mw (w - gust) + Mq q + Md elevator
    alpha = (w - gust) / V
    """

    Zw: Array
    Mw: Array
    Mq: Array
    Md: Array
    gusts: tuple[str, ...] = eqx.field(static=True, default=())
    states, outputs = ("w", "q"), ("alpha", "q")

    @property
    def inputs(self):
        return ("elevator", *self.gusts)

    def rhs(self, t, x, u):
        w = self._relative(x, u)
        return jnp.stack(
            [self.Zw * w + SPEED * x[1], self.Mw * w + self.Mq * x[1] + self.Md * u[0]]
        )

    def output(self, t, x, u):
        return jnp.stack([self._relative(x, u) / SPEED, x[1]])

    def with_disturbance_inputs(self):
        return ShortPeriod(self.Zw, self.Mw, self.Mq, self.Md, gusts=("gust",))

    def _relative(self, x, u):
        return x[0] - u[1] if self.gusts else x[0]


class Flights(NamedTuple):
    """Records of one manoeuvre under different noise: times, elevator and all measurements."""

    t: np.ndarray
    u: np.ndarray
    z: np.ndarray


class Case(NamedTuple):
    """A case of the benchmark.

    Attributes:
        samples: samples of a record.
        fly: from draws, samples and seed to the records.
        likelihood: the likelihood of the estimates.
        truth: true values by name.
    """

    samples: int
    fly: Callable[[int, int, int], Flights]
    likelihood: Callable
    truth: dict[str, float]


def fly(draws: int, samples: int, seed: int, gust: float) -> Flights:
    """Return records of the short period, exact for the elevator's straight lines.

    Args:
        draws: number of records.
        samples: samples of each record.
        seed: seed of the noise.
        gust: standard deviation of the gust [m/s].
    """
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(samples)
    u = 0.05 * np.sign(np.sin(1.3 * t)) + 0.03 * np.sign(np.sin(3.1 * t + 1.0))
    Zw, Mw, Mq, Md = DERIVATIVES.values()
    # states w, q, gust, elevator and its slope; noise drives the gust
    A = np.zeros((5, 5))
    A[0, :3], A[1, :4] = [Zw, SPEED, -Zw], [Mw, Mq, -Mw, Md]
    A[2, 2], A[3, 4] = -1.0 / GUST_TIME, 1.0
    power = np.zeros((5, 5))
    power[2, 2] = 2.0 / GUST_TIME * gust**2
    block = expm(np.block([[-A, power], [np.zeros((5, 5)), A.T]]) * STEP)
    Phi = block[5:, 5:].T
    noise = (Phi @ block[:5, 5:])[:3, :3]
    values, vectors = np.linalg.eigh(noise)
    factor = vectors * np.sqrt(np.maximum(values, 0.0))
    x = np.zeros((draws, 3))
    x[:, :2], x[:, 2] = INITIAL, gust * rng.normal(size=draws)
    z = np.zeros((draws, samples, 2))
    slopes = np.append(np.diff(u) / STEP, 0.0)
    for i in range(samples):
        z[:, i] = np.stack([(x[:, 0] - x[:, 2]) / SPEED, x[:, 1]], axis=1)
        driven = Phi[:3, 3] * u[i] + Phi[:3, 4] * slopes[i]
        x = x @ Phi[:3, :3].T + driven + rng.normal(size=(draws, 3)) @ factor.T
    z += rng.normal(size=z.shape) * np.array(list(NOISE.values()))
    return Flights(t, u[:, None], z)


def _in_gusts(draws: int, samples: int, seed: int) -> Flights:
    return fly(draws, samples, seed, GUST)


def _in_calm_air(draws: int, samples: int, seed: int) -> Flights:
    return fly(draws, samples, seed, 0.0)


def _filter_error():
    return FilterError(process={"gust": FirstOrder(0.7, 1.0)})


SENSORS = {f"sensor.{name}": size for name, size in NOISE.items()}
GUSTS = {"process.gust": GUST, "correlation_time.gust": GUST_TIME}
CASES = {
    "output error, white noise": Case(300, _in_calm_air, OutputError, DERIVATIVES),
    "filter error, first-order gusts, Q and R estimated": Case(
        2000, _in_gusts, _filter_error, DERIVATIVES | SENSORS | GUSTS
    ),
    "filter error, the same gusts for 30 s": Case(
        600, _in_gusts, _filter_error, DERIVATIVES | SENSORS | GUSTS
    ),
    "output error, the same gusts": Case(2000, _in_gusts, OutputError, DERIVATIVES),
}
# The other cases show the errors of the wrong likelihood, and of asymptotic intervals of the noise
# parameters on a short record.
CLAIMED = tuple(name for name in CASES if "the same gusts" not in name)


class Answer(NamedTuple):
    """Numbers of the estimates of many records."""

    values: np.ndarray
    errors: np.ndarray
    corrected: np.ndarray
    successful: np.ndarray


def estimates(case: Case, flights: Flights) -> Answer:
    """Return the estimates of all records from one call."""
    start = ShortPeriod(*(jnp.asarray(0.8 * value) for value in DERIVATIVES.values()))
    chosen = free(start, *DERIVATIVES, per_record=("initial_state",))
    t, u = jnp.asarray(flights.t), jnp.asarray(flights.u)
    names = (("elevator",), ("alpha", "q"), ("rad",), ("rad", "rad/s"), ("flight",))

    def one(z):
        valid = jnp.ones(z.shape, bool)
        record = Record(t, u, z, valid, {}, *names)
        fit = estimate(start, chosen, record, case.likelihood(), solver=GaussNewton(max_steps=80))
        return Answer(fit.values, fit.standard_errors, fit.corrected_errors, fit.successful)

    # one after the other in one program: each ends when it has converged
    answer = jax.jit(lambda z: jax.lax.map(one, z))(jnp.asarray(flights.z))
    return Answer(*map(np.asarray, answer))


def measure(name: str, draws: int, seed: int = 1974) -> dict:
    """Return the row of one case: shares, their band and the efficiency of each parameter.

    Args:
        name: name of the case.
        draws: number of records.
        seed: seed of the noise.
    """
    case, begin = CASES[name], time.process_time()
    values, errors, corrected, good = estimates(case, case.fly(draws, case.samples, seed))
    truth = np.array(list(case.truth.values()))
    low, high = band(draws, truth.size)
    rows = [
        {
            "parameter": parameter,
            "truth": case.truth[parameter],
            "coverage": _share(values, errors, truth)[at],
            "corrected_coverage": _share(values, corrected, truth)[at],
            "bias_in_scatter": float((values[:, at].mean() - truth[at]) / values[:, at].std()),
            "efficiency": float(values[:, at].var() / np.nanmean(errors[:, at] ** 2)),
        }
        for at, parameter in enumerate(case.truth)
    ]
    shares = [row["coverage"] for row in rows]
    return {
        "case": name,
        "draws": draws,
        "samples": case.samples,
        "converged": float(good.mean()),
        "band": [low, high],
        "inside": bool(all(low <= share <= high for share in shares)),
        "claimed": name in CLAIMED,
        "processor_seconds": time.process_time() - begin,
        "rows": rows,
    }


def band(draws: int, parameters: int) -> tuple[float, float]:
    """Return the shares that a correct interval meets with 99.9 % probability."""
    tail = 0.0005 / parameters
    low, high = binom.ppf([tail, 1.0 - tail], draws, LEVEL) / draws
    return float(low), float(high)


def _share(values, errors, truth) -> list[float]:
    """Return for each parameter the share of intervals that contain the truth.

    A parameter on its bound has no interval, and counts as one that does not contain it.
    """
    return [float(share) for share in np.mean(np.abs(values - truth) < WIDTH * errors, axis=0)]


def table(row: dict) -> str:
    """Return the row of one case as text."""
    low, high = row["band"]
    lines = [
        f"{row['case']}: {row['draws']} draws of {row['samples']} samples, "
        f"{row['converged']:.1%} converged, band {low:.2%} to {high:.2%}, "
        f"{row['processor_seconds']:.0f} s",
        f"{'parameter':<24}{'truth':>9}{'coverage':>10}{'bias':>8}{'efficiency':>12}",
    ]
    for entry in row["rows"]:
        mark = "" if low <= entry["coverage"] <= high else "  outside"
        lines.append(
            f"{entry['parameter']:<24}{entry['truth']:>9g}{entry['coverage']:>10.2%}"
            f"{entry['bias_in_scatter']:>8.2f}{entry['efficiency']:>12.3f}{mark}"
        )
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return 0 if every claimed share lies inside its band."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.coverage", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")
    parser.add_argument("--draws", type=int, default=2000, help="records of each case (2000)")
    parser.add_argument("--only", nargs="+", choices=tuple(CASES), help="cases, all by default")
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    rows = []
    for name in options.only or CASES:
        rows.append(measure(name, options.draws))
        if not options.json:
            print(table(rows[-1]), flush=True)
    inside = all(row["inside"] for row in rows if row["claimed"])
    if options.json:
        status = "inside" if inside else "outside"
        print(json.dumps({"status": status, "level": LEVEL, **machine(), "rows": rows}))
    else:
        print("bias in units of the scatter; efficiency: variance over the mean of the bounds")
    return 0 if inside else 1


if __name__ == "__main__":
    sys.exit(main())
