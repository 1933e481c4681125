"""Triangular factors: the square-root form in which information is held, stacked and solved.

For rows `A`, the factor is the upper triangle `T` of `A = Q T`, so that `T'T = A'A` without forming
`A'A`, which would square the condition number (Bierman, Factorization Methods for Discrete
Sequential Estimation, 1977).
"""

import jax.numpy as jnp

from .types import Array, Float


def triangle(rows: Float[Array, "row column"]) -> Float[Array, "column column"]:
    """Upper triangular factor `T` with `T'T = rows'rows`, square for any number of rows.

    Args:
        rows: the matrix to decompose, shape (row, column).

    Returns:
        The factor, shape (column, column), with a non-negative diagonal, so that it is unique where
        the rows have full rank.
    """
    count, width = rows.shape
    padded = jnp.pad(rows, ((0, max(width - count, 0)), (0, 0)))
    factor = jnp.linalg.qr(padded, mode="r")
    return jnp.where(jnp.diagonal(factor) < 0, -1.0, 1.0)[:, None] * factor


def stack_factors(factors: Float[Array, "case row column"]) -> Float[Array, "column column"]:
    """One factor that holds the sum of the information of several: decompose them on top of each
    other.
    """
    return triangle(factors.reshape(-1, factors.shape[-1]))
