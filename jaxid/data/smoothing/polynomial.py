"""Smoothing by a polynomial fitted to a window that slides along the record."""

from functools import cache, partial
from typing import NamedTuple

import equinox as eqx
import numpy as np
import scipy

from ..._foundation.checks import require
from .method import AbstractSmoother, LinearSmooth, cross_validation, even_step, require_cutoff

LOCAL_POLYNOMIAL = "LocalPolynomial"
GROWTH = 1.12  # ratio of successive windows in the search, about twenty per decade (chosen)


class _Weights(NamedTuple):
    """Sums of squared weights of a polynomial fit to one window, at each of its samples.

    Attributes:
        leverage: of the value, shape (window,).
        slope_gain: of the slope, shape (window,).
    """

    leverage: np.ndarray
    slope_gain: np.ndarray


class LocalPolynomial(AbstractSmoother):
    """Least-squares polynomials in a window around each sample (Savitzky-Golay filter).

    Value and slope at a sample are those of the polynomial that is fitted to the window around it.
    Near the ends the polynomial of the first or last window is used. Polynomials of the given order
    pass unchanged. Samples must be evenly spaced. Without `window` and `cutoff_hz` the window of
    least cross-validation is used.

    Args:
        cutoff_hz: frequency at which half of the amplitude passes [Hz]; the nearest window is used.
        window: length of the window, an odd number of samples; in place of `cutoff_hz`.
        order: order of the polynomial, at least 1.

    Raises:
        InputError: when both window and cut-off are given, the order is below 1, or the window is
            even or not longer than order + 1.

    Source: A. Savitzky, M. J. E. Golay, Smoothing and differentiation of data by simplified least
    squares procedures, Analytical Chemistry 36(8), 1964; ends and frequency response: R. W.
    Schafer, `What is a Savitzky-Golay filter?`, IEEE Signal Processing Magazine 28(4), 2011.
    """

    cutoff_hz: float | None = eqx.field(static=True)
    window: int | None = eqx.field(static=True)
    order: int = eqx.field(static=True)

    def __init__(
        self, cutoff_hz: float | int | None = None, *, window: int | None = None, order: int = 3
    ):
        require(
            order >= 1,
            f"{LOCAL_POLYNOMIAL}: the order is {order}. Give 1 or more, so that there is a slope.",
        )
        require(
            cutoff_hz is None or window is None,
            f"{LOCAL_POLYNOMIAL}: give `cutoff_hz` or `window`, one of the two.",
        )
        require(
            window is None or (window % 2 == 1 and window > order + 1),
            f"{LOCAL_POLYNOMIAL}: the window is {window} samples. Give an odd number of at least "
            f"{_shortest(order)} for order {order}.",
        )
        self.cutoff_hz = None if cutoff_hz is None else float(cutoff_hz)
        self.window, self.order = window, order

    def linear(self, t, z):
        step, longest = even_step(t, LOCAL_POLYNOMIAL), len(z) - (len(z) + 1) % 2
        shortest = _shortest(self.order)
        require(
            self.window is None or self.window <= longest,
            f"{LOCAL_POLYNOMIAL}: the window is {self.window} samples and the record has "
            f"{len(z)}. Give a shorter one.",
        )
        require(
            shortest <= longest,
            f"{LOCAL_POLYNOMIAL}: order {self.order} needs a window of at least {shortest} samples "
            f"and the record has {len(z)}. Give a lower order, or more samples.",
        )
        if self.window is not None:
            window = self.window
        elif self.cutoff_hz is not None:
            window = self._window(self.cutoff_hz * step, shortest, longest, step)
        else:
            scores = {w: self._score(z, w) for w in _candidates(shortest, longest)}
            window = min(scores, key=lambda w: scores[w])
        return self._fit(z, window, step)

    def _window(self, frequency: float, shortest: int, longest: int, step: float) -> int:
        """The odd window whose half-amplitude frequency [cycles/sample] is nearest."""
        require_cutoff(
            frequency / step,
            _half(longest, self.order) / step,
            _half(shortest, self.order) / step,
            LOCAL_POLYNOMIAL,
        )
        low, high = (shortest - 1) // 2, (longest - 1) // 2
        # Bisection: side lobes stay below one half, so that longer windows pass less.
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (
                (middle, high)
                if _passed(2 * middle + 1, self.order, frequency) >= 0.5
                else (low, middle)
            )
        return min(
            (2 * h + 1 for h in (low, high)), key=lambda w: abs(_half(w, self.order) - frequency)
        )

    def _score(self, z: np.ndarray, window: int) -> float:
        """Cross-validation of one window."""
        trace = float(np.sum(_spread(_weights(window, self.order).leverage, len(z))))
        squares = float(np.sum((z - scipy.signal.savgol_filter(z, window, self.order)) ** 2))
        return cross_validation(squares, len(z), trace)

    def _fit(self, z: np.ndarray, window: int, step: float) -> LinearSmooth:
        """Value, slope and weights for one window."""
        weights = _weights(window, self.order)
        # The smoothing matrix is a projection: sums of squares of its rows are the leverage.
        leverage = _spread(weights.leverage, len(z))
        smoothed = partial(scipy.signal.savgol_filter, z, window, self.order)
        return LinearSmooth(
            value=np.asarray(smoothed()),
            derivative=np.asarray(smoothed(deriv=1, delta=step)),
            trace=float(np.sum(leverage)),
            value_gain=leverage,
            derivative_gain=_spread(weights.slope_gain, len(z)) / step**2,
            cutoff_hz=_half(window, self.order) / step,
        )


def _shortest(order: int) -> int:
    """The shortest odd window with at least one residual degree of freedom."""
    return order + 2 + (order + 1) % 2


def _candidates(shortest: int, longest: int) -> list[int]:
    """Odd windows in increasing order, with nearly constant ratio."""
    windows = np.geomspace(shortest, longest, 2 + int(np.log(longest / shortest) / np.log(GROWTH)))
    return sorted({min(2 * int(w / 2) + 1, longest) for w in windows})


def _weights(window: int, order: int) -> _Weights:
    """Leverage and slope gain of a fit to samples at steps of one, from an orthonormal basis."""
    half = (window - 1) // 2
    x = np.arange(-half, half + 1) / half
    basis, triangle = np.linalg.qr(np.vander(x, order + 1, increasing=True))
    powers = np.arange(1, order + 1)
    slopes = (
        np.concatenate(
            [np.zeros((window, 1)), powers * np.vander(x, order, increasing=True)], axis=1
        )
        / half
    )
    return _Weights(
        np.sum(basis**2, axis=1), np.sum(np.linalg.solve(triangle.T, slopes.T) ** 2, axis=0)
    )


def _spread(window_values: np.ndarray, samples: int) -> np.ndarray:
    """Extend the values of one window to the samples of the record.

    Inside the record the value of the window's middle is used, at the ends the values of its
    halves.
    """
    half = (len(window_values) - 1) // 2
    values = np.full(samples, window_values[half])
    values[:half], values[samples - half :] = window_values[:half], window_values[half + 1 :]
    return values


def _passed(window: int, order: int, frequency: float) -> float:
    """Share of the amplitude that passes inside the record, at a frequency in cycles per sample."""
    half = (window - 1) // 2
    return float(
        scipy.signal.savgol_coeffs(window, order)
        @ np.cos(2 * np.pi * frequency * np.arange(-half, half + 1))
    )


@cache
def _half(window: int, order: int) -> float:
    """The frequency [cycles/sample] at which half of the amplitude passes."""
    return float(
        np.asarray(
            scipy.optimize.brentq(lambda frequency: _passed(window, order, frequency) - 0.5, 0, 0.5)
        )
    )
