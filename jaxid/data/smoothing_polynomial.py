"""Smoothing by a polynomial fitted to a window that slides along the record."""

from functools import cache
from typing import NamedTuple

import equinox as eqx
import numpy as np

from .._foundation.checks import require
from .smoothing_method import AbstractSmoother, LinearSmooth, cross_validation, even_step, require_cutoff

NAME = "LocalPolynomial"
GROWTH = 1.12  # from window to window in the search, about twenty a decade


class _Weights(NamedTuple):
    """Of a polynomial fit to one window: leverage of each of its samples, and gain of its slope at each of them."""

    leverage: np.ndarray
    slope_gain: np.ndarray


class LocalPolynomial(AbstractSmoother):
    """The value and slope, at each sample, of a polynomial fitted by least squares to the window around it.

    Near the ends the polynomial of the first or last window is used. Polynomials of the given order pass unchanged. Samples
    must be evenly spaced. Without window and cut-off the window of least cross-validation is taken.

    Args:
        cutoff_hz: frequency of which half of the amplitude passes [Hz]; the window is the one that comes nearest.
        window: length of the window, an odd number of samples; in place of `cutoff_hz`.
        order: of the polynomial, at least 1.

    Raises:
        InputError: when both window and cut-off are given, the order is below 1, or the window is even or not longer than
            order + 1.

    Source: A. Savitzky, M. J. E. Golay, Smoothing and differentiation of data by simplified least squares procedures,
    Analytical Chemistry 36(8), 1964; ends and frequency response: R. W. Schafer, What is a Savitzky-Golay filter?, IEEE
    Signal Processing Magazine 28(4), 2011.
    """

    cutoff_hz: float | None = eqx.field(static=True)
    window: int | None = eqx.field(static=True)
    order: int = eqx.field(static=True)

    def __init__(self, cutoff_hz: float | int | None = None, *, window: int | None = None, order: int = 3):
        require(order >= 1, f"{NAME}: the order is {order}. Give 1 or more, so that there is a slope.")
        require(cutoff_hz is None or window is None, f"{NAME}: give `cutoff_hz` or `window`, one of the two.")
        require(
            window is None or (window % 2 == 1 and window > order + 1),
            f"{NAME}: the window is {window} samples. Give an odd number of at least {_shortest(order)} for order {order}.",
        )
        self.cutoff_hz = None if cutoff_hz is None else float(cutoff_hz)
        self.window, self.order = window, order

    def linear(self, t, z):
        step, longest = even_step(t, NAME), len(z) - (len(z) + 1) % 2
        shortest = _shortest(self.order)
        require(
            self.window is None or self.window <= longest,
            f"{NAME}: the window is {self.window} samples and the record has {len(z)}. Give a shorter one.",
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
        """The odd window whose half-amplitude frequency, in cycles a sample, is nearest."""
        require_cutoff(frequency / step, _half(longest, self.order) / step, _half(shortest, self.order) / step, NAME)
        low, high = (shortest - 1) // 2, (longest - 1) // 2
        while high - low > 1:  # the side lobes never come up to a half, so longer windows pass less
            middle = (low + high) // 2
            low, high = (middle, high) if _passed(2 * middle + 1, self.order, frequency) >= 0.5 else (low, middle)
        return min((2 * h + 1 for h in (low, high)), key=lambda w: abs(_half(w, self.order) - frequency))

    def _score(self, z: np.ndarray, window: int) -> float:
        """Cross-validation of one window."""
        from scipy.signal import savgol_filter  # slow to import, and only smoothing needs it

        trace = float(np.sum(_spread(_weights(window, self.order).leverage, len(z))))
        squares = float(np.sum((z - savgol_filter(z, window, self.order)) ** 2))
        return cross_validation(squares, len(z), trace)

    def _fit(self, z: np.ndarray, window: int, step: float) -> LinearSmooth:
        """Value, slope and weights for one window."""
        from scipy.signal import savgol_filter

        weights = _weights(window, self.order)
        leverage = _spread(weights.leverage, len(z))  # a fit is a projection: its row's squares sum to the leverage
        return LinearSmooth(
            value=np.asarray(savgol_filter(z, window, self.order)),
            derivative=np.asarray(savgol_filter(z, window, self.order, deriv=1, delta=step)),
            trace=float(np.sum(leverage)),
            value_gain=leverage,
            derivative_gain=_spread(weights.slope_gain, len(z)) / step**2,
            cutoff_hz=_half(window, self.order) / step,
        )


def _shortest(order: int) -> int:
    """The shortest odd window that leaves something to smooth."""
    return order + 2 + (order + 1) % 2


def _candidates(shortest: int, longest: int) -> list[int]:
    """Odd windows from short to long, at even ratios."""
    windows = np.geomspace(shortest, longest, 2 + int(np.log(longest / shortest) / np.log(GROWTH)))
    return sorted({min(2 * int(w / 2) + 1, longest) for w in windows})


def _weights(window: int, order: int) -> _Weights:
    """Leverage and slope gain of a fit over samples one apart, from an orthonormal basis."""
    half = (window - 1) // 2
    x = np.arange(-half, half + 1) / half
    basis, triangle = np.linalg.qr(np.vander(x, order + 1, increasing=True))
    powers = np.arange(1, order + 1)
    slopes = np.concatenate([np.zeros((window, 1)), powers * np.vander(x, order, increasing=True)], axis=1) / half
    return _Weights(np.sum(basis**2, axis=1), np.sum(np.linalg.solve(triangle.T, slopes.T) ** 2, axis=0))


def _spread(of_window: np.ndarray, samples: int) -> np.ndarray:
    """A number for each sample of the record: the middle of the window inside, its halves at the ends."""
    half = (len(of_window) - 1) // 2
    whole = np.full(samples, of_window[half])
    whole[:half], whole[samples - half :] = of_window[:half], of_window[half + 1 :]
    return whole


def _passed(window: int, order: int, frequency: float) -> float:
    """The share of the amplitude that passes inside of the record, at a frequency in cycles a sample."""
    from scipy.signal import savgol_coeffs

    half = (window - 1) // 2
    return float(savgol_coeffs(window, order) @ np.cos(2 * np.pi * frequency * np.arange(-half, half + 1)))


@cache
def _half(window: int, order: int) -> float:
    """The frequency, in cycles a sample, of which half of the amplitude passes."""
    from scipy.optimize import brentq

    return float(np.asarray(brentq(lambda frequency: _passed(window, order, frequency) - 0.5, 0.0, 0.5)))
