"""Initial shape parameters from training records: levels, centres, rates, times, frequencies."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Float

Samples = Float[np.ndarray, " sample"]
SIMULATED = "simulated "  # prefix of an output's name: output of the declared model
RESIDUAL = "residual "  # prefix of an output's name: measured minus simulated output
RECORD = "number of the record"  # name of the signal with the record number of each sample
# Samples beyond each bound of a hinge's level (chosen), and the smallest and largest share of all
# samples that they may be: a stall may fill one sample in twenty.
SAMPLES_BEYOND, LEAST_BEYOND, MOST_BEYOND = 20, 0.02, 0.1
REST_BAND = 0.1  # share of a signal's range (chosen): closer to its median the signal is at rest
# medians of the residual's spectrum, derived: white noise exceeds ten in one bin of a thousand
NOISE_FLOOR_FACTOR = 10.0
FEWEST_CYCLES = 3  # in a record (chosen): a slower oscillation is a drift rather than a resonance
MIN_PEAK_SPACING = 0.15  # share of a peak's frequency (chosen): a closer maximum is the same peak


def level_in(signal: Samples, fraction: float) -> Float[Array, ""]:
    """Return the level at a fraction of a signal's range."""
    low, high = np.min(signal), np.max(signal)
    return jnp.asarray(low + fraction * (high - low))


def centre_of(signal: Samples) -> Float[Array, ""]:
    """Return the centre of a signal: zero if zero lies between its quartiles, else its median."""
    low, middle, high = np.quantile(signal, [0.25, 0.5, 0.75])
    return jnp.asarray(0.0 if low <= 0.0 <= high else middle)


def max_deviation(signal: Samples) -> float:
    """Return the largest deviation of a signal from its centre; one if it is constant there."""
    deviation = float(np.max(np.abs(signal - np.asarray(centre_of(signal)))))
    return deviation if deviation > 0 else 1.0


def bend_range(signal: Samples) -> Float[np.ndarray, " 2"]:
    """Return the levels between which a change of slope is identifiable.

    Some samples lie beyond each level. Samples at rest are excluded if the signal is at rest most
    of the time.
    """
    band = REST_BAND * np.ptp(signal)
    if np.ptp(np.quantile(signal, (MOST_BEYOND, 1.0 - MOST_BEYOND))) < band:
        signal = signal[np.abs(signal - np.median(signal)) > band]
    share = np.clip(SAMPLES_BEYOND / signal.size, LEAST_BEYOND, MOST_BEYOND)
    return np.quantile(signal, (share, 1.0 - share))


def record_starts(signals: Mapping[str, Samples]) -> np.ndarray:
    """Return the rows at which a new record starts: the record number changes or time decreases."""
    t = signals["t"]
    return (
        np.flatnonzero((np.diff(t) <= 0) | (np.diff(signals.get(RECORD, np.zeros_like(t))) != 0))
        + 1
    )


def longest_record(signals: Mapping[str, Samples]) -> float:
    """Return the duration of the longest record [s]."""
    return max(float(np.ptp(t)) for t in np.split(signals["t"], record_starts(signals)))


def rates_in(signal: Samples, signals: Mapping[str, Samples]) -> Float[np.ndarray, " _"]:
    """Return the rates of a signal between neighbouring samples of one record.

    Args:
        signal: every recorded row of all records, one record after the other.
        signals: signals that include the time `t` [s].
    """
    within = np.delete(np.arange(signal.size - 1), record_starts(signals) - 1)
    return np.diff(signal)[within] / np.diff(signals["t"])[within]


def time_scale_of(signal: Samples, signals: Mapping[str, Samples], step: float) -> float:
    """Return the time scale of a signal [s]: standard deviation over root mean square of its rate.

    The time scale of a constant signal is one step.

    Args:
        signal: every recorded row of all records, one record after the other.
        signals: signals that include the time `t` [s].
        step: typical sample interval [s].
    """
    rate = np.sqrt(np.mean(rates_in(signal, signals) ** 2))
    return float(np.std(signal) / rate) if rate > 0 else step


def misfit_peak(
    signals: Mapping[str, Samples], step: float, rank: int, highest: float
) -> tuple[float, float]:
    """Return the frequency of a peak of the relative residual, and the spectral resolution.

        relative residual = sum over outputs of
            max(|residual|^2 - noise, 0) / (|simulated|^2 + noise)
        noise = ten medians of |residual|^2

    The relative residual compares the error of the declared model's frequency response with the
    response itself. A resonance of the declared model cancels in it: the residual is large at that
    resonance, whatever the model lacks. A residual within the noise floor is not counted.

    Args:
        signals: `t` [s], and `residual NAME` and `simulated NAME` of each output, every
            recorded row, one record after the other.
        step: typical sample interval [s].
        rank: rank of the peak, 1 being the highest; the surroundings of higher peaks are excluded.
        highest: upper limit of the frequency [rad/s].

    Returns:
        Frequency and resolution of the spectrum [rad/s]. Without such a peak both are a tenth of
        the highest frequency over the rank, so that different ranks give different initial values.
    """
    names = [name.removeprefix(RESIDUAL) for name in signals if name.startswith(RESIDUAL)]
    starts = record_starts(signals)
    length = max(part.size for part in np.split(signals["t"], starts))

    def power(signal):
        parts = np.split(signal, starts)
        windowed = [(part - np.mean(part)) * np.hanning(part.size) for part in parts]
        return np.sum([np.abs(np.fft.rfft(part, length)) ** 2 for part in windowed], axis=0)

    number = np.arange(length // 2 + 1)
    ratio, unit = np.zeros(number.size), 2.0 * np.pi / (step * length)
    for name in names:
        residual, simulated = power(signals[RESIDUAL + name]), power(signals[SIMULATED + name])
        noise = NOISE_FLOOR_FACTOR * np.median(residual)
        ratio += np.maximum(residual - noise, 0.0) / (simulated + noise) if noise > 0 else 0.0
    ratio[(number < FEWEST_CYCLES) | (unit * number > highest)] = 0.0
    for _ in range(rank - 1):
        peak = np.argmax(ratio)
        ratio[np.abs(number - peak) <= max(MIN_PEAK_SPACING * peak, FEWEST_CYCLES)] = 0.0
    if not np.any(ratio):
        return 0.1 * highest / rank, 0.1 * highest / rank
    return unit * float(np.argmax(ratio)), unit
