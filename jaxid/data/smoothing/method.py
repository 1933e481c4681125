"""Base class of the smoothers. They are linear, so that the noise of their result is known."""

import abc
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import numpy as np
import scipy

from ..._foundation.checks import InputError, require
from ..._foundation.grid import is_uniform

MIN_SAMPLES = 8  # fewer cannot separate signal from noise (chosen)
# relative difference of steps that is taken as rounding of the time stamps (chosen)
TIMESTAMP_RTOL = 1e-2


class Smoothed(NamedTuple):
    """A smoothed signal, its derivative, and the noise in both.

    The smoothers are linear, `value = H z`. White noise of standard deviation sigma in z causes
    noise of standard deviation `sigma ||row of H||` in the value. The estimate `sigma^2 =
    ||z - H z||^2 / tr((I - H)'(I - H))` is unbiased if the smoother does not change the signal, and
    too large if it does. The bias, the part of the signal that the smoother removes, is not
    included in any of these numbers.

    Attributes:
        value: smoothed signal, shape (time,) [unit].
        derivative: derivative of the signal, shape (time,) [unit/s].
        noise: standard deviation of the measurement noise [unit].
        value_noise: standard deviation of the noise in `value`, shape (time,) [unit].
        derivative_noise: standard deviation of the noise in `derivative`, shape (time,) [unit/s].
        cutoff_hz: frequency at which half of the amplitude passes [Hz].
    """

    value: np.ndarray
    derivative: np.ndarray
    noise: float
    value_noise: np.ndarray
    derivative_noise: np.ndarray
    cutoff_hz: float


class LinearSmooth(NamedTuple):
    """Value and derivative from a linear smoother, with sums of squares of its weights.

    Attributes:
        value: `H z`, shape (time,).
        derivative: `D z`, shape (time,).
        trace: trace of H, the effective number of parameters.
        value_gain: sum of squares of each row of H, shape (time,).
        derivative_gain: sum of squares of each row of D, shape (time,).
        cutoff_hz: frequency at which half of the amplitude passes [Hz].
    """

    value: np.ndarray
    derivative: np.ndarray
    trace: float
    value_gain: np.ndarray
    derivative_gain: np.ndarray
    cutoff_hz: float


class AbstractSmoother(eqx.Module):
    """A linear smoother of one signal.

    `method(t, z)` returns a `Smoothed`; `smooth` and `differentiate` apply it to records.
    """

    @abc.abstractmethod
    def linear(self, t: np.ndarray, z: np.ndarray) -> LinearSmooth:
        """Smooth finite samples at increasing times."""

    def __call__(self, t, z) -> Smoothed:
        """Smooth a signal and estimate its noise. Works on the host, not under `jit`.

        Args:
            t: sample times, shape (time,) [s], strictly increasing.
            z: measured signal, shape (time,) [unit], without gaps.

        Returns:
            Value and derivative, the noise of the signal, and the noise of both.

        Raises:
            InputError: when a sample is missing, there are fewer than 8, time does not increase, or
                the method does not accept these times or its cut-off.
        """
        t, z = np.asarray(t, float), np.asarray(z, float)
        require(
            t.ndim == 1 and t.shape == z.shape,
            f"The times have shape {t.shape} and the signal {z.shape}. Give one axis of time for "
            "both, one signal at a time.",
        )
        require(
            len(t) >= MIN_SAMPLES,
            f"There are {len(t)} samples to smooth. Give at least {MIN_SAMPLES}.",
        )
        for row in np.flatnonzero(~np.isfinite(z))[:1]:
            raise InputError(
                f"The signal is {z[row]} at row {row} (t = {t[row]:.10g} s). Fill the "
                "gap, or cut the record there."
            )
        require(
            bool(np.all(np.diff(t) > 0)),
            "The times do not increase strictly. Sort them and remove repeated rows.",
        )
        result = self.linear(t, z)
        dof = len(z) - 2.0 * result.trace + float(np.sum(result.value_gain))
        require(
            dof > 1e-6 * len(z),  # a share (chosen) below which the noise is not identifiable
            f"A cut-off of {result.cutoff_hz:.4g} Hz passes all of the signal, noise included. "
            "Give a lower one.",
        )
        noise = float(np.sqrt(np.sum((z - result.value) ** 2) / dof))
        value_noise, derivative_noise = (
            noise * np.sqrt(np.maximum(gain, 0.0))
            for gain in (result.value_gain, result.derivative_gain)
        )
        return Smoothed(
            *(result.value, result.derivative, noise, value_noise, derivative_noise),
            cutoff_hz=result.cutoff_hz,
        )


def even_step(t: np.ndarray, method: str) -> float:
    """Return the step of evenly sampled times [s]; uneven times are refused."""
    steps = np.diff(t)
    mean = float(np.mean(steps))
    require(
        is_uniform(t, TIMESTAMP_RTOL),
        f"{method} needs evenly spaced samples, and the steps run from {steps.min():.6g} to "
        f"{steps.max():.6g} s (row "
        f"{int(np.argmax(np.abs(steps - mean)))}). Resample the record to even times, or use "
        "SmoothingSpline().",
    )
    return mean


def require_cutoff(cutoff_hz: float | None, lowest: float, highest: float, method: str) -> None:
    """Refuse a cut-off below or above the limits of the record's length and sampling."""
    require(
        cutoff_hz is None or lowest <= cutoff_hz <= highest,
        f"{method}: a cut-off of {cutoff_hz} Hz is outside the range of this record, "
        f"{lowest:.4g} to {highest:.4g} Hz. Choose one inside, or leave it out to have it "
        "estimated.",
    )


def cross_validation(squares: float, samples: int, trace: float) -> float:
    """Generalised cross-validation, `N ||z - H z||^2 / (N - tr H)^2`.

    Its minimum selects the smoother of a family.

    Source: P. Craven, G. Wahba, Smoothing noisy data with spline functions, Numerische Mathematik
    31, 1979.
    """
    return samples * squares / max(samples - trace, 1e-9 * samples) ** 2


def best_cutoff(score: Callable[[float], float], lowest: float, highest: float) -> float:
    """Return the cut-off of least score [Hz].

    The best point of a grid of twelve per decade (chosen) is refined between its neighbours.
    """
    grid = np.geomspace(lowest, highest, 2 + int(12 * np.log10(highest / lowest)))
    k = int(np.argmin([score(cutoff) for cutoff in grid]))
    ends = np.log(grid[[max(k - 1, 0), min(k + 1, len(grid) - 1)]])
    minimum = scipy.optimize.minimize_scalar(
        lambda log: score(np.exp(log)),
        bounds=tuple(ends),
        method="bounded",
        options={"xatol": 1e-3},
    )
    return float(np.exp(minimum.x))
