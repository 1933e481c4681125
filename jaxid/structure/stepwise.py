"""Stepwise regression by partial F, forward, backward or both (Appendix B.2.3), with a log.

The report sweeps the matrix of sums of products by Gauss-Jordan pivots, which squares the condition
number of the data. Here each subset is fitted on the triangle of the problem by orthogonal
transformations, with the same results and smaller rounding errors.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.types import Float, Numbers
from .fit import Fit, fit, orthogonal_parts, tolerances
from .options import Direction, SubsetOptions
from .problem import Problem, prepare
from .regressors import columns
from .selection import Action, Selection, Step, step

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
    """Return the path of stepwise regression, which adds and removes terms one at a time.

    The candidate with the largest partial correlation with the residual also has the largest F to
    enter (B.30); it enters if that F reaches the level. Before each entry the term with the least F
    (B.28) is removed if its F does not reach the level to stay. No model occurs twice, because an
    entry lowers the sum of squares by more than a removal at the lower level can increase it.

    Args:
        X: candidates, shape (time, term).
        y: the response, shape (time,).
        names: names of the candidates.
        options: levels and limits; `REPORT` has the values of Table 6.2.
        weights, deviations: weights or noise of the samples, see `least_squares`.
        constant: fit a constant in every model.
        response: name of the response.

    Returns:
        The path, for `choose`.

    Raises:
        InputError: see `prepare` (also forward, fewer samples than a fit of all terms needs are
            refused); for names in the options that are not candidates, and if forced terms are
            nearly linearly dependent.
    """
    problem = prepare(
        X, y, names, weights=weights, deviations=deviations, constant=constant, response=response
    )
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
    """Return the paths of stepwise regression of several responses with separate candidates.

    Args:
        responses: responses by name, shape (time,).
        candidates: terms by response.
        signals: signals of the terms, by name.
        centre: value subtracted from each signal, by name.
        options: options of all responses, or by response, with the defaults for an absent response.
        weights: weights of the samples.

    Raises:
        InputError: see `stepwise` and `columns`; and for a response without candidates.
    """
    require_known("list of candidates for response", responses, candidates)
    if not isinstance(options, SubsetOptions):
        require_known("response (in `options`)", options, responses)
    terms = tuple(dict.fromkeys(term for name in responses for term in candidates[name]))
    X = columns(terms, signals, centre)
    selections = {}
    for name, y in responses.items():
        positions = [terms.index(term) for term in candidates[name]]
        rules = options if isinstance(options, SubsetOptions) else options.get(name, DEFAULTS)
        selections[name] = stepwise(
            X[:, positions], y, candidates[name], options=rules, weights=weights, response=name
        )
    return selections


def path(problem: Problem, options: SubsetOptions = DEFAULTS) -> Selection:
    """Return the path of `stepwise` for a prepared problem."""
    options.check(problem.names)
    if options.direction is Direction.FORWARD_THEN_BACKWARD:
        forward = dataclasses.replace(options, direction=Direction.FORWARD, F_in=0.0, F_out=0.0)
        backward = dataclasses.replace(
            options, direction=Direction.BACKWARD, F_in=float("inf"), F_out=float("inf")
        )
        return Selection(problem, (*path(problem, forward).steps, *path(problem, backward).steps))
    steps, active = _start(problem, options)
    while True:
        fitted = fit(problem, active)
        outside = _outside(problem, options, active)
        steps += _bar_steps(problem, options, fitted, outside, steps)
        move = _next(problem, options, fitted, outside)
        if move.action is Action.ENTER:
            active = [*active, move.index]
        elif move.action is Action.REMOVE:
            active = [i for i in active if i != move.index]
        name = "" if move.action is Action.STOP else problem.names[move.index]
        fitted = fit(problem, active)
        values = {"F": move.F, "tolerance": move.tolerance}
        steps.append(_step(problem, options, fitted, move.action, name, move.reason, **values))
        if move.action is Action.STOP:
            return Selection(problem, tuple(steps))


def _bar_steps(
    problem: Problem, options: SubsetOptions, fitted: Fit, outside: list[int], steps: Sequence[Step]
) -> list[Step]:
    """Return the steps that bar outside terms with a tolerance below the limit, each term once."""
    barred = {earlier.name for earlier in steps if earlier.action is Action.BAR}
    return [
        _barred(problem, options, fitted, i, float(tolerance))
        for i, tolerance in zip(outside, tolerances(problem, fitted, outside), strict=True)
        if tolerance < options.tolerance and problem.names[i] not in barred
    ]


class _Move(NamedTuple):
    """The next action on a model: `ENTER`, `REMOVE` or `STOP`; fields as in `Step`."""

    action: Action
    reason: str
    index: int = -1
    F: float = float("nan")
    tolerance: float = float("nan")


def _start(problem: Problem, options: SubsetOptions) -> tuple[list[Step], list[int]]:
    """Return the steps before the first choice, and the numbers of the terms after them.

    Forward the model starts empty and forced terms are added; backward it starts with all terms of
    sufficient tolerance.
    """
    backward, names = options.direction is Direction.BACKWARD, problem.names
    forced = [names.index(name) for name in options.force_in]
    empty = "only the constant" if problem.constant else "no term"
    active: list[int] = []
    steps = [] if backward else [_step(problem, options, fit(problem, ()), Action.START, "", empty)]
    for i in (*forced, *(_outside(problem, options, forced) if backward else ())):
        fitted = fit(problem, active)
        tolerance = float(tolerances(problem, fitted, [i])[0])
        if tolerance < options.tolerance:
            require(
                i not in forced,
                f"The term {names[i]!r} shall be forced in, and its tolerance with the terms "
                f"before it is {tolerance:.2g}, less than {options.tolerance:g}. Force it out, or "
                "lower the tolerance.",
            )
            steps.append(_barred(problem, options, fitted, i, tolerance))
            continue
        active.append(i)
        if not backward:
            fitted = fit(problem, active)
            values = {"F": float(fitted.partial_F[-1]), "tolerance": tolerance}
            steps.append(
                _step(problem, options, fitted, Action.FORCE, names[i], "forced in", **values)
            )
    if backward:
        reason = "all terms of sufficient tolerance"
        steps.append(_step(problem, options, fit(problem, active), Action.START, "", reason))
    return steps, active


def _next(problem: Problem, options: SubsetOptions, fitted: Fit, outside: list[int]) -> _Move:
    """Return the next move from a model."""
    removal = None if options.direction is Direction.FORWARD else _removal(problem, options, fitted)
    if removal is not None:
        return removal
    if options.direction is Direction.BACKWARD:
        free = _removable(problem, options, fitted)
        return _Move(
            Action.STOP,
            "every F reaches the level to stay" if free else "no term is left that may be removed",
        )
    enough = _enough(problem, options, fitted, outside)
    return (
        _entry(problem, options, fitted, outside) if enough is None else _Move(Action.STOP, enough)
    )


def _removal(problem: Problem, options: SubsetOptions, fitted: Fit) -> _Move | None:
    """Return the removal of the term with the least F; None if that F reaches the level to stay."""
    free = _removable(problem, options, fitted)
    if not free:
        return None
    F = fitted.partial_F
    weakest = min(free, key=lambda position: F[position])
    level = options.F_to_stay(fitted.dof)
    if not F[weakest] < level:
        return None
    reason = f"least F, below {level:.4g}" if np.isfinite(level) else "least F"
    return _Move(Action.REMOVE, reason, fitted.active[weakest], float(F[weakest]))


def _removable(problem: Problem, options: SubsetOptions, fitted: Fit) -> list[int]:
    """Return the positions in the model of the terms that are not forced in."""
    forced = {problem.names.index(name) for name in options.force_in}
    return [position for position, i in enumerate(fitted.active) if i not in forced]


def _enough(
    problem: Problem, options: SubsetOptions, fitted: Fit, outside: list[int]
) -> str | None:
    """Return the reason to stop before another entry; None without such a reason."""
    if not outside:
        return "no candidate is left"
    if options.max_terms is not None and len(fitted.active) >= options.max_terms:
        return f"the model has max_terms = {options.max_terms}"
    if problem.rounding >= fitted.SSE:
        return "the residual is rounding error"
    if options.R2_stop <= 1.0 - fitted.SSE / problem.SST:
        return f"R2 has reached {options.R2_stop:g}"
    return None


def _entry(problem: Problem, options: SubsetOptions, fitted: Fit, outside: list[int]) -> _Move:
    """Return the entry of a term, or the stop with its reason."""
    orthogonal = orthogonal_parts(problem, fitted, outside)
    tolerance = np.sum(orthogonal**2, axis=0)
    F = _F_to_enter(fitted, orthogonal, tolerance)
    admitted = np.flatnonzero(tolerance >= options.tolerance)
    if not admitted.size:
        return _Move(
            Action.STOP, f"no remaining candidate has a tolerance of {options.tolerance:g}"
        )
    best = admitted[np.argmax(F[admitted])]
    level = options.F_to_enter(fitted.dof - 1)
    name = problem.names[outside[best]]
    if F[best] < level:
        return _Move(
            Action.STOP, f"the largest F to enter is {F[best]:.4g}, of {name}, below {level:.4g}"
        )
    reason = f"largest F to enter, at least {level:.4g}"
    return _Move(Action.ENTER, reason, outside[best], float(F[best]), float(tolerance[best]))


def _F_to_enter(fitted: Fit, orthogonal: np.ndarray, tolerance: np.ndarray) -> np.ndarray:
    """Return the F to enter of each outside column (B.21, B.30).

    F is the reduction of the sum of squares over the residual variance after it. `orthogonal` holds
    the parts of the columns orthogonal to the model, and `tolerance` their squared lengths. It
    equals `r^2 dof / (1 - r^2)` with r the partial correlation and `dof` counted with the term in
    the model; the report's `m - q` is larger by one, which is corrected here.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        value = fitted.residual @ orthogonal / tolerance
        SSE = np.sum((fitted.residual[:, None] - orthogonal * value) ** 2, axis=0)
        return value**2 * tolerance / (SSE / (fitted.dof - 1))


def _outside(problem: Problem, options: SubsetOptions, active: Sequence[int]) -> list[int]:
    names = problem.names
    return [i for i in range(len(names)) if i not in active and names[i] not in options.force_out]


def _step(
    problem: Problem,
    options: SubsetOptions,
    fitted: Fit,
    action: Action,
    name: str,
    reason: str,
    **of_term,
) -> Step:
    return step(problem, fitted, action, name, reason, PSE_bound=options.PSE_bound, **of_term)


def _barred(
    problem: Problem, options: SubsetOptions, fitted: Fit, index: int, tolerance: float
) -> Step:
    reason = "does not vary in these samples"
    if problem.varies[index]:
        limit = f"its tolerance is below {options.tolerance:g}"
        reason = f"nearly a combination of the model's terms: {limit}"
    return _step(
        problem, options, fitted, Action.BAR, problem.names[index], reason, tolerance=tolerance
    )
