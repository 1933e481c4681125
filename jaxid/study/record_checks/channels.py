"""Checks of the time base and of single channels of a record."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..._foundation.grid import holes, is_uniform
from ...data.record import Record
from ...effects.sensor import SensorSaturation
from ...effects.sensor_quantisation import MIN_REPEATED_SHARE, grid_of
from .findings import Finding, FindingKind
from .thresholds import JITTER, MISSING_SHARE


class Measured(NamedTuple):
    """One record as NumPy arrays.

    Attributes:
        name: name or number of the record.
        t: times [s].
        u: inputs, shape (time, input).
        z: outputs, shape (time, output), NaN where a sample is missing.
        inputs, outputs: names of the channels.
        units: units by name of channel.
    """

    name: str
    t: np.ndarray
    u: np.ndarray
    z: np.ndarray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: dict[str, str]

    @property
    def step(self) -> float:
        """Median step [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def is_uniform(self) -> bool:
        """True if all steps are nearly equal."""
        return is_uniform(self.t, JITTER)


def measured(record: Record, number: int) -> Measured:
    """Return a single record as NumPy arrays."""
    names = (*record.inputs, *record.outputs)
    units = (*record.input_units, *record.output_units)
    return Measured(
        record.names[0] or str(number),
        np.asarray(record.t),
        np.asarray(record.u),
        np.where(np.asarray(record.mask), np.asarray(record.z), np.nan),
        record.inputs,
        record.outputs,
        dict(zip(names, units, strict=True)),
    )


def longest_piece(record: Record) -> Record:
    """Return the longest piece of a single record between two holes in time."""
    edges = [0, *(gap.row + 1 for gap in holes(np.asarray(record.t))), record.t.shape[0]]
    start = int(np.argmax(np.diff(edges)))
    return record if len(edges) == 2 else record.window(edges[start], edges[start + 1])


def time_base(record: Measured) -> Iterator[Finding]:
    """Findings on the time base: holes, else steps that differ."""
    gaps = holes(record.t)
    for gap in gaps:
        numbers = {"seconds": gap.end - gap.start, "ratio": gap.ratio}
        yield Finding(FindingKind.HOLE, record.name, (), numbers)
    if not gaps and not record.is_uniform:
        ratio = np.diff(record.t) / record.step
        numbers = {"longest": float(ratio.max()), "shortest": float(ratio.min())}
        yield Finding(FindingKind.UNEVEN_TIMES, record.name, (), numbers)


def single_channels(record: Measured) -> Iterator[Finding]:
    """Findings on each channel by itself: missing samples, one value, coarse steps, saturation."""
    for name, values in zip(record.inputs, record.u.T, strict=True):
        yield from constant(record, name, values)
    for name, values in zip(record.outputs, record.z.T, strict=True):
        yield from missing(record, name, values)
        valid = values[np.isfinite(values)]
        if not valid.size:
            continue
        stopped = list(constant(record, name, valid))
        yield from stopped
        if not stopped:
            yield from coarse(record, name, valid)
            yield from saturated(record, name, valid)


def missing(record: Measured, name: str, values: np.ndarray) -> Iterator[Finding]:
    """Finding on missing samples of an output."""
    absent = ~np.isfinite(values)
    if absent.mean() > MISSING_SHARE:
        valid = np.concatenate([[-1], np.flatnonzero(~absent), [len(values)]])
        after = np.clip(valid[1:], 0, len(values) - 1)
        before = np.clip(valid[:-1], 0, len(values) - 1)
        longest = np.max((record.t[after] - record.t[before])[np.diff(valid) > 1])
        numbers = {"share": float(absent.mean()), "longest": float(longest)}
        yield Finding(FindingKind.MISSING, record.name, (name,), numbers)


def constant(record: Measured, name: str, values: np.ndarray) -> Iterator[Finding]:
    """Finding on a channel with one value."""
    if np.ptp(values) == 0:
        yield Finding(FindingKind.CONSTANT, record.name, (name,), {"value": float(values[0])})


def coarse(record: Measured, name: str, values: np.ndarray) -> Iterator[Finding]:
    """Finding on an output on a grid, whose neighbouring samples are often equal."""
    step = grid_of(values)
    if step > 0 and np.mean(np.diff(values) == 0) > MIN_REPEATED_SHARE:
        numbers = {"step": step, "levels": float(np.unique(values).size)}
        yield Finding(FindingKind.QUANTISATION, record.name, (name,), numbers)


def saturated(record: Measured, name: str, values: np.ndarray) -> Iterator[Finding]:
    """Finding on an output that often has exactly its largest or smallest value.

    A rest at the start or the end of a record is no saturation (`SensorSaturation`).
    """
    lower = SensorSaturation(channel=name, end="lower")
    upper = SensorSaturation(channel=name, end="upper")
    for stop, extreme in ((lower, np.min(values)), (upper, np.max(values))):
        if stop.evident_in_data({name: (values,)}):
            numbers = {"value": float(extreme), "share": float(np.mean(values == extreme))}
            yield Finding(FindingKind.SATURATION, record.name, (name,), numbers)
