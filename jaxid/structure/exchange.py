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
    and single terms are exchanged for outside ones as long as that lowers the sum of squares; that finds what stepwise regression
    misses when two terms help only together, but not with certainty.

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
    found = fit(problem, ())
    steps = [step(problem, found, "start", why="no term", PSE_bound=PSE_bound)]
    active: tuple[int, ...] = ()
    how = "best of all" if count <= exhaustive else "best found by exchange"
    for size in range(1, largest + 1):
        active = _best_of_all(problem, size) if count <= exhaustive else _by_exchange(problem, active)
        if not active:
            why = f"any {size} columns are combinations of each other"
            steps.append(step(problem, found, "stop", why=why, PSE_bound=PSE_bound))
            break
        found = fit(problem, active)
        steps.append(step(problem, found, "subset", why=f"{how} with {size} terms", PSE_bound=PSE_bound))
        if problem.rounding >= found.SSE:
            steps.append(step(problem, found, "stop", why="the residual is nothing but rounding", PSE_bound=PSE_bound))
            break
    return Selection(problem, tuple(steps))


def _best_of_all(problem: Problem, size: int) -> tuple[int, ...]:
    subsets = np.array(list(itertools.combinations(range(len(problem.names)), size)))
    SSE = _SSE(problem, subsets)
    return tuple(subsets[np.argmin(SSE)].tolist()) if np.isfinite(SSE).any() else ()


def _by_exchange(problem: Problem, below: tuple[int, ...]) -> tuple[int, ...]:
    """One term more than below, then exchanges until none helps; nothing where every further term is a combination."""
    outside = [i for i in range(len(problem.names)) if i not in below]
    larger = np.array([[*below, i] for i in outside])
    SSE = _SSE(problem, larger)
    best, least = larger[np.argmin(SSE)].tolist(), float(np.min(SSE))
    if not np.isfinite(least):
        return ()
    while True:
        outside = [i for i in range(len(problem.names)) if i not in best]
        others = np.array([[*best[:k], i, *best[k + 1 :]] for k in range(len(best)) for i in outside])
        SSE = _SSE(problem, others) if others.size else np.array([np.inf])
        if np.min(SSE) >= least * (1.0 - 1e-12):  # else rounding could go round in circles
            return tuple(best)
        best, least = others[np.argmin(SSE)].tolist(), float(np.min(SSE))


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
