"""`Record`: measurements of one manoeuvre, or of several manoeuvres padded to one length."""

import math
import operator
from collections.abc import Iterator, Mapping
from typing import Any, SupportsIndex

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from .._foundation.checks import require, require_known
from .._foundation.grid import holes
from .._foundation.host import columns_at, on_host
from .._foundation.notebook import Table, preformatted
from .._foundation.types import Array, Bool, Float, Int

INITIAL_STATE = "initial_state"


class Record(eqx.Module):
    """One manoeuvre, or a stack of manoeuvres with a leading `case` axis.

    Use `record(...)` to make one from measured numbers: it checks them and converts their units.
    This constructor does not check values, so that it works under `jit` and `vmap`.

    Padding rows of a stack repeat the last time (so that `diff(t)` is zero there) and the last
    input; their mask is False.

    Args:
        t: time, shape (*case, time) [s], strictly increasing up to the padding.
        u: inputs, shape (*case, time, input) [`input_units`].
        z: measured outputs, shape (*case, time, output) [`output_units`]; 0 where the mask is
            False, never NaN.
        mask: True where `z` is a valid sample, shape (*case, time, output).
        constants: known quantities that are constant over the record, such as its mass, and known
            values of states at its first sample, `initial_state.<state>`; each of shape (*case,)
            [SI].
        inputs: names of the inputs.
        outputs: names of the outputs.
        input_units: SI units of the inputs, "" where unknown or without dimension.
        output_units: SI units of the outputs, "" where unknown or without dimension.
        names: one name per case; a single record has one.
    """

    t: Float[Array, "*case time"]
    u: Float[Array, "*case time input"]
    z: Float[Array, "*case time output"]
    mask: Bool[Array, "*case time output"]
    constants: dict[str, Float[Array, "*case"]]
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)
    input_units: tuple[str, ...] = eqx.field(static=True)
    output_units: tuple[str, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)

    @property
    def is_stack(self) -> bool:
        """True when there is a case axis."""
        return self.t.ndim > 1

    @property
    def n_cases(self) -> int:
        """Number of records: the length of the case axis, 1 without such an axis."""
        return math.prod(self.t.shape[:-1])

    @property
    def samples(self) -> Int[Array, "*case"]:
        """Number of rows of each case without its padding, shape (*case,)."""
        return _samples(self.t)

    def anonymous(self) -> "Record":
        """The same record without its name, so that a function compiled for it can be used for
        every record of its shape.
        """
        return _replace(self, names=("",) * len(self.names))

    def channel(self, name: str) -> Float[Array, "*case time"]:
        """Signal of one input or output, NaN where an output has no valid sample.

        Args:
            name: name of the channel.

        Returns:
            Its values, shape (*case, time) [the channel's unit].

        Raises:
            InputError: when there is no such channel.
        """
        require_known("channel", [name], (*self.inputs, *self.outputs))
        if name in self.inputs:
            return _column(self.u, None, index=self.inputs.index(name))
        return _column(self.z, self.mask, index=self.outputs.index(name))

    def without(self, *names: str) -> "Record":
        """The record, or the stack, without some of its inputs and outputs.

        Args:
            names: names of the channels.

        Raises:
            InputError: when there is no such channel.
        """
        require_known("channel", names, (*self.inputs, *self.outputs))
        u, z = (
            [k for k, name in enumerate(group) if name not in names]
            for group in (self.inputs, self.outputs)
        )
        return _replace(
            self,
            u=columns_at(self.u, at=tuple(u)),
            z=columns_at(self.z, at=tuple(z)),
            mask=columns_at(self.mask, at=tuple(z)),
            inputs=tuple(self.inputs[k] for k in u),
            outputs=tuple(self.outputs[k] for k in z),
            input_units=tuple(self.input_units[k] for k in u),
            output_units=tuple(self.output_units[k] for k in z),
        )

    def window(self, start: int, stop: int | None = None) -> "Record":
        """Rows `start` to `stop - 1` of a single record, with their times unchanged.

        A part that starts later than the record has no constants `initial_state.<state>`.

        Args:
            start: first row, counted from 0.
            stop: row after the last one; the end of the record when left out.

        Returns:
            The part, with `stop - start` rows.

        Raises:
            InputError: when this is a stack, or the rows are not inside the record.
        """
        require(
            not self.is_stack,
            "A window is cut from one record, and this is a stack. Take `stack[i].window(...)`.",
        )
        rows = self.t.shape[-1]
        stop = rows if stop is None else stop
        require(
            isinstance(start, SupportsIndex) and isinstance(stop, SupportsIndex),
            f"Record {self.names[0]!r}: a window takes rows, and this is [{start}, {stop}). Give "
            "whole numbers; `np.searchsorted(record.t, seconds)` is the row of a time.",
        )
        require(
            0 <= start < stop <= rows,
            f"Record {self.names[0]!r}: the window [{start}, {stop}) is empty or outside its "
            f"{rows} samples. Choose 0 <= start < stop <= {rows}.",
        )
        return _rows(self, start, stop)

    def __getitem__(self, index: SupportsIndex) -> "Record":
        """One record of a stack without its padding.

        Under `jit`, where its length is not known, the record keeps its padding.

        Raises:
            InputError: when this is not a stack, it has no such case, or the index is a name.
        """
        require(
            not isinstance(index, str),
            f"A stack is indexed by the numbers of its cases. `record.channel({index!r})` is the "
            "signal of a channel.",
        )
        index = operator.index(index)
        require(
            self.is_stack,
            f"Record {self.names[0]!r} is a single record and has no cases to choose from.",
        )
        count = self.t.shape[0]
        require(
            -count <= index < count,
            f"There is no case {index} in a stack of {count}. Choose 0 to {count - 1}.",
        )
        leaves = {key: _case(getattr(self, key), index=index) for key in ("t", "u", "z", "mask")}
        constants = {key: _case(value, index=index) for key, value in self.constants.items()}
        case = _replace(self, **leaves, constants=constants, names=(self.names[index],))
        return case if isinstance(case.t, Tracer) else _rows(case, 0, int(case.samples))

    def __iter__(self) -> Iterator["Record"]:
        """The records of a stack in their order."""
        return (self[i] for i in range(self.n_cases))

    def __repr__(self) -> str:
        """Names, numbers of samples, duration, channels with units, share of missing samples."""
        return _describe(self) if _is_concrete(self) else eqx.tree_pformat(self)

    def _repr_html_(self) -> str:
        if not _is_concrete(self):
            return preformatted(repr(self))
        return _channel_table(self).html(above=_title_lines(self))

    def plot(self, case: int = 0) -> Any:
        """Return a figure of all channels over time, by matplotlib (`jaxid[report]`).

        Args:
            case: which record of a stack.
        """
        from ..report.figures_signals import signals

        return signals(self, case)


def _replace(record: Record, **changes: object) -> Record:
    """The record with some fields changed."""
    fields = {name: getattr(record, name) for name in Record.__dataclass_fields__}
    return Record(**{**fields, **changes})


def _rows(record: Record, start: int, stop: int) -> Record:
    """Rows of a single record."""
    keys = ("t", "u", "z", "mask")
    rows = {key: _slice(getattr(record, key), start=start, stop=stop) for key in keys}
    constants = record.constants if start == 0 else without_initial_state(record.constants)
    return _replace(record, **rows, constants=constants)


def without_initial_state(constants: Mapping[str, Any]) -> dict[str, Any]:
    """Return the constants of a record that hold at every sample of it.

    Args:
        constants: constants by name.
    """
    return {
        name: value for name, value in constants.items() if not name.startswith(f"{INITIAL_STATE}.")
    }


@on_host
def _samples(xp, t):
    """Return the number of rows of each case without its padding, which repeats the last time."""
    return 1 + xp.sum(xp.diff(t, axis=-1) > 0, axis=-1)


@on_host
def _column(xp, values, mask, index: int):
    """Return one channel, NaN where there is no valid sample."""
    column = values[..., index]
    return column if mask is None else xp.where(mask[..., index], column, xp.nan)


@on_host
def _case(xp, values, index: int):
    return values[index]


@on_host
def _slice(xp, values, start: int, stop: int):
    return values[start:stop]


def _is_concrete(record: Record) -> bool:
    """True if the arrays have values, and are not traced or replaced by a transformation."""
    arrays = (record.t, record.u, record.z, record.mask)
    return all(isinstance(x, jax.Array) and not isinstance(x, Tracer) for x in arrays)


def _describe(record: Record) -> str:
    """Description of a record with concrete values."""
    title, *time = _title_lines(record)
    return "\n".join(
        [
            title,
            *(f"  {line}" for line in time),
            f"  inputs:  {_channels(record.inputs, record.input_units)}",
            f"  outputs: {_channels(record.outputs, record.output_units)}",
        ]
    )


def _channel_table(record: Record) -> Table:
    """Smallest and largest value and share of missing samples of each channel, all records."""
    t = np.asarray(record.t).reshape(-1, record.t.shape[-1])
    flown = np.arange(t.shape[1]) < np.asarray(record.samples).reshape(-1, 1)
    u, z, mask = (
        np.asarray(part).reshape(*t.shape, part.shape[-1])[flown]
        for part in (record.u, record.z, record.mask)
    )
    columns = [("input", column) for column in u.T]
    columns += [("output", column[valid]) for column, valid in zip(z.T, mask.T, strict=True)]
    rows = []
    names = (*record.inputs, *record.outputs)
    units = (*record.input_units, *record.output_units)
    for name, unit, (role, values) in zip(names, units, columns, strict=True):
        ends = [f"{end(values):.4g}" for end in (np.min, np.max)] if values.size else ["", ""]
        missing = 100 * (1 - values.size / max(u.shape[0], 1))
        rows.append((name, role, *ends, f"{missing:.3g}", unit))
    heads = ("channel", "role", "minimum", "maximum", "missing [%]", "unit")
    return Table(heads, (7, 6, 11, 11, 11), tuple(rows))


def _title_lines(record: Record) -> list[str]:
    """Line on the size of a record, and one on the holes of its time base if there are any."""
    samples = np.asarray(record.samples).reshape(-1)
    t = np.asarray(record.t).reshape(-1, record.t.shape[-1])
    mask = np.asarray(record.mask).reshape(t.shape[0], t.shape[1], -1)
    valid = sum(int(case[:n].sum()) for case, n in zip(mask, samples, strict=True))
    missing = 1 - valid / max(int(samples.sum()) * mask.shape[-1], 1)
    title = (
        f"Record {record.names[0]!r}"
        if not record.is_stack
        else f"Stack of {record.n_cases} records"
    )
    if record.is_stack and any(record.names):
        title += (
            " (" + ", ".join(record.names[:4]) + (", ..." if len(record.names) > 4 else "") + ")"
        )
    size = (
        f"{samples.min()}"
        if samples.min() == samples.max()
        else f"{samples.min()} to {samples.max()}"
    )
    seconds = t[:, -1] - t[:, 0]
    span = (
        f"{seconds.min():.6g}"
        if seconds.min() == seconds.max()
        else f"{seconds.min():.6g} to {seconds.max():.6g}"
    )
    constants = f", constants {', '.join(record.constants)}" if record.constants else ""
    size = f"{title}: {size} samples, {span} s, {100 * missing:.3g} % of the samples "
    return [f"{size}missing{constants}", *_holes(record)]


def _holes(record: Record) -> list[str]:
    """Return a line on the holes of the time base, if there are any."""
    gaps = holes(np.asarray(record.t))
    if not gaps:
        return []
    longest = max(gaps, key=lambda hole: hole.end - hole.start)
    name = f" of {record.names[longest.case]!r}" if record.is_stack and any(record.names) else ""
    count = "1 hole:" if len(gaps) == 1 else f"{len(gaps)} holes, the longest"
    length = f"{longest.end - longest.start:.6g} s ({longest.ratio:.3g} median steps)"
    return [f"time:    {count} {length} between rows {longest.row} and {longest.row + 1}{name}"]


def _channels(names: tuple[str, ...], units: tuple[str, ...]) -> str:
    """Names with their units in brackets."""
    return (
        ", ".join(f"{n} [{unit}]" if unit else n for n, unit in zip(names, units, strict=True))
        or "(none)"
    )
