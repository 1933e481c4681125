"""Regression of a channel on its past and on inputs, for checks of a record before any fit.

    z_i = c + s t_i + sum_(k=1..p) a_k z_(i-k) + sum_(j, k) b_jk u_j,(i-k) + e_i

With enough lags p the residual e is white whatever the noise of the sensor (Ljung, System
Identification, 2nd ed. 1999, section 10.3), so that its tests need no model of the noise.
"""

from typing import NamedTuple

import numpy as np

from .thresholds import FEWEST_LAGS, LAGS, ROWS_PER_COEFFICIENT


class Regression(NamedTuple):
    """Result of a regression; row i of the record is missing where a lagged value is.

    Attributes:
        residual: e by sample of the record, NaN where a value is missing.
        past: coefficients a_k of the channel's own past.
        input: coefficients b_jk, shape (input, lag).
        input_covariance: of `input` flattened.
        trend: s times the length of the record [unit of the channel].
        trend_error: its standard error.
        condition: ratio of the largest to the smallest singular value, columns of unit length.
    """

    residual: np.ndarray
    past: np.ndarray
    input: np.ndarray
    input_covariance: np.ndarray
    trend: float
    trend_error: float
    condition: float


def lags_for(samples: int, inputs: int) -> int:
    """Return the number of lags for which a record has enough samples, zero if for none."""
    lags = min(LAGS, samples // (ROWS_PER_COEFFICIENT * (inputs + 2)))
    return lags if lags >= FEWEST_LAGS else 0


def lagged(values: np.ndarray, lags: range) -> np.ndarray:
    """Return the values at earlier samples, one column for each lag, NaN before the first."""
    columns = np.full((len(values), len(lags)), np.nan)
    for column, lag in enumerate(lags):
        columns[lag:, column] = values[: len(values) - lag]
    return columns


def regression(
    z: np.ndarray, u: np.ndarray, lags: int, first: int = 0, *, own: bool = True
) -> Regression | None:
    """Regress a channel on its past and on the inputs.

    Args:
        z: the channel, NaN where a sample is missing.
        u: inputs, shape (time, input).
        lags: number p of lags.
        first: first lag of the inputs, 0 or 1.
        own: with the channel's own past.

    Returns:
        The regression, or None if too few rows are complete.
    """
    own_lags = range(1, lags + 1) if own else range(0)
    input_lags = range(first, lags + 1)
    trend = np.linspace(-0.5, 0.5, len(z))[:, None]
    blocks = [np.ones((len(z), 1)), trend, lagged(z, own_lags)]
    blocks += [lagged(column, input_lags) for column in u.T]
    X = np.concatenate(blocks, axis=1)
    complete = np.isfinite(X).all(axis=1) & np.isfinite(z)
    if complete.sum() < max(2 * X.shape[1], X.shape[1] + 10):
        return None
    theta, covariance, residual, condition = least_squares(X[complete], z[complete])
    every = np.full(len(z), np.nan)
    every[complete] = residual
    start = 2 + len(own_lags)
    return Regression(
        residual=every,
        past=theta[2:start],
        input=theta[start:].reshape(u.shape[1], len(input_lags)),
        input_covariance=covariance[start:, start:],
        trend=float(theta[1]),
        trend_error=float(np.sqrt(covariance[1, 1])),
        condition=condition,
    )


def least_squares(X: np.ndarray, y: np.ndarray):
    """Return coefficients, their covariance, the residual and the condition.

    Directions below 1e-10 of the largest, columns of unit length, get a coefficient of zero.
    """
    length = np.linalg.norm(X, axis=0)
    length = np.where(length > 0, length, 1.0)
    U, s, Vt = np.linalg.svd(X / length, full_matrices=False)
    strong = s > 1e-10 * s[0]
    back = (Vt[strong].T / s[strong]) / length[:, None]
    theta = back @ (U[:, strong].T @ y)
    residual = y - X @ theta
    variance = residual @ residual / max(len(y) - strong.sum(), 1)
    return theta, variance * back @ back.T, residual, float(s[0] / max(s[-1], 1e-300))
