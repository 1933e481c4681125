"""Many short cases with planted failures, in a run that is killed and resumed:
`python -m benchmarks.many_cases_planted [--json]`.

A lag with a destabilising cubic, 60 samples. Of the cases, 3 % fail: a sample that is not a number,
an input under which the model diverges, and an input of zero, which does not show its gain. One
process runs undisturbed into one store; others run into another store and are killed with SIGKILL
at random moments until the last one ends. The stores are compared, each healthy case with its
single estimate, and each status with the planted failure.
"""

import argparse
import dataclasses
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxid

ROOT = Path(__file__).resolve().parents[1]
SAMPLES, STEP, NOISE, CUBIC = 60, 0.1, 0.02, 0.05
EVERY = 100  # of as many cases one fails in each of the three ways
HEALTHY = "successful"
EXPECTED = {"not_a_number": "refused", "diverging": "start_diverges", "silent": "undetermined"}
COMPARED = ("values", "standard_errors", "covariance", "own", "own_errors", "cost", "noise")


class Lag(jaxid.AbstractModel):
    """`dx/dt = -p x + cubic x^3 + b u`."""

    p: jax.Array
    b: jax.Array
    cubic: jax.Array
    states, inputs, outputs = ("x",), ("u",), ("x",)

    def rhs(self, t, x, u):
        return -self.p * x + self.cubic * x**3 + self.b * u

    def output(self, t, x, u):
        return x


class Planted(NamedTuple):
    """Cases with the failures that were planted.

    Attributes:
        model, free: as for `estimate_many`.
        records: one for each case.
        kinds: the name of the failure of each case, or `HEALTHY`.
    """

    model: Lag
    free: jaxid.Free
    records: list[jaxid.Record]
    kinds: np.ndarray


def planted_cases(count: int, seed: int = 1) -> Planted:
    """Return the cases; each of the three failures has one case of a hundred, at least one."""
    rng = np.random.default_rng(seed)
    kinds = np.full(count, HEALTHY, object)
    each = max(count // EVERY, 1)
    failing = rng.choice(count, 3 * each, replace=False).reshape(3, each)
    for kind, chosen in zip(EXPECTED, failing, strict=True):
        kinds[chosen] = kind
    t = STEP * np.arange(SAMPLES)
    u = np.sin(np.outer(rng.uniform(0.5, 2.0, count), t))
    silent = kinds == "silent"
    u[silent] = 0.0
    theta = rng.uniform([1.0, 0.5], [2.0, 1.5], (count, 2))
    z = simulated(theta, u, np.where(silent, 1.0, 0.0)) + NOISE * rng.normal(size=u.shape)
    u[kinds == "diverging"] = 1e6
    first = jaxid.record(t, u[0], z[0], inputs=("u",), outputs=("x",))
    z[kinds == "not_a_number", 7] = np.nan  # `jaxid.record` would take it as a missing sample
    records = [
        dataclasses.replace(
            first, u=jnp.asarray(u[i, :, None]), z=jnp.asarray(z[i, :, None]), names=(f"lag {i}",)
        )
        for i in range(count)
    ]
    model = Lag(1.0, 0.7, CUBIC)
    free = jaxid.free(model, "p", "b", per_record=("initial_state",), bounds={"p": (0.1, 10.0)})
    return Planted(model, free, records, kinds)


def simulated(theta: np.ndarray, u: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the outputs of all cases, shape (case, time), by the classical Runge-Kutta method."""

    def rate(x, u):
        return -theta[:, 0] * x + CUBIC * x**3 + theta[:, 1] * u

    columns = [x]
    for before, after in zip(u.T[:-1], u.T[1:], strict=True):
        middle = (before + after) / 2
        k1 = rate(x, before)
        k2 = rate(x + STEP / 2 * k1, middle)
        k3 = rate(x + STEP / 2 * k2, middle)
        k4 = rate(x + STEP * k3, after)
        x = x + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        columns.append(x)
    return np.stack(columns, axis=1)


def run(cases: Planted, store: Path | None = None, **options):
    """Return the results of the batch."""
    return jaxid.estimate_many(
        cases.model, cases.free, cases.records, jaxid.OutputError(), store=store, **options
    )


def largest_difference_from_singles(cases: Planted, results, count: int) -> float:
    """Return the largest difference of the first healthy cases from their single estimates.

    It is relative, but for parameters of a record, which may be zero: theirs is in standard errors.
    """
    worst = 0.0
    for i in np.flatnonzero(cases.kinds == HEALTHY)[:count]:
        alone = jaxid.estimate(cases.model, cases.free, cases.records[i], jaxid.OutputError())
        for name in COMPARED:
            ours, theirs = results[name].values[i], np.asarray(getattr(alone, name))
            size = np.asarray(alone.own_errors) if name == "own" else np.abs(theirs)
            worst = np.maximum(worst, np.max(np.abs(ours - theirs) / size))  # NaN remains
    return float(worst)


def wrong_statuses(cases: Planted, results) -> list[str]:
    """Return the cases whose status is not the planted one, or that carry no reason."""
    status, reason = results.status.values, results.reason.values
    return [
        f"{results.name.values[i]}: {kind}, {status[i]}"
        for i, kind in enumerate(cases.kinds)
        if status[i] != EXPECTED.get(kind, HEALTHY) or not reason[i]
    ]


def largest_difference(one, other) -> float:
    """Return the largest relative difference of two stores; infinite where words differ."""
    worst = 0.0
    for name in one.variables:
        first, second = one[name].values, other[name].values
        if first.dtype != float:
            worst = worst if np.array_equal(first, second) else np.inf
        elif not np.array_equal(first, second, equal_nan=True):
            if not np.array_equal(np.isfinite(first), np.isfinite(second)):
                return np.inf
            change = np.abs(first - second) / np.maximum(np.abs(first), 1e-5)
            worst = max(worst, float(np.nanmax(np.where(np.isfinite(change), change, 0.0))))
    return worst


def start(store: Path, count: int) -> subprocess.Popen:
    """Start a process that runs the batch and prints a line whenever cases have ended."""
    command = [sys.executable, "-m", __spec__.name, "--store", str(store), "--cases", str(count)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)


def killed(store: Path, count: int, longest: float) -> bool:
    """Return True for a run that was killed at a random moment after its first cases have ended."""
    with start(store, count) as process:
        assert process.stdout is not None
        process.stdout.readline()
        try:
            process.communicate(timeout=random.Random().uniform(0.0, longest))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
    return process.returncode == -signal.SIGKILL


def measure(options: argparse.Namespace) -> dict:
    """Return the figures of the comparison."""
    import xarray as xr

    def read(path):
        return xr.open_zarr(path, consolidated=False, chunks=None).load()

    cases = planted_cases(options.cases)
    with tempfile.TemporaryDirectory() as folder:
        undisturbed, disturbed = Path(folder) / "undisturbed", Path(folder) / "disturbed"
        begin = time.monotonic()
        run(cases, undisturbed)
        seconds = time.monotonic() - begin
        done = []
        for _ in range(options.kills):
            if killed(disturbed, options.cases, seconds / (options.kills + 1)):
                done.append(int(np.sum(read(disturbed).status.values != "unfinished")))
        run(cases, disturbed)
        results, other = read(undisturbed), read(disturbed)
    return {
        "cases": options.cases,
        "seconds": seconds,
        "statuses": {name: int(np.sum(results.status.values == name)) for name in statuses()},
        "wrong": wrong_statuses(cases, results),
        "finished_when_killed": done,
        "stores_differ_by": largest_difference(results, other),
        "singles": options.singles,
        "singles_differ_by": largest_difference_from_singles(cases, results, options.singles),
    }


def statuses() -> tuple[str, ...]:
    """Return the names of the expected statuses."""
    return (HEALTHY, *EXPECTED.values())


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print one object; with `--store`, run the batch alone."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--singles", type=int, default=10_000, help="single estimates to compare")
    parser.add_argument("--kills", type=int, default=3)
    parser.add_argument("--store", type=Path, help="run the batch into this store, and no more")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    jaxid.configure()
    if options.store is not None:
        run(
            planted_cases(options.cases),
            options.store,
            progress=lambda state: print(state.finished, flush=True),
        )
        return
    result = measure(options)
    print(json.dumps(result) if options.json else "\n".join(f"{k}: {v}" for k, v in result.items()))


if __name__ == "__main__":
    main()
