"""Stepwise regression by partial F, forward, backward or both (Appendix B.2.3), with a log of every step.

The report sweeps the matrix of sums of products by Gauss-Jordan pivots, which squares the condition number of the data. Here
each subset is fitted on the triangle of the problem by orthogonal transformations: the same numbers, with more of their digits.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.types import Float, Numbers
from .fit import Fit, apart, fit, tolerances
from .options import SubsetOptions
from .problem import Problem, prepare
from .regressors import columns
from .selection import Selection, Step, step

DEFAULTS = SubsetOptions()


def stepwise(
    X: Float[Numbers, "time term"],
    y: Float[Numbers, " time"],
    names: Sequence[str],
    *,
    options: SubsetOptions = DEFAULTS,
    weights: Float[Numbers, " time"] | None = None,
    deviations: Float[Numbers, " time"] | None = None,
    constant: bool = True,
    response: str = "y",
) -> Selection:
    """Add and remove terms one at a time.

    Of the terms outside, that of the largest partial correlation with what is left of the response is the one whose F to enter
    (B.30) is the largest too; it enters if that F reaches the level. Before each entry the term of the least F (B.28) is removed
    if it does not reach the level to stay. Every move lowers the sum of squares by more than the levels allow to come back, so
    that no model occurs twice.

    Args:
        X: candidates, shape (time, term).
        y: the response, shape (time,).
        names: of the candidates.
        options: levels and limits; `REPORT` holds those of Table 6.2.
        weights, deviations: of the samples, as in `least_squares`.
        constant: fit a constant in every model.
        response: name of what is explained.

    Returns:
        The path, to be given to `choose`.

    Raises:
        InputError: as `prepare` says (so for more terms than samples can carry, forward too), for names in the options that
            are no candidates, and when terms that are forced in are nearly combinations of each other.
    """
    problem = prepare(X, y, names, weights=weights, deviations=deviations, constant=constant, response=response)
    return path(problem, options)


def stepwise_each(
    responses: Mapping[str, Float[Numbers, " time"]],
    candidates: Mapping[str, Sequence[str]],
    signals: Mapping[str, Float[Numbers, " time"]],
    *,
    centre: Mapping[str, float] | None = None,
    options: SubsetOptions | Mapping[str, SubsetOptions] = DEFAULTS,
    weights: Float[Numbers, " time"] | None = None,
) -> dict[str, Selection]:
    """Stepwise regression of several responses, each on its own candidates.

    Args:
        responses: by name, shape (time,).
        candidates: terms by response.
        signals: what the terms are made of, by name.
        centre: by signal, what is taken from it first.
        options: for all, or by response, the defaults where one is absent.
        weights: of the samples.

    Raises:
        InputError: as `stepwise` and `columns` say, and for a response without candidates.
    """
    require_known("list of candidates for response", responses, candidates)
    terms = tuple(dict.fromkeys(term for name in responses for term in candidates[name]))
    X = columns(terms, signals, centre)
    found = {}
    for name, y in responses.items():
        own = [terms.index(term) for term in candidates[name]]
        rules = options if isinstance(options, SubsetOptions) else options.get(name, DEFAULTS)
        found[name] = stepwise(X[:, own], y, candidates[name], options=rules, weights=weights, response=name)
    return found


def path(problem: Problem, options: SubsetOptions = DEFAULTS) -> Selection:
    """`stepwise` for a problem that is prepared already."""
    options.check(problem.names)
    if options.direction == "there and back":
        there = dataclasses.replace(options, direction="forward", F_in=0.0, F_out=0.0)
        back = dataclasses.replace(options, direction="backward", F_in=float("inf"), F_out=float("inf"))
        return Selection(problem, (*path(problem, there).steps, *path(problem, back).steps))
    steps, active = _start(problem, options)
    barred = {one.name for one in steps if one.action == "bar"}
    while True:
        found = fit(problem, active)
        outside = _outside(problem, options, active)
        for i, tolerance in zip(outside, tolerances(problem, found, outside), strict=True):
            if tolerance < options.tolerance and problem.names[i] not in barred:
                barred.add(problem.names[i])
                steps.append(_barred(problem, options, found, i, float(tolerance)))
        move = _next(problem, options, found, outside)
        if move.action == "enter":
            active = [*active, move.index]
        elif move.action == "remove":
            active = [i for i in active if i != move.index]
        name = "" if move.action == "stop" else problem.names[move.index]
        after = fit(problem, active)
        steps.append(_step(problem, options, after, move.action, name, move.why, F=move.F, tolerance=move.tolerance))
        if move.action == "stop":
            return Selection(problem, tuple(steps))


class _Move(NamedTuple):
    action: str
    why: str
    index: int = -1
    F: float = float("nan")
    tolerance: float = float("nan")


def _start(problem: Problem, options: SubsetOptions) -> tuple[list[Step], list[int]]:
    """The steps before the first choice: nothing, and then what is forced in; or, backward, all that tolerance admits."""
    backward, names = options.direction == "backward", problem.names
    forced = [names.index(name) for name in options.force_in]
    nothing = "the constant alone" if problem.constant else "no term"
    active: list[int] = []
    steps = [] if backward else [_step(problem, options, fit(problem, ()), "start", "", nothing)]
    for i in (*forced, *(_outside(problem, options, forced) if backward else ())):
        found = fit(problem, active)
        tolerance = float(tolerances(problem, found, [i])[0])
        if tolerance < options.tolerance:
            require(
                i not in forced,
                f"The term {names[i]!r} shall be forced in, and its tolerance beside those before it is {tolerance:.2g}, less "
                f"than {options.tolerance:g}. Force it out, or lower the tolerance.",
            )
            steps.append(_barred(problem, options, found, i, tolerance))
            continue
        active.append(i)
        if not backward:
            found = fit(problem, active)
            F = float(found.partial_F[-1])
            steps.append(_step(problem, options, found, "force", names[i], "forced in", F=F, tolerance=tolerance))
    if backward:
        steps.append(_step(problem, options, fit(problem, active), "start", "", "all that tolerance admits"))
    return steps, active


def _next(problem: Problem, options: SubsetOptions, found: Fit, outside: list[int]) -> _Move:
    """What to do from here."""
    forced = {problem.names.index(name) for name in options.force_in}
    free = [place for place, i in enumerate(found.active) if i not in forced]
    if options.direction != "forward" and free:
        F = found.partial_F
        weakest = min(free, key=lambda place: F[place])
        level = options.F_to_stay(found.dof)
        if F[weakest] < level:
            why = f"least F, below {level:.4g}" if np.isfinite(level) else "least F"
            return _Move("remove", why, found.active[weakest], float(F[weakest]))
    if options.direction == "backward":
        return _Move("stop", "every F reaches the level to stay" if free else "no term is left that may be removed")
    if not outside:
        return _Move("stop", "no candidate is left")
    if options.max_terms is not None and len(found.active) >= options.max_terms:
        return _Move("stop", f"the model has max_terms = {options.max_terms}")
    if problem.rounding >= found.SSE:
        return _Move("stop", "the residual is nothing but rounding")
    if options.R2_stop <= 1.0 - found.SSE / problem.SST:
        return _Move("stop", f"R2 has reached {options.R2_stop:g}")
    return _entry(problem, options, found, outside)


def _entry(problem: Problem, options: SubsetOptions, found: Fit, outside: list[int]) -> _Move:
    """The term that enters, or why none does."""
    own = apart(problem, found, outside)
    tolerance = np.sum(own**2, axis=0)
    F = _F_to_enter(problem, found, own, tolerance)
    admitted = np.flatnonzero(tolerance >= options.tolerance)
    if not admitted.size:
        return _Move("stop", f"no candidate left has a tolerance of {options.tolerance:g}")
    best = admitted[np.argmax(F[admitted])]
    level = options.F_to_enter(found.dof - 1)
    name = problem.names[outside[best]]
    if F[best] < level:
        return _Move("stop", f"the largest F to enter is {F[best]:.4g}, of {name}, below {level:.4g}")
    why = f"largest F to enter, at least {level:.4g}"
    return _Move("enter", why, outside[best], float(F[best]), float(tolerance[best]))


def _F_to_enter(problem: Problem, found: Fit, own: np.ndarray, tolerance: np.ndarray) -> np.ndarray:
    """F to enter of each outside column: what it takes from the sum of squares over what it leaves (B.21, B.30)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = found.rest @ own / tolerance
        left = np.sum((found.rest[:, None] - own * share) ** 2, axis=0)
        return share**2 * tolerance / (left / (found.dof - 1))


def _outside(problem: Problem, options: SubsetOptions, active: Sequence[int]) -> list[int]:
    names = problem.names
    return [i for i in range(len(names)) if i not in active and names[i] not in options.force_out]


def _step(problem: Problem, options: SubsetOptions, found: Fit, action: str, name: str, why: str, **of_term) -> Step:
    return step(problem, found, action, name, why, PSE_bound=options.PSE_bound, **of_term)


def _barred(problem: Problem, options: SubsetOptions, found: Fit, index: int, tolerance: float) -> Step:
    why = f"nearly a combination of the terms inside: its tolerance is below {options.tolerance:g}"
    why = why if problem.varies[index] else "does not vary in these samples"
    return _step(problem, options, found, "bar", problem.names[index], why, tolerance=tolerance)
