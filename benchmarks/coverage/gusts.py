"""Vertical gusts as linear filters of white noise: first order, and Dryden's of second order."""

from typing import NamedTuple

import numpy as np

ROOT3 = 3.0**0.5


class GustFilter(NamedTuple):
    """A gust of unit variance, `dx = A x dt + B dW`, `gust = C x`.

    Attributes:
        A: shape (state, state) [1/s].
        B: shape (state,) [1/sqrt(s)].
        C: shape (state,).
        P: covariance of x at all times, the solution of `A P + P A' + B B' = 0`.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    P: np.ndarray


def first_order(time: float) -> GustFilter:
    """Return the gust with the autocovariance `exp(-|tau| / T)`.

    Args:
        time: T [s].
    """
    return GustFilter(
        np.array([[-1.0 / time]]), np.array([np.sqrt(2.0 / time)]), np.ones(1), np.ones((1, 1))
    )


def dryden(time: float) -> GustFilter:
    """Return Dryden's vertical gust (MIL-F-8785C, 1980, 3.7.1.2), of white noise n of unit strength

        w = sqrt(T) (1 + sqrt(3) T s)/(1 + T s)^2 n,    T = Lw / V

    with the states `x1 = sqrt(T)/(1 + T s) n` and `x2 = x1/(1 + T s)`.

    Args:
        time: T [s].
    """
    return GustFilter(
        np.array([[-1.0, 0.0], [1.0, -1.0]]) / time,
        np.array([1.0 / np.sqrt(time), 0.0]),
        np.array([ROOT3, 1.0 - ROOT3]),
        np.array([[0.5, 0.25], [0.25, 0.25]]),
    )


def scaled(gust: GustFilter, deviation: float) -> GustFilter:
    """Return the gust with a standard deviation.

    Args:
        gust: of unit variance.
        deviation: standard deviation [m/s].
    """
    return gust._replace(B=deviation * gust.B, P=deviation**2 * gust.P)
