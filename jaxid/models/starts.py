"""Where the shape of an effect starts: levels, centres, rates and time scales read off the signals of the training records."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Float

Samples = Float[np.ndarray, " sample"]
SHOWN = "shown "  # before an output's name: what the declared model shows
RESIDUAL = "residual "  # and what it leaves of the measured one
RECORD = "number of the record"  # in which a sample stands
INSIDE = (0.1, 0.9)  # quantiles of a signal between which a bend can be told: samples enough on either side
RESTING = 0.1  # of a signal's range, within which it rests
NOISE = 10.0  # medians of the residual's spectrum
FEWEST_CYCLES = 3  # in a record: what is slower is no resonance but a drift
APART = 0.15  # of its frequency, within which a peak is one with a higher one


def level_in(signal: Samples, fraction: float) -> Float[Array, ""]:
    """The level at a fraction of a signal's range."""
    low, high = np.min(signal), np.max(signal)
    return jnp.asarray(low + fraction * (high - low))


def centre_of(signal: Samples) -> Float[Array, ""]:
    """About what a signal moves: zero where zero lies between its quartiles, else its median."""
    low, middle, high = np.quantile(signal, [0.25, 0.5, 0.75])
    return jnp.asarray(0.0 if low <= 0.0 <= high else middle)


def reach_of(signal: Samples) -> float:
    """How far a signal goes from its centre; one where it does not move."""
    reach = float(np.max(np.abs(signal - np.asarray(centre_of(signal)))))
    return reach if reach > 0 else 1.0


def inside_of(signal: Samples) -> Float[np.ndarray, " 2"]:
    """Between which levels a bend can be told: those with a tenth of the samples beyond; of a signal that rests most of the time,
    of the samples in which it does not."""
    reach = RESTING * np.ptp(signal)
    if np.ptp(np.quantile(signal, INSIDE)) < reach:
        signal = signal[np.abs(signal - np.median(signal)) > reach]
    return np.quantile(signal, INSIDE)


def begins_in(signals: Mapping[str, Samples]) -> np.ndarray:
    """Rows at which another record begins: its number is another, or, where that is not given, its time goes back."""
    t = signals["t"]
    return np.flatnonzero((np.diff(t) <= 0) | (np.diff(signals.get(RECORD, np.zeros_like(t))) != 0)) + 1


def longest_in(signals: Mapping[str, Samples]) -> float:
    """How long the longest record is [s]."""
    return max(float(np.ptp(t)) for t in np.split(signals["t"], begins_in(signals)))


def rates_in(signal: Samples, signals: Mapping[str, Samples]) -> Float[np.ndarray, " _"]:
    """Rates of a signal between neighbouring samples of one record.

    Args:
        signal: every valid sample of all records, one record after the other.
        signals: the time `t` among them [s].
    """
    within = np.delete(np.arange(signal.size - 1), begins_in(signals) - 1)
    return np.diff(signal)[within] / np.diff(signals["t"])[within]


def time_scale_of(signal: Samples, signals: Mapping[str, Samples], step: float) -> float:
    """How fast a signal moves: its standard deviation over the root mean square of its rate; one step where it stands still.

    Args:
        signal: every valid sample of all records, one record after the other.
        signals: the time `t` among them [s].
        step: typical time between two samples [s].
    """
    rate = np.sqrt(np.mean(rates_in(signal, signals) ** 2))
    return float(np.std(signal) / rate) if rate > 0 else step


def misfit_peak(signals: Mapping[str, Samples], step: float, rank: int, highest: float) -> tuple[float, float]:
    """Frequency at which the declared model errs most, beside what it shows there, and how well it is known.

        sum over outputs of max(|residual|^2 - noise, 0) / (|shown|^2 + noise),   noise = ten medians of |residual|^2

    The ratio is that of the declared frequency response to its own error, in which a resonance of the declared model cancels: its
    residual is large at its own resonance, whatever it lacks. What is no larger than noise may be does not count.

    Args:
        signals: `t` [s], and `residual NAME` and `shown NAME` of each output, every valid sample, one record after the other.
        step: typical time between two samples [s].
        rank: which peak, 1 being the highest; a lower one lies outside of those above it.
        highest: frequency up to which it is sought [rad/s].

    Returns:
        Frequency, and the resolution of the spectrum [rad/s]. Where there is no such peak, a tenth of the highest over the
        rank, and as much: starts that differ.
    """
    names = [name.removeprefix(RESIDUAL) for name in signals if name.startswith(RESIDUAL)]
    begins = begins_in(signals)
    length = max(one.size for one in np.split(signals["t"], begins))

    def power(signal):
        parts = [(one - np.mean(one)) * np.hanning(one.size) for one in np.split(signal, begins)]
        return np.sum([np.abs(np.fft.rfft(one, length)) ** 2 for one in parts], axis=0)

    number = np.arange(length // 2 + 1)
    ratio, unit = np.zeros(number.size), 2.0 * np.pi / (step * length)
    for name in names:
        residual, shown = power(signals[RESIDUAL + name]), power(signals[SHOWN + name])
        noise = NOISE * np.median(residual)  # white noise passes it in one bin of a thousand
        ratio += np.maximum(residual - noise, 0.0) / (shown + noise) if noise > 0 else 0.0
    ratio[(number < FEWEST_CYCLES) | (unit * number > highest)] = 0.0
    for _ in range(rank - 1):
        found = np.argmax(ratio)
        ratio[np.abs(number - found) <= max(APART * found, FEWEST_CYCLES)] = 0.0
    if not np.any(ratio):
        return 0.1 * highest / rank, 0.1 * highest / rank
    return unit * float(np.argmax(ratio)), unit
