"""Least squares on a subset of a problem's terms, and what its columns leave of the columns outside."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._foundation.checks import InputError
from .problem import Problem


class Fit(NamedTuple):
    """Least squares on a subset of the terms: `T[:, active] = basis R`, the response's part in it, and the rest.

    Attributes:
        active: which columns.
        basis, R: orthonormal basis and triangle.
        along: the response in the basis.
        rest: the response less its part in the basis.
        SSE, dof: sum of squares of the rest, and its degrees of freedom.
    """

    active: tuple[int, ...]
    basis: np.ndarray
    R: np.ndarray
    along: np.ndarray
    rest: np.ndarray
    SSE: float
    dof: int

    @property
    def inverse(self) -> np.ndarray:
        """Inverse of R: its rows' sums of squares times `SSE/dof` are the variances of the scaled values (B.8)."""
        return np.linalg.inv(self.R)  # of a triangle its elimination is back substitution

    @property
    def partial_F(self) -> np.ndarray:
        """F of each term when all others are in, `(value / standard error)^2` (B.28)."""
        inverse = self.inverse
        with np.errstate(divide="ignore"):
            return (inverse @ self.along) ** 2 / (np.sum(inverse**2, axis=1) * self.SSE / self.dof)


def fit(problem: Problem, active: Sequence[int]) -> Fit:
    """Least squares on the columns with these numbers, in this order.

    Raises:
        InputError: when a column does not vary, or is a combination of those before it, to rounding.
    """
    active = tuple(active)
    require_varying(problem, active)
    basis, R = np.linalg.qr(problem.T[:, list(active)])
    for column, size in zip(active, np.abs(np.diagonal(R)), strict=True):
        if size <= problem.samples * np.finfo(float).eps:
            others = ", ".join(problem.names[i] for i in active if i != column)
            raise InputError(
                f"The column {problem.names[column]!r} is a linear combination of others ({others}), so that they have no "
                "separate values. Leave one out."
            )
    response = problem.T[:, -1]
    along = basis.T @ response
    rest = response - basis @ along
    rest = rest - basis @ (
        basis.T @ rest
    )  # twice is enough (Kahan; Parlett 1980): what rounding left in the basis goes
    return Fit(active, basis, R, along, rest, float(rest @ rest), problem.dof(len(active)))


def require_varying(problem: Problem, active: Sequence[int]) -> None:
    """Refuse columns that do not vary.

    Raises:
        InputError: for the first of them.
    """
    what = "is constant, and a constant is fitted beside the columns" if problem.constant else "is zero"
    for i in active:
        if not problem.varies[i]:
            raise InputError(f"The column {problem.names[i]!r} {what}. Leave it out.")


def tolerances(problem: Problem, found: Fit, outside: list[int]) -> np.ndarray:
    """Share of each outside column that the columns inside do not explain, `1 - R^2` of it on them.

    It is the report's ratio of a diagonal element after and before pivoting (section B.3): 1 for a column of its own, 0 for a
    combination of those inside.
    """
    return np.sum(apart(problem, found, outside) ** 2, axis=0)


def apart(problem: Problem, found: Fit, outside: list[int]) -> np.ndarray:
    """The outside columns less their parts in the fit's basis, shape (row, outside), each of length one before that."""
    columns = problem.T[:, outside]
    columns = columns - found.basis @ (found.basis.T @ columns)
    return columns - found.basis @ (found.basis.T @ columns)


def leverages(problem: Problem, found: Fit) -> np.ndarray:
    """Diagonal of the matrix that takes measured into fitted responses, shape (time,)."""
    inside = np.sum((problem.Q @ found.basis) ** 2, axis=1)
    return inside + problem.root**2 / np.sum(problem.root**2) if problem.constant else inside
