"""The linear value of a change of hypothesis, from one triangle.

Let `T` be the triangular factor of the whitened sensitivities to all shared parameters, free and
absent, with the per-record parameters eliminated, `r` its right-hand side, and `phi` the values of
the parameters. A change removes the columns `out` and adds the columns `into`. With `K` the free
columns that stay, and `P_K` the projection orthogonal to them,

    fall(out, into) = |r|^2 - min_b | P_K (r + T_out phi_out) - P_K T_into b |^2

is the fall of chi-square in the linear model: of an addition (`out` empty), of two at once, of a
swap, and, negative, of a removal (`into` empty).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._foundation.types import Bool, Float, Int

# Chosen: share of a column's squared length, orthogonal to the free columns, below which it counts
# as their linear combination. It is 0.3 % of the length: the shapes of equations and effects, such
# as the width of a friction, are not known better, and with such a column the others are free to
# take senseless values.
IDENTIFIABLE = 1e-5
# Chosen: least share of a column's squared length outside the span of the columns added with it. A
# pair that overlaps more has gains that grow without limit against each other.
LEAST_APART = 0.02
# Chosen: products that are in memory at once, 8 MB, for many right-hand sides.
BATCH = 1_000_000


class Triangle(NamedTuple):
    """Triangular factor of the sensitivities to some or all columns, at a fit.

    Attributes:
        names: names of the columns.
        factor: `[T r]`, with the per-record parameters eliminated.
        free: the columns that are free in the fit.
        values: gains at the fit, by which columns are removed; zero for other parameters.
    """

    names: tuple[str, ...]
    factor: Float[np.ndarray, "row column+1"]
    free: Bool[np.ndarray, " column"]
    values: Float[np.ndarray, " column"]

    def at(self, names: Sequence[str]) -> list[int]:
        """Return the columns of some names."""
        return [self.names.index(name) for name in names]


class Reduced(NamedTuple):
    """A triangle with free columns removed, orthogonal to the free columns that stay.

    Attributes:
        correlation: correlations between the orthogonal parts of all columns; zero for a column
            that the free columns reproduce.
        product: products of the orthogonal parts, scaled to unit length, with the right-hand side.
        length: length of the orthogonal parts.
        base: fall of chi-square by the removal alone, at most zero.
    """

    correlation: Float[np.ndarray, "column column"]
    product: Float[np.ndarray, " column"]
    length: Float[np.ndarray, " column"]
    base: float


def reduce(triangle: Triangle, out: Sequence[int] = ()) -> Reduced:
    """Return the triangle without the free columns `out`."""
    T, r = triangle.factor[:, :-1], triangle.factor[:, -1]
    removed = np.zeros(T.shape[1], bool)
    removed[list(out)] = True
    kept = triangle.free & ~removed
    span = basis(T[:, kept])
    extended = np.column_stack([T, r + T[:, removed] @ triangle.values[removed]])
    remainder = extended - span @ (span.T @ extended)
    orthogonal, target = remainder[:, :-1], remainder[:, -1]
    length = np.linalg.norm(orthogonal, axis=0)
    apart = (length**2 > IDENTIFIABLE * np.sum(T**2, axis=0)) & (length > 0) & ~kept
    unit = np.where(apart, orthogonal / np.where(apart, length, 1.0), 0.0)
    base = float(r @ r - target @ target)
    return Reduced(unit.T @ unit, unit.T @ target, np.where(apart, length, 0.0), base)


def falls(reduced: Reduced, into: Int[np.ndarray, "set member"]) -> Float[np.ndarray, " set"]:
    """Return the fall of chi-square for sets of added columns, all of one size.

    Args:
        reduced: triangle without the removed columns.
        into: added columns, one row per set.

    Returns:
        Falls; minus infinity for a set with a column that the others reproduce.
    """
    inverse, determined = _inverses(reduced.correlation, into)
    return np.where(determined, reduced.base + _gained(inverse, reduced.product[into]), -np.inf)


def joint_fall(reduced: Reduced, into: Sequence[int]) -> tuple[float, int]:
    """Return the fall of chi-square by columns that may overlap, and its degrees of freedom: the
    directions of their span in which they are apart.
    """
    at = [*into]
    apart, directions = np.linalg.eigh(reduced.correlation[np.ix_(at, at)])
    determined = apart > LEAST_APART
    along = directions.T[determined] @ reduced.product[at]
    return float(np.sum(along**2 / apart[determined])), int(np.sum(determined))


def largest_falls(
    correlation: Float[np.ndarray, "column column"],
    products: Float[np.ndarray, "side column"],
    into: Int[np.ndarray, "set member"],
) -> Float[np.ndarray, " side"]:
    """Return the largest fall of chi-square among sets of added columns, for many right-hand sides.

    Args:
        correlation, products: as in `Reduced`, the products for each right-hand side.
        into: added columns, one row per set, all of one size.

    Returns:
        Largest falls; zero if in every set one column is reproduced by others.
    """
    inverse, determined = _inverses(correlation, into)
    inverse, members = inverse[determined], into[determined]
    parts = np.array_split(products, 1 + len(products) * members.size // BATCH)
    falls = [np.max(_gained(inverse, part[:, members]), axis=1, initial=0.0) for part in parts]
    return np.concatenate(falls)


def _inverses(correlation, into):
    """Return the inverse correlations of sets of columns, and whether each is determined."""
    gram = correlation[into[:, :, None], into[:, None, :]]
    determined = np.linalg.eigvalsh(gram)[:, 0] > LEAST_APART
    gram = np.where(determined[:, None, None], gram, np.eye(into.shape[1]))
    return np.linalg.inv(gram), determined


def _gained(inverse, b):
    """Return the falls of chi-square by sets of columns with products `b`."""
    return np.sum(b * np.einsum("sij,...sj->...si", inverse, b), axis=-1)


def gains(reduced: Reduced, into: Sequence[int]) -> Float[np.ndarray, " member"]:
    """Return the values of added columns in the linear model."""
    at = [*into]
    scaled = np.linalg.lstsq(reduced.correlation[np.ix_(at, at)], reduced.product[at], rcond=None)
    length = reduced.length[at]
    return scaled[0] / np.where(length > 0, length, 1.0)


def basis(columns: Float[np.ndarray, "row column"]) -> Float[np.ndarray, "row direction"]:
    """Return an orthonormal basis of some columns, weak directions left out."""
    length = np.linalg.norm(columns, axis=0)
    U, s, _ = np.linalg.svd(columns / np.where(length > 0, length, 1.0), full_matrices=False)
    return U[:, s > 1e-10 * np.max(s, initial=0.0)]
