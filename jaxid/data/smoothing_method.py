"""What every smoother is: linear, so that its weights say how much of the measurement noise stays."""

import abc
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import numpy as np

from .._foundation.checks import InputError, require
from .._foundation.grid import is_uniform

FEWEST = 8  # samples; with fewer there is no telling signal from noise
STAMPS = 1e-2  # relative: steps that differ by less are even, their time stamps rounded


class Smoothed(NamedTuple):
    """A smoothed signal, its derivative, and the noise in both.

    The smoothers are linear, `value = H z`; from white noise of standard deviation sigma in z stays `sigma ||row of H||`. The
    estimate `sigma^2 = ||z - H z||^2 / tr((I - H)'(I - H))` is right where the smoother leaves the signal alone, and too
    large where it does not. What the smoother takes off the signal itself is in none of these numbers.

    Attributes:
        value: smoothed signal, shape (time,) [unit].
        derivative: its rate, shape (time,) [unit/s].
        noise: standard deviation of the measurement noise [unit].
        value_noise: standard deviation of the noise that stays in `value`, shape (time,) [unit].
        derivative_noise: standard deviation of the noise in `derivative`, shape (time,) [unit/s].
        cutoff_hz: frequency of which half of the amplitude passes [Hz].
    """

    value: np.ndarray
    derivative: np.ndarray
    noise: float
    value_noise: np.ndarray
    derivative_noise: np.ndarray
    cutoff_hz: float


class LinearSmooth(NamedTuple):
    """A linear smoother at work: value, derivative, and what its weights say.

    Attributes:
        value: `H z`, shape (time,).
        derivative: `D z`, shape (time,).
        trace: of H, the number of parameters that it spends.
        value_gain: sum of squares of each row of H, shape (time,).
        derivative_gain: sum of squares of each row of D, shape (time,).
        cutoff_hz: frequency of which half of the amplitude passes [Hz].
    """

    value: np.ndarray
    derivative: np.ndarray
    trace: float
    value_gain: np.ndarray
    derivative_gain: np.ndarray
    cutoff_hz: float


class AbstractSmoother(eqx.Module):
    """A linear smoother of one signal. `method(t, z)` gives a `Smoothed`; `smooth` and `differentiate` take records."""

    @abc.abstractmethod
    def linear(self, t: np.ndarray, z: np.ndarray) -> LinearSmooth:
        """Smooth finite samples at increasing times, and say with which weights."""

    def __call__(self, t, z) -> Smoothed:
        """Smooth a signal and estimate its noise; works on the host, not under `jit`.

        Args:
            t: sample times, shape (time,) [s], strictly increasing.
            z: measured signal, shape (time,) [unit], without gaps.

        Returns:
            Value, derivative, and the noise before and after.

        Raises:
            InputError: when a sample is missing, there are fewer than 8, time does not increase, or the method cannot serve
                these times or its cut-off.
        """
        t, z = np.asarray(t, float), np.asarray(z, float)
        require(
            t.ndim == 1 and t.shape == z.shape,
            f"The times have shape {t.shape} and the signal {z.shape}. Give one axis of time for both, one signal at a time.",
        )
        require(len(t) >= FEWEST, f"There are {len(t)} samples to smooth. Give at least {FEWEST}.")
        for row in np.flatnonzero(~np.isfinite(z))[:1]:
            raise InputError(f"The signal is {z[row]} at row {row} (t = {t[row]:.10g} s). Fill the gap, or cut there.")
        require(bool(np.all(np.diff(t) > 0)), "The times do not increase strictly. Sort them and remove repeated rows.")
        found = self.linear(t, z)
        freedom = len(z) - 2.0 * found.trace + float(np.sum(found.value_gain))
        require(
            freedom > 1e-6 * len(z),
            f"A cut-off of {found.cutoff_hz:.4g} Hz passes all of the signal, noise included. Give a lower one.",
        )
        noise = float(np.sqrt(np.sum((z - found.value) ** 2) / freedom))
        left, left_in_rate = (
            noise * np.sqrt(np.maximum(gain, 0.0)) for gain in (found.value_gain, found.derivative_gain)
        )
        return Smoothed(found.value, found.derivative, noise, left, left_in_rate, found.cutoff_hz)


def even_step(t: np.ndarray, method: str) -> float:
    """The step of evenly sampled times [s], or a refusal."""
    steps = np.diff(t)
    mean = float(np.mean(steps))
    require(
        is_uniform(t, STAMPS),
        f"{method} needs evenly spaced samples, and the steps run from {steps.min():.6g} to {steps.max():.6g} s (row "
        f"{int(np.argmax(np.abs(steps - mean)))}). Bring the record to one clock, or use SmoothingSpline().",
    )
    return mean


def require_cutoff(cutoff_hz: float | None, lowest: float, highest: float, method: str) -> None:
    """Refuse a cut-off that the sampling or the length of the record does not allow."""
    require(
        cutoff_hz is None or lowest <= cutoff_hz <= highest,
        f"{method}: a cut-off of {cutoff_hz} Hz is outside of what this record allows, {lowest:.4g} to {highest:.4g} Hz. Choose "
        "one inside, or leave it out to have it estimated.",
    )


def cross_validation(squares: float, samples: int, trace: float) -> float:
    """Generalised cross-validation, `N ||z - H z||^2 / (N - tr H)^2`: the least is the best smoother of its family.

    Source: P. Craven, G. Wahba, Smoothing noisy data with spline functions, Numerische Mathematik 31, 1979.
    """
    return samples * squares / max(samples - trace, 1e-9 * samples) ** 2


def best_cutoff(score: Callable[[float], float], lowest: float, highest: float) -> float:
    """The cut-off of least score [Hz]: the best of twelve a decade, refined between its neighbours."""
    from scipy.optimize import minimize_scalar  # slow to import, and only smoothing needs it

    grid = np.geomspace(lowest, highest, 2 + int(12 * np.log10(highest / lowest)))
    k = int(np.argmin([score(cutoff) for cutoff in grid]))
    ends = np.log(grid[[max(k - 1, 0), min(k + 1, len(grid) - 1)]])
    found = minimize_scalar(
        lambda log: score(np.exp(log)), bounds=tuple(ends), method="bounded", options={"xatol": 1e-3}
    )
    return float(np.exp(found.x))
