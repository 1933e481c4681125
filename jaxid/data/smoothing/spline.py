"""Smoothing by a cubic spline with a penalty on its curvature."""

from typing import NamedTuple

import equinox as eqx
import numpy as np
import scipy

from .method import AbstractSmoother, LinearSmooth, best_cutoff, cross_validation, require_cutoff

SMOOTHING_SPLINE = "SmoothingSpline"
# Number of columns of weights computed at a time (chosen), so that time and memory grow with the
# record's length instead of its square.
BLOCK = 256


class _Bands(NamedTuple):
    """The two band matrices of the spline, upper bands in LAPACK's order.

    Attributes:
        steps: steps between samples, in units of their mean, shape (time - 1,).
        R: integral of products of linear B-splines, three bands.
        QQ: products `Q'Q` of the second-difference matrix, three bands.
    """

    steps: np.ndarray
    R: np.ndarray
    QQ: np.ndarray


class SmoothingSpline(AbstractSmoother):
    """Natural cubic spline that minimises `sum_i (z_i - f(t_i))^2 + lambda integral f''(t)^2 dt`.

    Samples may be unevenly spaced. Straight lines pass unchanged. The cut-off determines the
    penalty: for even samples with a step h the share of the amplitude that passes at a frequency w
    [rad/s] is `1/(1 + 3 (lambda/h^3) (2 - 2 cos wh)^2 / (2 + cos wh))`; for uneven samples h is the
    mean step.

    Args:
        cutoff_hz: frequency at which half of the amplitude passes [Hz]; when left out, the
            frequency of least cross-validation.

    Source: C. H. Reinsch, Smoothing by spline functions, Numerische Mathematik 10, 1967; P. J.
    Green, B. W. Silverman, Nonparametric Regression and Generalized Linear Models, Chapman & Hall
    1994, section 2.3. (SciPy's `make_smoothing_spline` is the same spline, but returns neither
    its penalty nor its weights, from which the noise is computed.)
    """

    cutoff_hz: float | None = eqx.field(static=True)

    def __init__(self, cutoff_hz: float | int | None = None):
        self.cutoff_hz = None if cutoff_hz is None else float(cutoff_hz)

    def linear(self, t, z):
        step = float(np.mean(np.diff(t)))
        bands = _bands(np.diff(t) / step)
        lowest, highest = 0.25 / (t[-1] - t[0]), 0.5 / step
        require_cutoff(self.cutoff_hz, lowest, highest, SMOOTHING_SPLINE)

        def score(cutoff):
            penalty = _penalty(cutoff * step)
            squares = float(np.sum((z - _fit(z[:, None], penalty, bands)[0][:, 0]) ** 2))
            return cross_validation(squares, len(z), _trace(penalty, bands))

        cutoff = best_cutoff(score, lowest, highest) if self.cutoff_hz is None else self.cutoff_hz
        penalty = _penalty(cutoff * step)
        value, slope = _fit(z[:, None], penalty, bands)
        value_gain, slope_gain = _gains(bands.steps, penalty)
        return LinearSmooth(
            value=value[:, 0],
            derivative=slope[:, 0] / step,
            trace=_trace(penalty, bands),
            value_gain=value_gain,
            derivative_gain=slope_gain / step**2,
            cutoff_hz=float(cutoff),
        )


def _penalty(frequency: float) -> float:
    """Penalty, for steps of one, at which half of the amplitude passes at a frequency in cycles per
    sample.
    """
    cosine = np.cos(2 * np.pi * frequency)
    return float((2.0 + cosine) / (3.0 * (2.0 - 2.0 * cosine) ** 2))


def _bands(h: np.ndarray) -> _Bands:
    """Return the matrices R and Q'Q of Green and Silverman, section 2.1.2, for steps h."""
    a, b = 1.0 / h[:-1], 1.0 / h[1:]
    R, QQ = np.zeros((3, len(h) - 1)), np.zeros((3, len(h) - 1))
    R[2], R[1, 1:] = (h[:-1] + h[1:]) / 3.0, h[1:-1] / 6.0
    QQ[2] = a**2 + (a + b) ** 2 + b**2
    QQ[1, 1:] = -b[:-1] * (a + b)[:-1] - a[1:] * (a + b)[1:]
    QQ[0, 2:] = b[:-2] * a[2:]
    return _Bands(h, R, QQ)


def _fit(z: np.ndarray, penalty: float, bands: _Bands) -> tuple[np.ndarray, np.ndarray]:
    """Value and slope at the samples of the splines through the columns of z, shape (time,
    column).
    """
    h = bands.steps[:, None]
    curvature = np.diff(np.diff(z, axis=0) / h, axis=0)
    bend = scipy.linalg.solveh_banded(bands.R + penalty * bands.QQ, curvature)
    bend = np.pad(bend, ((1, 1), (0, 0)))  # the second derivative, zero at the ends
    jump = np.diff(np.pad(np.diff(bend, axis=0) / h, ((1, 1), (0, 0))), axis=0)
    value = z - penalty * jump
    chord = np.diff(value, axis=0) / h
    slope = np.concatenate(
        [chord - h / 6.0 * (2.0 * bend[:-1] + bend[1:]), chord[-1:] + h[-1:] / 6.0 * bend[-2:-1]]
    )
    return value, slope


def _trace(penalty: float, bands: _Bands) -> float:
    """Trace of H, `N - d log det(R + penalty Q'Q) / d log penalty`, by a central difference with an
    error of 1e-6.
    """

    def log_det(weight):
        return 2.0 * np.sum(np.log(scipy.linalg.cholesky_banded(bands.R + weight * bands.QQ)[2]))

    return float(
        len(bands.steps)
        + 1
        - (log_det(penalty * np.exp(1e-3)) - log_det(penalty * np.exp(-1e-3))) / 2e-3
    )


def _gains(steps: np.ndarray, penalty: float) -> tuple[np.ndarray, np.ndarray]:
    """Sums of squares of the rows of the weights of value and slope.

    Weights decay as `exp(-n / (sqrt(2) lambda^(1/4)))` over n samples, so that each block of
    columns needs only its neighbourhood, where the weights are above 1e-13.
    """
    samples = len(steps) + 1
    reach = 8 + int(30.0 * np.sqrt(2.0) * (penalty / np.min(steps) ** 3) ** 0.25)
    gains = np.zeros((2, samples))
    for start in range(0, samples, BLOCK):
        count = min(BLOCK, samples - start)
        low, high = max(0, start - reach), min(samples, start + count + reach)
        bands = _bands(steps[low : high - 1])
        weights = _fit(np.eye(high - low, count, low - start), penalty, bands)
        gains[:, low:high] += [np.sum(column**2, axis=1) for column in weights]
    return gains[0], gains[1]
