"""The best subset of each size: by exhaustive search for few candidates, else by exchange."""

import itertools
from collections.abc import Sequence

import numpy as np

from .._foundation.checks import require
from .._foundation.types import Float, Numbers
from .fit import fit
from .problem import Problem, prepare
from .selection import Action, Selection, step

EXHAUSTIVE_LIMIT = 15  # candidates (chosen): 32768 subsets, about one second


def best_subsets(
    X: Float[Numbers, "time term"],
    y: Float[Numbers, " time"],
    names: Sequence[str],
    *,
    max_terms: int | None = None,
    exhaustive: int = EXHAUSTIVE_LIMIT,
    PSE_bound: float | None = None,
    weights: Float[Numbers, " time"] | None = None,
    constant: bool = True,
    response: str = "y",
) -> Selection:
    """Return the model with the least sum of squares for each number of terms, for `choose`.

    For few candidates every subset is tried. Otherwise the model of each size starts from the next
    smaller model plus the best addition, then from the next larger model minus the best omission,
    and single terms are exchanged for candidates outside the model while that lowers the sum of
    squares. This finds many pairs of terms that are only useful together and that stepwise
    regression misses, but not with certainty.

    Args:
        X: candidates, shape (time, term).
        y: the response, shape (time,).
        names: names of the candidates.
        max_terms: largest size; all candidates by default.
        exhaustive: largest number of candidates for which every subset is tried.
        PSE_bound: see `SubsetOptions`.
        weights: weights of the samples.
        constant: fit a constant in every model.
        response: name of the response.

    Raises:
        InputError: see `prepare`; and for a `max_terms` below one.

    (Miller, Subset Selection in Regression, 2002, sections 3.2 and 3.4.)
    """
    problem = prepare(X, y, names, weights=weights, constant=constant, response=response)
    count = len(problem.names)
    largest = count if max_terms is None else min(max_terms, count)
    require(largest >= 1, f"max_terms is {max_terms}. Allow at least one term.")
    if count <= exhaustive:
        subsets, reason = _all_best(problem, largest), "best subset of its size"
    else:
        subsets, reason = _by_exchange(problem, largest), "best subset of its size by exchange"
    fitted = fit(problem, ())
    steps = [step(problem, fitted, Action.START, reason="no term", PSE_bound=PSE_bound)]
    for active in subsets:
        fitted = fit(problem, active)
        steps.append(step(problem, fitted, Action.SUBSET, reason=reason, PSE_bound=PSE_bound))
    if problem.rounding >= fitted.SSE:
        reason = "the residual is rounding error"
        steps.append(step(problem, fitted, Action.STOP, reason=reason, PSE_bound=PSE_bound))
    elif len(subsets) < largest:
        reason = f"any {len(subsets) + 1} columns are combinations of each other"
        steps.append(step(problem, fitted, Action.STOP, reason=reason, PSE_bound=PSE_bound))
    return Selection(problem, tuple(steps))


def _all_best(problem: Problem, largest: int) -> list[list[int]]:
    """Return the best of all subsets of each size.

    The list ends with an exact fit, or before the size at which every subset is linearly dependent.
    """
    best = []
    for size in range(1, largest + 1):
        subsets = np.array(list(itertools.combinations(range(len(problem.names)), size)))
        active, least = _best(problem, subsets)
        if not np.isfinite(least):
            return best
        best.append(active)
        if least <= problem.rounding:
            return best
    return best


def _by_exchange(problem: Problem, largest: int) -> list[list[int]]:
    """Return a subset of each size, by forward addition to all columns and backward omission.

    Some pairs of terms are only reached by omission.
    """
    subsets = _forward(problem)
    for size in range(len(subsets) - 1, 0, -1):
        larger = subsets[size][0]
        reduced = np.array([[i for i in larger if i != omitted] for omitted in larger])
        backward = _exchange(problem, *_best(problem, reduced))
        subsets[size - 1] = min(subsets[size - 1], backward, key=lambda subset: subset[1])
    exact = next(
        (size for size, (_, SSE) in enumerate(subsets) if problem.rounding >= SSE), len(subsets)
    )
    return [active for active, _ in subsets[: min(exact + 1, largest)]]


def _forward(problem: Problem) -> list[tuple[list[int], float]]:
    """Return a subset of each size and its sum of squares, by the best addition to the smaller one.

    The list ends with an exact fit, or before the size at which every subset is linearly dependent.
    """
    subsets: list[tuple[list[int], float]] = []
    active: list[int] = []
    for _ in problem.names:
        outside = [i for i in range(len(problem.names)) if i not in active]
        extended = np.array([[*active, i] for i in outside])
        active, SSE = _exchange(problem, *_best(problem, extended))
        if not np.isfinite(SSE):
            break
        subsets.append((active, SSE))
        if problem.rounding >= SSE:
            break
    return subsets


def _exchange(problem: Problem, active: list[int], SSE: float) -> tuple[list[int], float]:
    """Exchange single terms for candidates outside while that lowers the sum of squares."""
    while np.isfinite(SSE):
        outside = [i for i in range(len(problem.names)) if i not in active]
        others = [[*active[:k], i, *active[k + 1 :]] for k in range(len(active)) for i in outside]
        better, least = _best(problem, np.array(others)) if others else (active, SSE)
        if least >= SSE * (1.0 - 1e-12):  # prevents an endless loop from rounding
            break
        active, SSE = better, least
    return active, SSE


def _best(problem: Problem, subsets: np.ndarray) -> tuple[list[int], float]:
    """Return the row of column numbers with the least sum of squares, and that sum."""
    SSE = _SSE(problem, subsets)
    return subsets[np.argmin(SSE)].tolist(), float(np.min(SSE))


def _SSE(problem: Problem, subsets: np.ndarray) -> np.ndarray:
    """Return the residual sum of squares of each row of column numbers.

    It is the square of the last diagonal element of a triangle, and infinite for linearly dependent
    columns.
    """
    with_response = np.concatenate(
        [subsets, np.full((len(subsets), 1), len(problem.names))], axis=1
    )
    sums = np.empty(len(subsets))
    for start in range(0, len(subsets), 4096):  # blocks of a few megabytes
        block = slice(start, start + 4096)
        R = np.asarray(
            np.linalg.qr(np.moveaxis(problem.T[:, with_response[block]], 0, 1), mode="r")
        )
        diagonal = np.abs(np.diagonal(R, axis1=1, axis2=2))
        independent = np.min(diagonal[:, :-1], axis=1) > problem.samples * np.finfo(float).eps
        sums[block] = np.where(independent, diagonal[:, -1] ** 2, np.inf)
    return sums
