"""Conventional inputs as samples at a rate: pulses, steps, sines, sweeps and multisines.

An input is a deviation from trim. It is scaled to a peak or to an energy, so that inputs can be
compared at equal cost.
"""

import math
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy

from .._foundation.checks import require, require_float64, require_known
from .._foundation.types import Array, Float, Int, Numbers
from ..data.signals import linear_sweep, pulses, sine, step

# Exponents of the norms that replace the maximum in turn (chosen, as in the source), and the number
# of samples per period of the highest harmonic.
NORMS, OVERSAMPLING = (4, 8, 16, 32, 64, 128), 8
# Width of a pulse times the circular frequency of the mode (Jategaonkar, Flight Vehicle System
# Identification, AIAA, 2015, section 2.4).
DOUBLET_WIDTH, MULTISTEP_WIDTH = 2.3, 1.6
MULTISTEP = {"3-2-1-1": (3.0, 2.0, 1.0, 1.0), "2-1-1": (2.0, 1.0, 1.0)}  # widths of the pulses


class InputSignal(eqx.Module):
    """Samples of one or more inputs, as deviations from trim.

    Attributes:
        t: sample times, uniform [s].
        u: deviations, zero beyond the signal [the units of the inputs].
        inputs: names of the inputs.
        name: name of the signal.
    """

    t: Float[Array, " time"]
    u: Float[Array, "time input"]
    inputs: tuple[str, ...] = eqx.field(static=True)
    name: str = eqx.field(static=True, default="")

    @property
    def sample_time(self) -> Float[Array, ""]:
        """Time between samples [s]."""
        return self.t[1] - self.t[0]

    @property
    def energy(self) -> Float[Array, " input"]:
        """Integral of the square of each input over time [unit^2 s]."""
        return jnp.sum(self.u**2, axis=0) * self.sample_time

    @property
    def peak(self) -> Float[Array, " input"]:
        """Largest absolute value of each input."""
        return jnp.max(jnp.abs(self.u), axis=0)

    @property
    def relative_peak_factor(self) -> Float[Array, " input"]:
        """Range over that of a sine of equal power, `(max - min) / (2 sqrt(2) rms)`; 1 for a
        sine.
        """
        rms = jnp.sqrt(jnp.mean(self.u**2, axis=0))
        span = jnp.max(self.u, axis=0) - jnp.min(self.u, axis=0)
        return span / (2.0 * math.sqrt(2.0) * rms)

    def with_peak(self, peak: float) -> "InputSignal":
        """Return the signal with the largest absolute value of all its inputs set to `peak`."""
        return self._scaled(peak / jnp.max(self.peak))

    def with_energy(self, energy: float) -> "InputSignal":
        """Return the signal with the energy of all its inputs together set to `energy`."""
        return self._scaled(jnp.sqrt(energy / jnp.sum(self.energy)))

    def _scaled(self, factor) -> "InputSignal":
        return InputSignal(self.t, self.u * factor, self.inputs, self.name)


def sample_times(duration: float, sample_time: float) -> Float[Array, " time"]:
    """Return uniform sample times from zero to the duration.

    Raises:
        InputError: when the duration is not finite, or not longer than two samples.
    """
    require_float64()
    require(math.isfinite(duration), f"The duration is {duration:g} s. Give a finite one.")
    require(
        duration > 2.0 * sample_time > 0.0,
        f"A duration of {duration:g} s has no three samples of {sample_time:g} s. Lengthen it.",
    )
    return jnp.asarray(sample_time * np.arange(round(duration / sample_time) + 1))


def combine(
    t: Float[Numbers, " time"],
    signals: Mapping[str, Float[Numbers, " time"]],
    inputs: Sequence[str],
    *,
    name: str = "",
) -> InputSignal:
    """Return one signal of several axes; inputs without a signal stay at trim.

    Args:
        t: sample times [s].
        signals: samples by name of the input.
        inputs: names of all inputs of the model.
        name: name of the signal.

    Raises:
        InputError: for an input that the model lacks.
    """
    require_known("input", signals, inputs)
    times = jnp.asarray(t)
    zero = jnp.zeros_like(times)
    columns = [jnp.asarray(signals.get(channel, zero)) for channel in inputs]
    return InputSignal(times, jnp.stack(columns, axis=1), tuple(inputs), name)


def alternating_pulses(
    t: Float[Array, " time"], widths: Float[Numbers, " pulse"] | Sequence[float], start=0.0
) -> Float[Array, " time"]:
    """Return pulses of alternating sign and unit height with free widths.

    Widths of (1, 1) are a doublet, of (3, 2, 1, 1) a 3-2-1-1.

    Args:
        t: sample times [s].
        widths: width of each pulse [s].
        start: time of the first edge [s].
    """
    widths = jnp.asarray(widths, float)
    edges = start + jnp.concatenate([jnp.zeros(1), jnp.cumsum(widths)])
    # An edge on a sample must not fall to either side by rounding.
    return pulses(t + 1e-9, edges, (-1.0) ** jnp.arange(widths.size))


def multisine_inputs(
    t: Float[Array, " time"],
    low: float,
    high: float,
    inputs: Sequence[str],
    *,
    powers: Float[Numbers, " harmonic"] | None = None,
    optimise: bool = True,
    name: str = "multisine",
) -> InputSignal:
    """Return orthogonal multisines, with every `n`-th harmonic of the duration for each of n
    inputs.

        u_j(t) = sum_k sqrt(P_k) cos(2 pi k t / T + phi_k),    T = duration

    The phases are Schroeder's, for given powers, or those that minimise the peak factor: norms of
    growing exponent replace the maximum. Each input is shifted in time to begin near zero, which
    keeps the inputs orthogonal, and has a root mean square of one.

    Source: P. Guillaume, J. Schoukens, R. Pintelon, I. Kollar, Crest-factor minimization using
    nonlinear Chebyshev approximation methods, IEEE Trans. Instrumentation and Measurement 40(6),
    1991.

    Args:
        t: sample times of one period; the last is the first of the next period [s].
        low, high: the band [Hz].
        inputs: names of the inputs.
        powers: relative power of each harmonic in the band; equal by default.
        optimise: minimise the peak factor; else Schroeder's phases.
        name: name of the signal.

    Raises:
        InputError: when the band has fewer harmonics than inputs.
    """
    times = np.asarray(t)
    period = float(times[-1] - times[0])
    harmonics = harmonics_within(low, high, period)
    require(
        harmonics.size >= len(inputs),
        f"From {low:g} to {high:g} Hz a period of {period:g} s has {harmonics.size} harmonics for "
        f"{len(inputs)} inputs. Lengthen the signal or widen the band.",
    )
    power = np.ones(harmonics.size) if powers is None else np.asarray(powers, float)
    require(
        power.shape == harmonics.shape and bool(np.all(power >= 0)) and bool(np.any(power > 0)),
        f"There are {harmonics.size} harmonics and {power.size} powers. Give one for each, not "
        "negative.",
    )
    columns = [
        _periodic(
            times - times[0], period, harmonics[j :: len(inputs)], power[j :: len(inputs)], optimise
        )
        for j in range(len(inputs))
    ]
    return InputSignal(jnp.asarray(times), jnp.asarray(np.stack(columns, 1)), tuple(inputs), name)


def harmonics_within(low: float, high: float, period: float) -> Int[np.ndarray, " harmonic"]:
    """Return the numbers of the harmonics of a period [s] from a lowest to a highest frequency
    [Hz].
    """
    # A band that ends at a harmonic includes it, whatever the rounding.
    return np.arange(max(math.ceil(low * period - 1e-6), 1), math.floor(high * period + 1e-6) + 1)


def _periodic(times, period, harmonics, power, optimise):
    """Return one multisine with a root mean square of one that begins near zero."""
    kept = power > 0
    harmonics, amplitude = harmonics[kept], np.sqrt(2.0 * power[kept] / np.sum(power))
    phases = _schroeder(power[kept] / np.sum(power))
    if optimise:
        phases = _low_peak(harmonics, amplitude, phases)
    angle = 2.0 * np.pi * harmonics[None] * np.linspace(0.0, 1.0, 4096)[:, None] + phases[None]
    signal = np.cos(angle) @ amplitude
    crossing = np.flatnonzero((signal[:-1] <= 0) & (signal[1:] > 0))[0]
    share = signal[crossing] / (signal[crossing] - signal[crossing + 1])
    turns = times / period + (crossing + share) / 4095.0
    return np.cos(2.0 * np.pi * harmonics[None] * turns[:, None] + phases[None]) @ amplitude


def _schroeder(share: np.ndarray) -> np.ndarray:
    """Return `phi_n = -2 pi sum_(l<n) (n - l) p_l` (Schroeder, 1970)."""
    return -2.0 * np.pi * np.cumsum(np.concatenate([[0.0], np.cumsum(share)[:-1]]))


def _low_peak(harmonics, amplitude, phases):
    """Return phases of a small peak, by quasi-Newton steps on norms of growing exponent."""
    count = OVERSAMPLING * int(harmonics[-1]) + 1
    angle = 2.0 * np.pi * harmonics[None] * np.linspace(0.0, 1.0, count, endpoint=False)[:, None]

    def norm(phases, exponent):
        signal = np.cos(angle + phases[None]) @ amplitude
        largest = np.max(np.abs(signal))
        ratio = signal / largest
        mean = np.mean(ratio**exponent)
        slope = -np.sin(angle + phases[None]) * amplitude[None]
        gradient = np.mean((ratio ** (exponent - 1))[:, None] * slope, axis=0)
        value = largest * mean ** (1.0 / exponent)
        return value, gradient * mean ** (1.0 / exponent - 1.0)

    def peak(phases):
        return np.max(np.abs(np.cos(angle + phases[None]) @ amplitude))

    best = phases
    for exponent in NORMS:
        phases = scipy.optimize.minimize(norm, phases, (exponent,), "L-BFGS-B", jac=True).x
        best = min((best, phases), key=peak)
    return best


def conventional_inputs(
    t: Float[Array, " time"],
    frequency: float,
    band: tuple[float, float],
    inputs: Sequence[str],
    *,
    axes: Sequence[str] | None = None,
    start: float = 0.0,
) -> dict[str, InputSignal]:
    """Return the usual inputs for a mode of a given frequency, all with a peak of one.

    With several axes, pulses, steps, sines and sweeps follow each other, one axis after the other
    in equal parts of the time, and multisines move all axes at once.

    Args:
        t: sample times [s].
        frequency: of the mode [Hz].
        band: lowest and highest frequency of sweep and multisine [Hz].
        inputs: names of the inputs of the model.
        axes: inputs that move; all by default.
        start: pause before the first movement of each axis [s].

    Raises:
        InputError: for an axis that is no input of the model.
    """
    axes = tuple(inputs) if axes is None else tuple(axes)
    require_known("input", axes, inputs)
    low, high = band
    elapsed = t - t[0]
    part = float(elapsed[-1]) / len(axes)
    width = MULTISTEP_WIDTH / (2.0 * math.pi * frequency)
    doublet_width = DOUBLET_WIDTH / (2.0 * math.pi * frequency)
    shapes = {
        "step": lambda t: step(t, start),
        "doublet": lambda t: alternating_pulses(t, (doublet_width, doublet_width), start),
        **{
            name: lambda t, widths=widths: alternating_pulses(t, width * np.array(widths), start)
            for name, widths in MULTISTEP.items()
        },
        "sine": lambda t: jnp.where(t >= start, sine(t - start, frequency), 0.0),
        "sweep": lambda t: linear_sweep(t - start, part - start, low, high),
    }
    signals = {}
    for name, shape in shapes.items():
        columns = {
            axis: jnp.where(
                (elapsed >= k * part) & (elapsed <= (k + 1) * part), shape(elapsed - k * part), 0.0
            )
            for k, axis in enumerate(axes)
        }
        signals[name] = combine(t, columns, inputs, name=name)
    for name, optimise in (("multisine, Schroeder", False), ("multisine", True)):
        moved = multisine_inputs(t, low, high, axes, optimise=optimise)
        columns = dict(zip(axes, moved.u.T, strict=True))
        signals[name] = combine(t, columns, inputs, name=name).with_peak(1.0)
    return signals
