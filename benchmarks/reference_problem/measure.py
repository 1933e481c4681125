"""Agreement and times of the contenders, one row each."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.reference_problem.clocks import CLOCKS, time_in_turns
from benchmarks.reference_problem.contenders import CONTENDERS, REFERENCE, Contender, Program
from benchmarks.reference_problem.first_estimate import measure_first
from benchmarks.reference_problem.gauss_newton import Fitted
from benchmarks.reference_problem.problem import NOISE, ReferenceProblem, make_problem

BASE = "c"  # ratios are to this contender


class Options(NamedTuple):
    """What is measured.

    Attributes:
        only: keys of contenders.
        samples: of the record.
        repeats: of each pass and each fit, at most.
        budget: seconds after which one contender's passes, or fits, are not repeated [s].
        clock: name of the clock.
        first: measure first estimates in new processes too.
    """

    only: Sequence[str]
    samples: int
    repeats: int
    budget: float
    clock: str
    first: bool


def sensitivity_difference(S: np.ndarray, reference: np.ndarray) -> float:
    """Return the largest difference of sensitivities (time, 10, 30).

    Each column (a parameter) is divided by its largest entry in the reference.
    """
    size = np.max(np.abs(reference), axis=(0, 1))
    return float(np.max(np.max(np.abs(S - reference), axis=(0, 1)) / size))


def estimate_difference(fitted: Fitted, reference: Fitted) -> float:
    """Return the largest difference of estimates [standard errors of the reference]."""
    return float(np.max(np.abs(fitted.theta - reference.theta) / reference.errors))


def measure(options: Options) -> list[dict]:
    """Return one row per contender; what cannot be made has a status and no figures."""
    given = make_problem(options.samples)
    rows, programs = {}, {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        reference = REFERENCE.make(given, folder)
        for key in options.only:
            missing = CONTENDERS[key].missing()
            rows[key] = {"key": key, "way": CONTENDERS[key].name, "status": missing}
            if missing is None:
                same = CONTENDERS[key] is REFERENCE
                programs[key] = reference if same else CONTENDERS[key].make(given, folder)
                rows[key] |= agreement(CONTENDERS[key], programs[key], reference, given)
        _add_times(rows, programs, given, options)
    if options.first:
        for key in programs:
            rows[key] |= first_estimates(key, options)
    return [*rows.values()]


def agreement(
    contender: Contender, program: Program, reference: Program, given: ReferenceProblem
) -> dict:
    """Return status, differences from the reference, and misfit.

    The misfit is the RMS of the residuals at the estimates, in standard deviations of the noise.
    """
    difference = sensitivity_difference(
        program.sensitivities(given.start)[1], reference.sensitivities(given.start)[1]
    )
    fitted, expected = program.fit(), reference.fit()
    estimates = estimate_difference(fitted, expected)
    residual = (given.z - program.sensitivities(fitted.theta)[0]) / NOISE
    largest = contender.tolerances(given.t.size)
    agrees = difference <= largest[0] and estimates <= largest[1]
    return {
        "status": "agrees" if agrees and fitted.converged else "differs",
        "sensitivity_difference": difference,
        "estimate_difference": estimates,
        "misfit": float(np.sqrt(np.mean(residual**2))),
        "passes": fitted.passes,
    }


def first_estimates(key: str, options: Options) -> dict:
    """Return time and memory of the cold and the cached first estimate."""
    cold, cached = measure_first(key, options.samples, options.clock)
    return {
        "import_seconds": cold.import_seconds,
        "cold_seconds": cold.seconds,
        "cached_seconds": cached.seconds,
        "megabytes": cold.megabytes,
        "cached_megabytes": cached.megabytes,
    }


def _add_times(
    rows: dict[str, dict],
    programs: dict[str, Program],
    given: ReferenceProblem,
    options: Options,
) -> None:
    """Add the times of a pass and of a fit, and their ratios to C measured in this run."""
    clock = CLOCKS[options.clock]
    for program in programs.values():
        program.evaluate(given.start)  # compiles
    passes = {
        key: lambda program=program: program.evaluate(given.start)
        for key, program in programs.items()
    }
    fits = {key: program.fit for key, program in programs.items()}
    for what, functions in (("pass", passes), ("fit", fits)):
        times = time_in_turns(functions, options.repeats, options.budget, clock)
        for key, taken in times.items():
            base = times[BASE].smallest if BASE in times else None
            rows[key] |= {
                f"{what}_ms": 1e3 * taken.smallest,
                f"{what}_median_ms": 1e3 * taken.median,
                f"{what}_repeats": taken.repeats,
                f"{what}_times_c": None if base is None else taken.smallest / base,
            }
