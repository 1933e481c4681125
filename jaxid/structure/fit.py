"""Least squares on a subset of a problem's terms, and other columns' parts orthogonal to it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._foundation.checks import InputError
from .problem import Problem


class Fit(NamedTuple):
    """Least squares on a subset of the terms, by `T[:, active] = basis R`.

    Attributes:
        active: numbers of the columns.
        basis, R: orthonormal basis and triangle.
        coordinates: projection of the response on the basis, `basis' T[:, -1]`.
        residual: the response minus its projection.
        SSE, dof: sum of squares of the residual, and its degrees of freedom.
    """

    active: tuple[int, ...]
    basis: np.ndarray
    R: np.ndarray
    coordinates: np.ndarray
    residual: np.ndarray
    SSE: float
    dof: int

    @property
    def inverse(self) -> np.ndarray:
        """Inverse of R.

        The sum of squares of each row times `SSE/dof` is the variance of a scaled value (B.8).
        """
        return np.linalg.inv(self.R)  # elimination of a triangle is back substitution

    @property
    def partial_F(self) -> np.ndarray:
        """F of each term given all others, `(value / standard error)^2` (B.28)."""
        inverse = self.inverse
        with np.errstate(divide="ignore"):
            return (inverse @ self.coordinates) ** 2 / (
                np.sum(inverse**2, axis=1) * self.SSE / self.dof
            )


def fit(problem: Problem, active: Sequence[int]) -> Fit:
    """Return the least-squares fit on the columns with these numbers, in this order.

    Raises:
        InputError: if a column does not vary, or is within rounding a linear combination of the
            columns before it.
    """
    active = tuple(active)
    require_varying(problem, active)
    basis, R = np.linalg.qr(problem.T[:, list(active)])
    for column, size in zip(active, np.abs(np.diagonal(R)), strict=True):
        if size <= problem.samples * np.finfo(float).eps:
            others = ", ".join(problem.names[i] for i in active if i != column)
            raise InputError(
                f"The column {problem.names[column]!r} is a linear combination of others "
                f"({others}), so that they have no separate values. Leave one out."
            )
    response = problem.T[:, -1]
    coordinates = basis.T @ response
    residual = response - basis @ coordinates
    # The second projection removes rounding errors; twice is enough (Kahan; Parlett 1980).
    residual = residual - basis @ (basis.T @ residual)
    SSE = float(residual @ residual)
    return Fit(active, basis, R, coordinates, residual, SSE, problem.dof(len(active)))


def require_varying(problem: Problem, active: Sequence[int]) -> None:
    """Check that the columns vary.

    Raises:
        InputError: for the first column that does not vary.
    """
    fault = "is constant, and a constant is fitted as well" if problem.constant else "is zero"
    for i in active:
        if not problem.varies[i]:
            raise InputError(f"The column {problem.names[i]!r} {fault}. Leave it out.")


def tolerances(problem: Problem, fitted: Fit, outside: list[int]) -> np.ndarray:
    """Return the share of each outside column that the fit's columns do not explain, `1 - R^2`.

    It is the report's ratio of a diagonal element after and before pivoting (section B.3): 1 for an
    orthogonal column, 0 for a linear combination of the fit's columns.
    """
    return np.sum(orthogonal_parts(problem, fitted, outside) ** 2, axis=0)


def orthogonal_parts(problem: Problem, fitted: Fit, outside: list[int]) -> np.ndarray:
    """Return the parts of the outside columns orthogonal to the fit's basis, shape (row, outside).

    The columns have length one before the projection.
    """
    columns = problem.T[:, outside]
    columns = columns - fitted.basis @ (fitted.basis.T @ columns)
    return columns - fitted.basis @ (fitted.basis.T @ columns)


def leverages(problem: Problem, fitted: Fit) -> np.ndarray:
    """Return the diagonal of the hat matrix, which maps measured to fitted responses, (time,)."""
    inside = np.sum((problem.Q @ fitted.basis) ** 2, axis=1)
    return inside + problem.root**2 / np.sum(problem.root**2) if problem.constant else inside
