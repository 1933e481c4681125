"""Optimal Fourier smoothing: a straight line plus a sine series with a Wiener filter."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import numpy as np
import scipy

from .method import (
    AbstractSmoother,
    LinearSmooth,
    best_cutoff,
    cross_validation,
    even_step,
    require_cutoff,
)

FOURIER = "Fourier"


class _Filter(NamedTuple):
    """A filter of the sine series, and the fit of the straight line.

    Attributes:
        share: share of each sine that passes, shape (time - 2,).
        wave: frequency of each sine [rad per sample], shape (time - 2,).
        line: basis of the line, one and the time from the middle, shape (time, 2) [samples].
        fit: matrix from the signal to the two coefficients of the line, shape (2, time).
    """

    share: np.ndarray
    wave: np.ndarray
    line: np.ndarray
    fit: np.ndarray


class Fourier(AbstractSmoother):
    """A straight line plus a sine series without its noisy part.

        f(t) = a + b t + sum_k s_k c_k sin(pi k t / T),    s_k = 1 / (1 + (k / k_c)^6)

    The difference of signal and line, continued as an odd function past its ends, has no jump in
    value or slope. Therefore the amplitudes of a smooth signal decrease as `k^-3` or faster, while
    those of white noise are constant. The Wiener filter for such a signal is `s_k`; at the cut-off,
    sine number `k_c = 2 T cutoff_hz`, signal and noise are equal. Line and series are fitted
    together, by least squares with these weights, so that the two end samples have the same
    influence as the others. Samples must be evenly spaced.

    Args:
        cutoff_hz: frequency at which half of the amplitude passes [Hz]; when left out, the
            frequency of least cross-validation.

    Source: E. A. Morelli, Estimating noise characteristics from flight test data using optimal
    Fourier smoothing, Journal of Aircraft 32(4), 1995; C. Lanczos, Applied Analysis, 1956, for the
    `k^-3`. In Morelli's method the line goes through the end points, and the cut-off is determined
    from models of both spectra.
    """

    cutoff_hz: float | None = eqx.field(static=True)

    def __init__(self, cutoff_hz: float | int | None = None):
        self.cutoff_hz = None if cutoff_hz is None else float(cutoff_hz)

    def linear(self, t, z):
        step = even_step(t, FOURIER)
        lowest, highest = 0.25 / (t[-1] - t[0]), 0.5 / step
        require_cutoff(self.cutoff_hz, lowest, highest, FOURIER)

        cutoff = (
            best_cutoff(_score(z, step), lowest, highest)
            if self.cutoff_hz is None
            else self.cutoff_hz
        )
        chosen = _filter(cutoff * step, len(z))
        value_gain, slope_gain = _gains(chosen)
        return LinearSmooth(
            value=_values(chosen, z),
            derivative=_slopes(chosen, z) / step,
            trace=_trace(chosen),
            value_gain=value_gain,
            derivative_gain=slope_gain / step**2,
            cutoff_hz=float(cutoff),
        )


def _share(frequency: float, samples: int) -> np.ndarray:
    """Share of each sine that passes, for a cut-off in cycles per sample."""
    return 1.0 / (1.0 + (np.arange(1, samples - 1) / (2.0 * (samples - 1) * frequency)) ** 6)


def _line(samples: int) -> np.ndarray:
    """Basis of the line: one, and the time from the middle [samples], shape (time, 2)."""
    return np.stack([np.ones(samples), np.arange(samples) - 0.5 * (samples - 1)], axis=1)


def _filter(frequency: float, samples: int) -> _Filter:
    """Filter with a cut-off in cycles per sample.

    The line is fitted with the inverse covariance of noise plus series as weight.
    """
    share, line = _share(frequency, samples), _line(samples)
    weighted = line.copy()
    weighted[1:-1] = _sines((1.0 - share)[:, None] * _sines(line[1:-1]))
    wave = np.pi * np.arange(1, samples - 1) / (samples - 1)
    return _Filter(share, wave, line, np.linalg.solve(line.T @ weighted, weighted.T))


def _score(z: np.ndarray, step: float) -> Callable[[float], float]:
    """Return the cross-validation as a function of the cut-off [Hz].

    One sine transform suffices: it is orthonormal, so that sums of squares are the same in both
    domains.
    """
    line, samples = _line(len(z)), len(z)
    ends, sines = line[[0, -1]], _sines(line[1:-1])
    z_ends, z_sines = z[[0, -1]], _sines(z[1:-1])

    def score(cutoff):
        share = _share(cutoff * step, samples)
        stopped = 1.0 - share
        weighted = (stopped * sines.T) @ sines + ends.T @ ends
        coefficients = np.linalg.solve(weighted, (stopped * sines.T) @ z_sines + ends.T @ z_ends)
        squares = np.sum((stopped * (z_sines - sines @ coefficients)) ** 2) + np.sum(
            (z_ends - ends @ coefficients) ** 2
        )
        line_part = np.linalg.solve(weighted, (stopped**2 * sines.T) @ sines + ends.T @ ends)
        return cross_validation(float(squares), samples, float(np.sum(share) + np.trace(line_part)))

    return score


def _values(chosen: _Filter, z: np.ndarray) -> np.ndarray:
    """Smoothed signal."""
    line = chosen.line @ (chosen.fit @ z)
    return line + _series(chosen, z - line)


def _slopes(chosen: _Filter, z: np.ndarray) -> np.ndarray:
    """Derivative of the smoothed signal, per sample."""
    coefficients = chosen.fit @ z
    return coefficients[1] + _rates(chosen, z - chosen.line @ coefficients)


def _trace(chosen: _Filter) -> float:
    """Trace of the smoothing matrix H."""
    beyond = chosen.line - _series(chosen, chosen.line)
    return float(np.sum(chosen.share) + np.sum(chosen.fit * beyond.T))


def _gains(chosen: _Filter) -> tuple[np.ndarray, np.ndarray]:
    """Sums of squares of the rows of the weights of value and slope.

    The weights are `A + B fit` with the weights A of the series alone, and `B = line - A line`, the
    contribution of the line.
    """
    flat, turn = np.sum(chosen.share**2), _doubled(chosen.share**2)
    slope = (chosen.wave * chosen.share) ** 2
    steep, bend = np.sum(slope), _doubled(slope)
    spans = len(chosen.line) - 1
    rise = np.broadcast_to([0.0, 1.0], chosen.line.shape)
    value = _with_line(chosen, _series, chosen.line, (flat - turn) / spans)
    return value, _with_line(chosen, _rates, rise, (steep + bend) / spans)


def _with_line(chosen: _Filter, series, line: np.ndarray, alone: np.ndarray) -> np.ndarray:
    """Sums of squares of the rows of `A + B fit` from the sums (`alone`) of the rows of A."""
    beyond = line - series(chosen, chosen.line)
    crossed = np.sum(beyond * series(chosen, chosen.fit.T), axis=1)
    return alone + 2.0 * crossed + np.sum(beyond @ (chosen.fit @ chosen.fit.T) * beyond, axis=1)


def _series(chosen: _Filter, z: np.ndarray) -> np.ndarray:
    """Filtered sine series of the columns of z; it is zero at the ends."""
    filtered = _sines((chosen.share * _sines(z[1:-1]).T).T)
    return np.pad(filtered, [(1, 1)] + [(0, 0)] * (z.ndim - 1))


def _rates(chosen: _Filter, z: np.ndarray) -> np.ndarray:
    """Derivative of the filtered sine series, per sample: a cosine series."""
    amplitudes = (chosen.wave * chosen.share * _sines(z[1:-1]).T).T * np.sqrt(2.0 / (len(z) - 1))
    return np.asarray(
        scipy.fft.dct(np.pad(0.5 * amplitudes, [(1, 1)] + [(0, 0)] * (z.ndim - 1)), type=1, axis=0)
    )


def _sines(z: np.ndarray) -> np.ndarray:
    """Orthonormal sine transform of the columns of z; it is its own inverse."""
    return np.asarray(scipy.fft.dst(z, type=1, axis=0, norm="ortho"))


def _doubled(weights: np.ndarray) -> np.ndarray:
    """`sum_k weights_k cos(2 pi k n / (time - 1))` at each sample n."""
    # The cosine transform has the sums at n / 2; they are even in n about the last sample.
    cosines = np.asarray(scipy.fft.dct(np.pad(0.5 * weights, 1), type=1))
    n = np.arange(len(cosines))
    return cosines[np.minimum(2 * n, 2 * (len(n) - 1 - n))]
