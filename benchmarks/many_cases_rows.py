"""Wall times of `estimate_many` in one process, written line by line; see `many_cases_gpu`."""

import argparse
import dataclasses
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

PROBLEMS = ("spring", "reference")
REPEATS = 3
LONG = 10.0  # a call that takes longer is not repeated [s]
KEPT = 1000  # cases whose estimates are kept for the comparison
NOISE_SEED = 31


class Problem(NamedTuple):
    """Cases of one kind.

    Attributes:
        model, free: as for `estimate_many`.
        record: returns the record of a case by its number.
    """

    model: Any
    free: Any
    record: Callable[[int], Any]


def main() -> None:
    """Measure and write one line for each problem and number of cases."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", help="of the files to write, without ending")
    parser.add_argument("--cores", type=int, nargs="+", required=True)
    parser.add_argument("--cases", type=int, nargs="+", required=True)
    parser.add_argument("--problems", nargs="+", choices=PROBLEMS, required=True)
    parser.add_argument("--samples", type=int, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    options = parser.parse_args()
    os.sched_setaffinity(0, options.cores)  # before JAX makes its threads
    deadline = time.monotonic() + options.seconds

    import jax

    import jaxid

    jaxid.configure()
    devices = jax.devices()
    several = devices if len(devices) > 1 else None
    with Path(f"{options.path}.jsonl").open("w", buffering=1) as file:
        head = {"device": devices[0].device_kind, "backend": jax.default_backend()}
        file.write(json.dumps({**head, "count": len(devices), "jax": jax.__version__}) + "\n")
        for name in options.problems:
            problem = spring() if name == "spring" else reference(options.samples)
            for row in rows(name, problem, options, several, deadline):
                file.write(json.dumps(row) + "\n")


def rows(name: str, problem: Problem, options: argparse.Namespace, devices, deadline: float):
    """Yield one row for each number of cases, smallest first."""
    records, per_case = [], 0.0
    for count in sorted(options.cases):
        row = {"problem": name, "cases": count}
        expected = 1.3 * per_case * count
        if time.monotonic() + expected > deadline:
            yield row | {"reason": f"not measured: it would take about {expected:.0f} s"}
            continue
        records += [problem.record(i) for i in range(len(records), count)]
        try:
            found, dataset = timed(problem, records[:count], devices, deadline)
        except Exception as error:  # out of memory, an operation that the device lacks
            yield row | {"reason": f"{type(error).__name__}: {str(error)[:500]}"}
            continue
        per_case = found["seconds"] / count
        keep(f"{options.path}-{name}.npz", dataset)
        names, numbers = np.unique(dataset.status.values.astype(str), return_counts=True)
        statuses = dict(zip(names.tolist(), numbers.tolist(), strict=True))
        further = {"statuses": statuses, "iterations": float(dataset.iterations.mean())}
        yield row | found | {"ms_per_case": 1e3 * per_case} | further


def timed(problem: Problem, records: list, devices, deadline: float):
    """Return the shortest time of a call that does not compile, and its results."""
    import jaxid

    def call():
        begin = time.perf_counter()
        dataset = jaxid.estimate_many(
            problem.model, problem.free, records, jaxid.OutputError(), devices=devices
        )
        return time.perf_counter() - begin, dataset

    first, dataset = call()
    seconds = []
    while len(seconds) < REPEATS:
        typical = min(seconds, default=first)
        if seconds and (sum(seconds) > LONG or time.monotonic() + typical > deadline):
            break
        seconds.append(call()[0])
    return {"first_seconds": first, "seconds": min(seconds), "repeats": len(seconds)}, dataset


def keep(path: str, dataset) -> None:
    """Write the estimates of the first cases."""
    np.savez(
        path,
        values=dataset["values"].values[:KEPT],
        standard_errors=dataset.standard_errors.values[:KEPT],
        status=dataset.status.values.astype(str)[:KEPT],
    )


def spring() -> Problem:
    """Return the spring of `many_cases`."""
    from benchmarks.many_cases import NOISE, spring_cases

    model, free, (first,) = spring_cases(1)
    return Problem(model, free, noisy(first, np.asarray(first.z), NOISE))


def reference(samples: int) -> Problem:
    """Return the aircraft of the reference problem; its first sample has no noise."""
    from benchmarks.reference_problem import equations
    from benchmarks.reference_problem.aircraft import reference_record, user_free, user_model
    from benchmarks.reference_problem.problem import NOISE, THETA, make_problem

    given = make_problem(samples)
    _, y = equations.simulate(given.constants, given.t, given.u, given.x0, THETA)
    model = user_model(given, given.start)
    level = np.where(np.arange(samples)[:, None] == 0, 0.0, NOISE)
    return Problem(model, user_free(model), noisy(reference_record(given), y, level))


def noisy(record, y: np.ndarray, level) -> Callable[[int], Any]:
    """Return a function of a number: the record with its own noise, its arrays on the host."""
    import jax

    on_host = jax.device_get(record)

    def one(number: int):
        noise = np.random.default_rng([NOISE_SEED, number]).normal(size=y.shape)
        return dataclasses.replace(on_host, z=y + level * noise)

    return one


if __name__ == "__main__":
    main()
