"""A regression, checked once, centred and scaled, and reduced to a triangle on which every subset of its terms is fitted.

Only orthogonal transformations touch the data, so that its condition number is never squared; the triangle has as many rows as
there are terms, and one, however long the records are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._foundation.checks import require, require_unique
from .._foundation.types import Float, Numbers

Labels = Sequence | Numbers  # of samples, one each: the manoeuvre to which it belongs
ROUNDING = 1e3 * float(np.finfo(float).eps)  # of the response's length: a residual below it is zero


@dataclass(frozen=True, eq=False)
class Problem:
    """Columns, response and their triangle, `root * [X - means, y - mean] = Q T` with the columns of X at length one,
    or zero where a column does not vary.

    Attributes:
        names, response: of the columns and of what they explain.
        X, y: as given, shapes (time, term) and (time,).
        root: square roots of the weights, shape (time,).
        constant: whether a constant is fitted; without it nothing is centred.
        means, mean: weighted means of the columns and of the response, zero without a constant.
        scale: length of each weighted centred column, one where it does not vary.
        varies: whether each column does, so that something can be learnt from it.
        Q, T: shapes (time, term + 1) and (term + 1, term + 1), the response last.
        rounding: sum of squares that rounding leaves of an exact fit.
    """

    names: tuple[str, ...]
    response: str
    X: np.ndarray
    y: np.ndarray
    root: np.ndarray
    constant: bool
    means: np.ndarray
    mean: float
    scale: np.ndarray
    varies: np.ndarray
    Q: np.ndarray
    T: np.ndarray
    rounding: float

    @property
    def samples(self) -> int:
        return len(self.y)

    @property
    def SST(self) -> float:
        """Weighted sum of squares of the response, about its mean where a constant is fitted."""
        return float(self.T[:, -1] @ self.T[:, -1])

    def dof(self, terms: int) -> int:
        """Degrees of freedom that a fit with so many terms leaves."""
        return self.samples - terms - self.constant


def prepare(
    X: Float[Numbers, "time term"],
    y: Float[Numbers, " time"],
    names: Sequence[str],
    *,
    weights: Float[Numbers, " time"] | None = None,
    deviations: Float[Numbers, " time"] | None = None,
    constant: bool = True,
    response: str = "y",
) -> Problem:
    """Check a regression and reduce it to a triangle.

    Args:
        X: columns, shape (time, term).
        y: the response, shape (time,).
        names: of the columns.
        weights: of the samples, in inverse proportion to the variance of their noise; equal by default.
        deviations: standard deviation of each sample's noise, in place of weights.
        constant: fit a constant beside the columns.
        response: name of what is explained, for messages and tables.

    Raises:
        InputError: for shapes or names that do not match, values that are not finite, a response that does not vary, weights
            that are not positive, or fewer samples than a fit of all terms needs. A column that does not vary is kept: a
            selection logs it, a fit with it is refused.
    """
    X, y, names = np.asarray(X, float), np.asarray(y, float), tuple(names)
    _check(X, y, names, constant, response)
    root = _root(weights, deviations, len(y))
    both = np.column_stack([X, y])
    means = (root**2 @ both) / np.sum(root**2) if constant else np.zeros(len(names) + 1)
    centred = root[:, None] * (both - means)
    length, before = np.linalg.norm(centred, axis=0), np.linalg.norm(root[:, None] * both, axis=0)
    flat = length <= 64 * np.finfo(float).eps * before
    require(not flat[-1], f"The response {response!r} does not vary, so that there is nothing to explain.")
    centred = np.where(flat, 0.0, centred)
    scale = np.where(flat, 1.0, length)[:-1]
    Q, T = np.linalg.qr(centred / np.append(scale, 1.0))
    floor = (ROUNDING * float(before[-1])) ** 2
    return Problem(names, response, X, y, root, constant, means[:-1], float(means[-1]), scale, ~flat[:-1], Q, T, floor)


def _check(X: np.ndarray, y: np.ndarray, names: tuple[str, ...], constant: bool, response: str) -> None:
    require(
        X.ndim == 2 and X.shape == (len(y), len(names)),
        f"X has shape {X.shape}; with {len(y)} samples of {response!r} and {len(names)} names it must be "
        f"({len(y)}, {len(names)}).",
    )
    require_unique("column", (*names, response))
    for name, values in zip((*names, response), (*X.T, y), strict=True):
        bad = np.flatnonzero(~np.isfinite(values))
        require(
            bad.size == 0,
            f"The column {name!r} has {bad.size} values that are not finite, the first in row {bad[0] if bad.size else 0}. "
            "Leave those samples out.",
        )
    needed = len(names) + constant + 1
    require(
        len(y) >= needed,
        f"There are {len(y)} samples of {response!r} and {len(names)} terms, which need at least {needed}. Give fewer terms.",
    )


def _root(weights, deviations, count: int) -> np.ndarray:
    """Square roots of the weights."""
    require(weights is None or deviations is None, "Give weights or standard deviations of the noise, not both.")
    if weights is None and deviations is None:
        return np.ones(count)
    what, given = ("weights", weights) if deviations is None else ("deviations", deviations)
    given = np.asarray(given, float)
    require(given.shape == (count,), f"The {what} have shape {given.shape}; there are {count} samples.")
    good = np.isfinite(given) & (given > 0)
    require(
        bool(good.all()),
        f"The {what} must be positive and finite; {np.sum(~good)} are not, the first in row {int(np.argmin(good))}.",
    )
    return np.sqrt(given) if deviations is None else 1.0 / given
