"""A regression problem, checked, centred, scaled, and reduced to a triangle.

Every subset of its terms is fitted on that triangle. Only orthogonal transformations are applied to
the data, so that its condition number is never squared. The triangle has one row more than there
are terms, however long the records are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._foundation.checks import require, require_unique
from .._foundation.types import Float, Numbers

Labels = Sequence | Numbers  # label of the manoeuvre of each sample
# share of the response's length (chosen, 1000 roundings): a smaller residual is rounding error
RESIDUAL_ROUNDING = 1e3 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Problem:
    """Columns, response and their triangle, `root * [X - means, y - mean] = Q T`.

    The weighted centred columns of X are scaled to length one; a column that does not vary is zero.

    Attributes:
        names, response: names of the columns and of the response.
        X, y: the unscaled data, shapes (time, term) and (time,).
        root: square roots of the weights, scaled to a mean square of one, shape (time,).
        constant: whether a constant is fitted; without it the data are not centred.
        means, mean: weighted means of the columns and of the response, zero without a constant.
        scale: length of each weighted centred column, one if it does not vary.
        varies: whether each column varies.
        Q, T: shapes (time, term + 1) and (term + 1, term + 1), the response last.
        rounding: residual sum of squares of an exact fit due to rounding.
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
        """Weighted sum of squares of the response, about its mean if a constant is fitted."""
        return float(self.T[:, -1] @ self.T[:, -1])

    def dof(self, terms: int) -> int:
        """Return the degrees of freedom of a fit with this number of terms."""
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
    """Return a checked regression problem, reduced to a triangle.

    A column that does not vary is kept: a selection logs it, and a fit with it is refused.

    Args:
        X: columns, shape (time, term).
        y: the response, shape (time,).
        names: names of the columns.
        weights: weights of the samples, inversely proportional to the variance of their noise;
            equal by default. Only their ratios matter.
        deviations: standard deviation of each sample's noise, in place of weights.
        constant: fit a constant in addition to the columns.
        response: name of the response, for messages and tables.

    Raises:
        InputError: for shapes or names that do not match, values that are not finite, a response
            that does not vary, weights that are not positive, or fewer samples than a fit of all
            terms needs.
    """
    X, y, names = np.asarray(X, float), np.asarray(y, float), tuple(names)
    _check(X, y, names, constant, response)
    root = _root(weights, deviations, len(y))
    data = np.column_stack([X, y])
    means = (root**2 @ data) / np.sum(root**2) if constant else np.zeros(len(names) + 1)
    centred = root[:, None] * (data - means)
    length = np.linalg.norm(centred, axis=0)
    uncentred = np.linalg.norm(root[:, None] * data, axis=0)
    flat = length <= 64 * np.finfo(float).eps * uncentred
    require(
        not flat[-1],
        f"The response {response!r} does not vary, so that there is nothing to fit. Give another "
        "response.",
    )
    centred = np.where(flat, 0.0, centred)
    scale = np.where(flat, 1.0, length)[:-1]
    Q, T = np.linalg.qr(centred / np.append(scale, 1.0))
    floor = (RESIDUAL_ROUNDING * float(uncentred[-1])) ** 2
    return Problem(
        names,
        response,
        X,
        y,
        root,
        constant,
        means[:-1],
        float(means[-1]),
        scale,
        ~flat[:-1],
        Q,
        T,
        floor,
    )


def _check(
    X: np.ndarray, y: np.ndarray, names: tuple[str, ...], constant: bool, response: str
) -> None:
    require(
        X.ndim == 2 and X.shape == (len(y), len(names)),
        f"X has shape {X.shape}; with {len(y)} samples of {response!r} and {len(names)} names it "
        f"must be ({len(y)}, {len(names)}).",
    )
    require_unique("column", (*names, response))
    for name, values in zip((*names, response), (*X.T, y), strict=True):
        bad = np.flatnonzero(~np.isfinite(values))
        require(
            bad.size == 0,
            f"The column {name!r} has {bad.size} values that are not finite, the first in row "
            f"{bad[0] if bad.size else 0}. Leave those samples out.",
        )
    needed = len(names) + constant + 1
    require(
        len(y) >= needed,
        f"There are {len(y)} samples of {response!r} and {len(names)} terms, which need at least "
        f"{needed}. Give fewer terms.",
    )


def _root(weights, deviations, count: int) -> np.ndarray:
    """Return the square roots of the weights, scaled to a mean square of one.

    Sums of weighted squares are then in units of the response.
    """
    require(
        weights is None or deviations is None,
        "Give weights or standard deviations of the noise, not both.",
    )
    if weights is None and deviations is None:
        return np.ones(count)
    label, values = ("weights", weights) if deviations is None else ("deviations", deviations)
    values = np.asarray(values, float)
    require(
        values.shape == (count,),
        f"The {label} have shape {values.shape}; there are {count} samples.",
    )
    valid = np.isfinite(values) & (values > 0)
    require(
        bool(valid.all()),
        f"The {label} must be positive and finite; {np.sum(~valid)} are not, the first in row "
        f"{int(np.argmin(valid))}.",
    )
    root = np.sqrt(values) if deviations is None else 1.0 / values
    return root / np.sqrt(np.mean(root**2))
