"""Attainable error: the true model fitted to the records of a study.

This fit also shows whether the records determine the planted effect.
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from benchmarks.missing_effects.scenarios import Flown, Planted, Scenario
from jaxid import LoopOptions, OutputError
from jaxid.effects.base import Effect
from jaxid.estimation.estimate import as_stack
from jaxid.loop.columns import own_parameters
from jaxid.loop.fit import LoopFit, fit
from jaxid.loop.hypothesis import Hypothesis
from jaxid.loop.problem import LoopProblem
from jaxid.loop.search import with_shapes

# Standard deviations by which test errors must exceed the noise to show a missing effect; chosen.
SIGNIFICANT = 5.0


class Reference(NamedTuple):
    """The true model on the records of a study.

    Attributes:
        declared: the declared model's fit.
        chi_square: twice the reduction of the training cost by all planted effects.
        gains: chi-square of each planted gain, for coloured residuals.
        identifiable: whether each is significant at the study's threshold.
        error: mean over the channels of the logarithm of the error on the test records.
        offered: whether the library has each planted effect. One that it lacks is left out of the
            fit, counts as identifiable if the test errors exceed the noise, and has the
            chi-square of this excess; the error is then the error by noise alone.
    """

    declared: LoopFit
    chi_square: float
    gains: tuple[float, ...]
    identifiable: tuple[bool, ...]
    error: float
    offered: tuple[bool, ...] = ()


def problem_of(flown: Flown, library: tuple[Effect, ...], window: int | None) -> LoopProblem:
    """Return the problem of a study by output error.

    Args:
        flown: declared model and records.
        library: candidates.
        window: samples in which initial states are fitted.
    """
    train, check = (as_stack(list(part)) for part in (flown.train, flown.check))
    likelihood = OutputError()
    return LoopProblem.of(flown.model, library, flown.free, likelihood, train, check, window=window)


def reference(
    scenario: Scenario, flown: Flown, library: tuple[Effect, ...], window: int | None
) -> Reference:
    """Fit the declared model and the true model, the latter from the true parameter values.

    Args:
        scenario: scenario with its planted effects.
        flown: its records.
        library: candidates of the study, so that the reference needs no further compilation.
        window: samples in which initial states are fitted.
    """
    declared = fit(problem_of(flown, library, window), Hypothesis())
    problem = with_shapes(declared).problem
    names, start = [], dict(flown.true) if scenario.planted else {}
    candidates = [_candidate(one, library) for one in scenario.planted]
    for one, name in zip(scenario.planted, candidates, strict=True):
        if name is None and not flown.noise:
            raise ValueError(f"the library of candidates has no {one.effect.card.family}")
        if name is None:
            continue
        names.append(name)
        for dotted in own_parameters(problem.effects[name]):
            start[dotted] = float(getattr(one.effect, dotted.rpartition(".")[2]))
    fitted = declared
    if names:
        fitted = fit(problem, Hypothesis(tuple(names)), declared, start)
    threshold = float(chi2.isf(LoopOptions().level / len(library), 1))
    test = as_stack(list(flown.test)).anonymous()
    rms = np.asarray(fitted.predict(test).rms)
    fall = 2.0 * (declared.cost - fitted.cost)
    offered = tuple(name is not None for name in candidates)
    if all(offered):
        gains = tuple(_chi_square(*fitted.estimates[f"{name}.gain"]) for name in names)
        identifiable = tuple(one > threshold for one in gains)
        return Reference(declared, fall, gains, identifiable, mean_log(rms), offered)
    noise = np.asarray(flown.noise)
    excess = test.t.size * float(np.sum((rms / noise) ** 2 - 1.0))
    spread = np.sqrt(2.0 * test.t.size * noise.size)  # standard deviation of white residuals
    gains = tuple(
        excess if name is None else _chi_square(*fitted.estimates[f"{name}.gain"])
        for name in candidates
    )
    identifiable = tuple(
        bool(one > (threshold if has else SIGNIFICANT * spread))
        for one, has in zip(gains, offered, strict=True)
    )
    return Reference(declared, fall, gains, identifiable, mean_log(noise), offered)


def _candidate(one: Planted, library: tuple[Effect, ...]) -> str | None:
    """Return the name of a candidate of the planted effect's family; None if there is none."""
    family = one.effect.card.family
    return next((effect.name for effect in library if effect.card.family == family), None)


def mean_log(rms) -> float:
    """Return the mean over the channels of the logarithm of their errors."""
    return float(np.mean(np.log(np.asarray(list(rms.values()) if isinstance(rms, dict) else rms))))


def _chi_square(value: float, error: float) -> float:
    return float((value / error) ** 2) if error > 0 and np.isfinite(error) else 0.0
