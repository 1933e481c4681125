"""Growth of jaxid's pass with the numbers of parameters, samples and records.

time ~ size^exponent, by least squares of the logarithms over all sizes
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

import jaxid
from benchmarks.reference_problem import problem
from benchmarks.reference_problem.aircraft import reference_record, user_free, user_model
from benchmarks.reference_problem.clocks import time_in_turns
from benchmarks.reference_problem.identification import package_model
from benchmarks.reference_problem.problem import ReferenceProblem, make_problem
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.problem import Problem
from jaxid.models.free import initial_parameters

# Terms that a larger polynomial has beside those of the problem, in the order in which they enter.
EXTRA = tuple(
    f"{power} {signal}"
    for power in ("alpha", "alpha^2", "alpha^3")
    for signal in ("beta", "phat", "qhat", "rhat", "stabilator", "aileron", "rudder")
)
# Samples of each of many records, over the same 15 s.
RECORD_SAMPLES = 151


class Sizes(NamedTuple):
    """Sizes at which the pass is measured."""

    parameters: Sequence[int]
    samples: Sequence[int]
    records: Sequence[int]


FULL = Sizes((15, 30, 60, 120), (300, 1000, 3000, 10000, 50000), (1, 8, 64, 512))
QUICK = Sizes((15, 30), (300, 1000), (1, 4))


def growth(sizes: Sizes, samples: int, repeats: int, clock: Callable[[], float]) -> list[dict]:
    """Return for each size the time of a pass, and for each kind the exponent.

    Args:
        sizes: numbers of parameters (of `IdentificationModel`), samples and records (of the user's
            model).
        samples: of the record on which the parameters vary.
        repeats: of each pass.
        clock: one of `clocks.CLOCKS`.
    """
    given = make_problem(samples)
    kinds = {
        "parameters": lambda size: with_parameters(given, size),
        "samples": lambda size: with_samples(size),
        "records": lambda size: with_records(size),
    }
    rows = []
    for kind, make in kinds.items():
        points = getattr(sizes, kind)
        times = [_pass_seconds(make(size), repeats, clock) for size in points]
        rows.append(
            {
                "kind": kind,
                "sizes": list(points),
                "pass_ms": [1e3 * taken for taken in times],
                "exponent": exponent(points, times),
            }
        )
    return rows


def exponent(sizes: Sequence[float], times: Sequence[float]) -> float:
    """Return the slope of the logarithm of the time over that of the size."""
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])


def with_parameters(given: ReferenceProblem, count: int) -> Problem:
    """Return the problem of the package's aircraft with so many free coefficients.

    Up to 30 they are evenly chosen among those of the problem; beyond, each polynomial has further
    terms, whose coefficients are zero.
    """
    names = len(problem.NAMES)
    further, rest = divmod(max(count - names, 0), len(problem.TRUE))
    if rest or further > len(EXTRA):
        raise ValueError(f"{count} parameters: give {names} and a multiple of {len(problem.TRUE)}.")
    model = package_model(given, problem.THETA, EXTRA[:further])
    chosen = problem.NAMES
    if count < names:
        chosen = tuple(chosen[i * names // count] for i in range(count))
    added = tuple(f"{name}.{term}" for name in problem.TRUE for term in EXTRA[:further])
    free = jaxid.free(model, *chosen, *added)
    return Problem.of(model, free, as_stack(reference_record(given)), jaxid.OutputError())


def with_samples(count: int) -> Problem:
    """Return the user's problem with so many samples in the same 15 s."""
    return _user_problem(make_problem(count), 1)


def with_records(count: int) -> Problem:
    """Return the user's problem with so many records of 151 samples, of equal content."""
    return _user_problem(make_problem(RECORD_SAMPLES), count)


def _user_problem(given: ReferenceProblem, records: int) -> Problem:
    model = user_model(given, problem.THETA)
    stack = as_stack([reference_record(given)] * records)
    return Problem.of(model, user_free(model), stack, jaxid.OutputError())


def _pass_seconds(given: Problem, repeats: int, clock: Callable[[], float]) -> float:
    """Return the smallest time of a pass at the model's own parameters [s]."""
    begin = initial_parameters(given.model, given.positions, given.records)
    evaluate = eqx.filter_jit(lambda given, at: given.evaluate(at))

    def run():
        return jax.block_until_ready(evaluate(given, begin))

    run()
    return time_in_turns({"": run}, repeats, 10.0, clock)[""].smallest
