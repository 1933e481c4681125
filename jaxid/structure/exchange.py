"""The best subset of each size: all of them where candidates are few, else by exchange of terms."""

import itertools
from collections.abc import Sequence

import numpy as np

from .._foundation.checks import require
from .._foundation.types import Float, Numbers
from .fit import fit
from .problem import Problem, prepare
from .selection import Selection, step

EXHAUSTIVE = 15  # candidates: 32768 subsets, a second


def best_subsets(
    X: Float[Numbers, "time term"],
    y: Float[Numbers, " time"],
    names: Sequence[str],
    *,
    max_terms: int | None = None,
    exhaustive: int = EXHAUSTIVE,
    PSE_bound: float | None = None,
    weights: Float[Numbers, " time"] | None = None,
    constant: bool = True,
    response: str = "y",
) -> Selection:
    """Of each number of terms the model with the least sum of squares, to be given to `choose`.

    With few candidates every subset is tried. Otherwise the model of each size starts from the one below and the best addition,
    then from the one above and the best omission, and single terms are exchanged for outside ones as long as that lowers the sum
    of squares. That finds much of what stepwise regression misses when two terms help only together, but not with certainty.

    Args:
        X: candidates, shape (time, term).
        y: the response, shape (time,).
        names: of the candidates.
        max_terms: largest size; all candidates by default.
        exhaustive: most candidates for which every subset is tried.
        PSE_bound: as in `SubsetOptions`.
        weights: of the samples.
        constant: fit a constant in every model.
        response: name of what is explained.

    Raises:
        InputError: as `prepare` says, and for a `max_terms` below one.

    (Miller, Subset Selection in Regression, 2002, sections 3.2 and 3.4.)
    """
    problem = prepare(X, y, names, weights=weights, constant=constant, response=response)
    count = len(problem.names)
    largest = count if max_terms is None else min(max_terms, count)
    require(largest >= 1, f"max_terms is {max_terms}; the largest model has one term at least.")
    if count <= exhaustive:
        subsets, how = _all_best(problem, largest), "best of all"
    else:
        subsets, how = _exchanged(problem, largest), "best found by exchange"
    found = fit(problem, ())
    steps = [step(problem, found, "start", why="no term", PSE_bound=PSE_bound)]
    for active in subsets:
        found = fit(problem, active)
        steps.append(step(problem, found, "subset", why=f"{how} of its size", PSE_bound=PSE_bound))
    if problem.rounding >= found.SSE:
        steps.append(step(problem, found, "stop", why="the residual is nothing but rounding", PSE_bound=PSE_bound))
    elif len(subsets) < largest:
        why = f"any {len(subsets) + 1} columns are combinations of each other"
        steps.append(step(problem, found, "stop", why=why, PSE_bound=PSE_bound))
    return Selection(problem, tuple(steps))


def _all_best(problem: Problem, largest: int) -> list[list[int]]:
    """The best of all subsets of each size, until one is exact or every further one holds a combination."""
    found = []
    for size in range(1, largest + 1):
        subsets = np.array(list(itertools.combinations(range(len(problem.names)), size)))
        active, least = _best(problem, subsets)
        if not np.isfinite(least):
            return found
        found.append(active)
        if least <= problem.rounding:
            return found
    return found


def _exchanged(problem: Problem, largest: int) -> list[list[int]]:
    """Subsets of each size, on the way up to all columns and down again: some pairs are only seen from above."""
    found: list[tuple[list[int], float]] = []
    below: list[int] = []
    for _ in problem.names:
        outside = [i for i in range(len(problem.names)) if i not in below]
        better = _exchange(problem, *_best(problem, np.array([[*below, i] for i in outside])))
        if not np.isfinite(better[1]):
            break
        found.append(better)
        below = better[0]
        if better[1] <= problem.rounding:
            break
    for size in range(len(found) - 1, 0, -1):
        above = found[size][0]
        better = _exchange(problem, *_best(problem, np.array([[i for i in above if i != gone] for gone in above])))
        found[size - 1] = min(found[size - 1], better, key=lambda one: one[1])
    exact = next((size for size, (_, SSE) in enumerate(found) if problem.rounding >= SSE), len(found))
    return [active for active, _ in found[: min(exact + 1, largest)]]


def _exchange(problem: Problem, active: list[int], SSE: float) -> tuple[list[int], float]:
    """Exchange one term for one outside as long as that lowers the sum of squares."""
    while np.isfinite(SSE):
        outside = [i for i in range(len(problem.names)) if i not in active]
        others = [[*active[:k], i, *active[k + 1 :]] for k in range(len(active)) for i in outside]
        better, least = _best(problem, np.array(others)) if others else (active, SSE)
        if least >= SSE * (1.0 - 1e-12):  # else rounding could go round in circles
            break
        active, SSE = better, least
    return active, SSE


def _best(problem: Problem, subsets: np.ndarray) -> tuple[list[int], float]:
    """Of rows of column numbers the one that leaves the least sum of squares, and that."""
    SSE = _SSE(problem, subsets)
    return subsets[np.argmin(SSE)].tolist(), float(np.min(SSE))


def _SSE(problem: Problem, subsets: np.ndarray) -> np.ndarray:
    """Sum of squares left by each row of column numbers: the last diagonal element of a triangle, infinite for a subset of
    columns that are combinations of each other."""
    with_response = np.concatenate([subsets, np.full((len(subsets), 1), len(problem.names))], axis=1)
    left = np.empty(len(subsets))
    for start in range(0, len(subsets), 4096):  # as many at a time as fit into a few megabytes
        block = slice(start, start + 4096)
        R = np.asarray(np.linalg.qr(np.moveaxis(problem.T[:, with_response[block]], 0, 1), mode="r"))
        diagonal = np.abs(np.diagonal(R, axis1=1, axis2=2))
        apart = np.min(diagonal[:, :-1], axis=1) > problem.samples * np.finfo(float).eps
        left[block] = np.where(apart, diagonal[:, -1] ** 2, np.inf)
    return left
