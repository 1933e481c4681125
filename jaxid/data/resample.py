"""`resample`: signals with clocks of their own on one clock, and the effect on their noise."""

import enum
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .._foundation.checks import InputError, require, require_known, require_unique
from .build import TIME, record
from .record import Record

# Chosen: share of a step up to which a sample stands on the new clock.
ON_CLOCK = 1e-6
# Chosen: share of a step below which a signal's own step makes it faster than the clock.
FASTER = 0.75


class Change(enum.Enum):
    """Treatment of a signal by `resample`.

    Attributes:
        COPIED: its samples stand on the new clock.
        PLACED: slower than the clock: each sample is moved to the nearest instant of the clock, by
            a straight line to its neighbour; all other instants are missing samples.
        AVERAGED: faster than the clock: the mean, over the step about the instant, of straight
            lines between the samples; where these end before, or no sample is within the step, a
            missing sample, or for an input a straight line.
        INTERPOLATED: an input: straight lines between its samples.
        HELD: an input: the last sample.
    """

    COPIED = "copied"
    PLACED = "placed"
    AVERAGED = "averaged"
    INTERPOLATED = "interpolated"
    HELD = "held"


class ChannelChange(NamedTuple):
    """Effect of `resample` on one signal.

    Attributes:
        name: name of the channel.
        change: treatment of the signal.
        before, after: numbers of samples, and of valid samples on the new clock.
        deviation: standard deviation of white noise after, over that before (root mean square).
        correlation: largest correlation of the noise of neighbouring valid samples.
    """

    name: str
    change: Change
    before: int
    after: int
    deviation: float
    correlation: float


class Resampled(NamedTuple):
    """Result of `resample`.

    Attributes:
        record: the signals on one clock.
        channels: effect on each signal.
    """

    record: Record
    channels: tuple[ChannelChange, ...]

    def __str__(self) -> str:
        width = max(len("channel"), *(len(row.name) for row in self.channels))
        lines = [
            f"{'channel':<{width}}  {'change':<12} {'before':>8} {'after':>8} {'noise':>7} "
            f"{'correlation':>12}"
        ]
        lines += [
            f"{row.name:<{width}}  {row.change.value:<12} {row.before:>8} {row.after:>8} "
            f"{row.deviation:>7.3f} {row.correlation:>12.2f}"
            for row in self.channels
        ]
        return "\n".join([*lines, "noise: deviation after over before, for white noise."])


def resample(
    signals: Mapping[str, tuple[Any, Any]],
    *,
    step: float | int,
    inputs: Sequence[str],
    outputs: Sequence[str],
    held: Sequence[str] = (),
    units: Mapping[str, str] | None = None,
    name: str = "",
    constants: Mapping[str, Any] | None = None,
) -> Resampled:
    """Return signals with clocks of their own as a record on one clock.

    The clock covers the time that all inputs cover. Outputs are not interpolated between their
    samples, as that would make their noise coloured and too small: slower ones get missing samples,
    faster ones are averaged. With m samples in a mean the deviation of white noise becomes
    about 1/sqrt(m) of it; a sample that is moved by the share f of its own step, 1 - f and f being
    the weights of two neighbours, has the deviation sqrt((1 - f)^2 + f^2) of the noise.

    Args:
        signals: times [s] and values by name, each pair of one length, times increasing; a value of
            NaN is left out.
        step: step of the new clock [s].
        inputs, outputs: names of the signals.
        held: inputs that keep their value until the next sample, as those of a converter.
        units: unit by name of channel or constant; times are in seconds.
        name: name of the record.
        constants: known quantities that are constant over the record.

    Returns:
        The record, and the effect on each signal; `print` shows it as a table.

    Raises:
        InputError: when a signal is missing, has other times than values or times that do not
            increase, the inputs have no time in common, or `record` refuses the values.
    """
    require(step > 0, f"The step is {step} s. Give a positive number of seconds.")
    require(
        TIME not in (units or {}),
        f"`units` gives {TIME!r} a unit, and the step and all times are in seconds. Convert them, "
        f"and leave {TIME!r} out.",
    )
    require_known("signal", (*inputs, *outputs), signals)
    require_known("input that is held", held, inputs)
    require_unique("channel", (*inputs, *outputs))
    clean = {key: _clean(key, *signals[key]) for key in (*inputs, *outputs)}
    clock = _clock([clean[key] for key in (inputs or outputs)], step)
    columns, changes = {}, []
    for key in (*inputs, *outputs):
        t, z = clean[key]
        if key in outputs:
            change, weights = _output_weights(t, clock, step)
        else:
            change, weights = _input_weights(t, clock, step, key in held)
        columns[key] = _weighted(z, weights)
        valid = int(np.isfinite(columns[key]).sum())
        changes.append(ChannelChange(key, change, len(t), valid, *_noise(*weights)))
    made = record(
        clock,
        np.stack([columns[key] for key in inputs], axis=1) if inputs else None,
        np.stack([columns[key] for key in outputs], axis=1),
        inputs=inputs,
        outputs=outputs,
        units=units,
        name=name,
        constants=constants,
    )
    return Resampled(made, tuple(changes))


def _clean(name: str, t: Any, values: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values of one signal without its missing samples."""
    try:
        t, values = np.asarray(t, float), np.asarray(values, float)
    except (TypeError, ValueError) as error:
        raise InputError(f"Signal {name!r} holds no numbers: {error}. Convert it first.") from error
    require(
        t.ndim == 1 and t.shape == values.shape,
        f"Signal {name!r} has times of shape {t.shape} and values of shape {values.shape}. Give "
        "one time for each value.",
    )
    valid = np.isfinite(values) & np.isfinite(t)
    t, values = t[valid], values[valid]
    require(len(t) > 0, f"Signal {name!r} has no valid sample. Leave it out.")
    for row in np.flatnonzero(np.diff(t) <= 0)[:1] + 1:
        raise InputError(
            f"Signal {name!r}: time {TIME!r} does not increase: {t[row]:.10g} s after "
            f"{t[row - 1]:.10g} s. Sort it, or remove repeated samples."
        )
    return t, values


Weights = tuple[list[int], list[np.ndarray]]  # by instant: first sample, weights from it on
NONE = (0, np.zeros(0))


def _clock(signals: Sequence[tuple[np.ndarray, np.ndarray]], step: float) -> np.ndarray:
    """Return the instants of the time that all signals cover."""
    start, stop = (float(end) for end in _common([t for t, _ in signals]))
    require(
        stop - start >= step,
        f"The signals have only {max(stop - start, 0.0):.6g} s in common, less than a step of "
        f"{step:g} s. Take signals of one manoeuvre, with times from one origin.",
    )
    return start + step * np.arange(int(np.floor((stop - start) / step + ON_CLOCK)) + 1)


def _common(times: Sequence[np.ndarray]) -> tuple[float, float]:
    return max(t[0] for t in times), min(t[-1] for t in times)


def _is_faster(t: np.ndarray, step: float) -> bool:
    """True if a signal is sampled clearly faster than the clock."""
    return len(t) > 1 and bool(np.median(np.diff(t)) < FASTER * step)


def _input_weights(
    t: np.ndarray, clock: np.ndarray, step: float, is_held: bool
) -> tuple[Change, Weights]:
    """Return the treatment of an input, which needs a value at every instant."""
    copied = _copied(t, clock, step)
    if all(len(weight) for weight in copied[1]):
        return Change.COPIED, copied
    if is_held:
        return Change.HELD, _last(t, clock)
    if _is_faster(t, step):
        return Change.AVERAGED, _filled(_means(t, clock, step), _lines(t, clock))
    return Change.INTERPOLATED, _lines(t, clock)


def _output_weights(t: np.ndarray, clock: np.ndarray, step: float) -> tuple[Change, Weights]:
    """Return the treatment of an output, which may have missing samples."""
    if _is_faster(t, step):
        return Change.AVERAGED, _means(t, clock, step)
    copied = _copied(t, clock, step)
    inside = int(np.sum((t >= clock[0] - 0.5 * step) & (t <= clock[-1] + 0.5 * step)))
    if sum(map(len, copied[1])) == inside:
        return Change.COPIED, copied
    return Change.PLACED, _nearest(t, clock, step)


def _weighted(z: np.ndarray, weights: Weights) -> np.ndarray:
    """Return the weighted values by instant, NaN where there are no weights."""
    rows = zip(*weights, strict=True)
    return np.array([w @ z[k : k + len(w)] if len(w) else np.nan for k, w in rows])


def _copied(t: np.ndarray, clock: np.ndarray, step: float) -> Weights:
    """Return weights of one for the samples that stand on the clock."""
    at = np.clip(np.searchsorted(t, clock - ON_CLOCK * step), 0, len(t) - 1)
    on_clock = np.abs(t[at] - clock) <= ON_CLOCK * step
    return _split(
        [(int(k), np.ones(1)) if on else NONE for k, on in zip(at, on_clock, strict=True)]
    )


def _last(t: np.ndarray, clock: np.ndarray) -> Weights:
    """Return weights of the last sample at or before each instant."""
    at = np.searchsorted(t, clock, side="right") - 1
    return _split([(int(k), np.ones(1)) if k >= 0 else NONE for k in at])


def _lines(t: np.ndarray, clock: np.ndarray) -> Weights:
    """Return weights of straight lines between samples; none outside of them."""
    return _split([_line(t, instant) for instant in clock])


def _line(t: np.ndarray, instant: float) -> tuple[int, np.ndarray]:
    """Return first sample and weights of a straight line at an instant."""
    k = min(int(np.searchsorted(t, instant, side="right")) - 1, len(t) - 2)
    if k < 0 or instant > t[-1] + 1e-9 * abs(t[-1]) or instant < t[0]:
        return NONE
    f = (instant - t[k]) / (t[k + 1] - t[k])
    return k, np.array([1.0 - f, f])


def _means(t: np.ndarray, clock: np.ndarray, step: float) -> Weights:
    """Return weights of the mean of straight lines over the step about each instant."""
    return _split([_mean(t, instant - 0.5 * step, instant + 0.5 * step) for instant in clock])


def _mean(t: np.ndarray, begin: float, end: float) -> tuple[int, np.ndarray]:
    """Return first sample and weights of the mean of straight lines from one time to another; none
    where the lines end before, or no sample is between.
    """
    near = ON_CLOCK * (end - begin)
    inside = np.searchsorted(t, [begin - near, end + near])
    if begin < t[0] - near or end > t[-1] + near or inside[0] == inside[1]:
        return NONE
    i, j = max(int(inside[0]) - 1, 0), min(int(inside[1]), len(t) - 1)
    knots = t[i : j + 1]
    low, high = np.clip(knots[:-1], begin, end), np.clip(knots[1:], begin, end)
    width, share = high - low, (0.5 * (low + high) - knots[:-1]) / np.diff(knots)
    weights = np.append(width * (1.0 - share), 0.0) + np.append(0.0, width * share)
    return i, weights / np.sum(weights)


def _nearest(t: np.ndarray, clock: np.ndarray, step: float) -> Weights:
    """Return weights of the line to the instant that is nearest to each sample."""
    rows: list[tuple[int, np.ndarray]] = [NONE] * len(clock)
    for instant in np.unique(np.round((t - clock[0]) / step).astype(int)):
        if 0 <= instant < len(clock):
            rows[instant] = _line(t, float(clock[instant]))
    return _split(rows)


def _filled(weights: Weights, others: Weights) -> Weights:
    """Return weights, those of others where there are none."""
    rows = zip(*weights, *others, strict=True)
    return _split([(a, w) if len(w) else (b, v) for a, w, b, v in rows])


def _split(rows: Sequence[tuple[int, np.ndarray]]) -> Weights:
    return [k for k, _ in rows], [w for _, w in rows]


def _noise(first: Sequence[int], weights: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return deviation and largest correlation of neighbours, for white noise of deviation one."""
    used = [(k, w) for k, w in zip(first, weights, strict=True) if len(w)]
    if not used:
        return float("nan"), 0.0
    power = [float(w @ w) for _, w in used]
    largest = 0.0
    for (a, v), (b, w), p, q in zip(used, used[1:], power, power[1:], strict=False):
        low, high = max(a, b), min(a + len(v), b + len(w))
        if high > low:
            shared = float(v[low - a : high - a] @ w[low - b : high - b])
            largest = max(largest, shared / np.sqrt(p * q))
    return float(np.sqrt(np.mean(power))), largest
