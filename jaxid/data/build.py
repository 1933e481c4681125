"""`record`: check measured numbers, convert them to SI and return a `Record`."""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._foundation.checks import InputError, require, require_float64, require_known, require_unique
from .._foundation.host import to_device
from .._foundation.types import Array
from .arguments import by_name, channel_names, text, texts_by_name
from .frame import columns_of, is_frame
from .record import Record
from .titles import units_of_titles
from .units import to_si

TIME = "t"


def record(
    t: Any,
    u: Any = None,
    z: Any = None,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    time: str = TIME,
    units: Mapping[str, str] | None = None,
    name: str = "",
    constants: Mapping[str, Any] | None = None,
) -> Record:
    """Return the record of one manoeuvre, from measured numbers.

    NaN in an output marks a missing sample: its mask becomes False and its value 0.

        record(t, u, z, inputs=("force",), outputs=("x",), units={"x": "mm"})
        record(frame, inputs=("force",), outputs=("x",), time="seconds")

    Args:
        t: time, shape (time,) [s, or `units["t"]`], strictly increasing; or a DataFrame with all
            channels as columns, in place of the three arrays.
        u: inputs, shape (time, input), or (time,) for one [`units`]; None where there is no input.
        z: measured outputs, shape (time, output), or (time,) for one [`units`].
        inputs: names of the inputs.
        outputs: names of the outputs.
        time: name of the DataFrame's column of time, or of its index. Dates become seconds from
            the first sample.
        units: unit by name of channel or constant, or "t"; values are converted to SI with angles
            in radians.
        name: name of the record.
        constants: known quantities that are constant over the record, such as its mass, by dotted
            name [`units`, else SI].

    Returns:
        The record, in float64.

    Raises:
        InputError: when a channel has the wrong length or count, a value is not a real finite
            number (NaN is allowed in outputs), time does not increase, a name is used twice, a unit
            is unknown, an output has no valid sample, or JAX runs in float32.
    """
    require_float64()
    where = f"Record {name!r}" if text(name, "name", "The record") else "The record"
    units = texts_by_name(units, "units", where)
    constants = by_name(constants, "constants", where)
    inputs = channel_names(inputs, "inputs", where)
    outputs = channel_names(outputs, "outputs", where)
    all_names = (TIME, *inputs, *outputs, *constants)
    require(
        len(outputs) > 0,
        f"{where} has no output, so there is nothing to fit. Name at least one in `outputs`.",
    )
    require_unique("channel", all_names)
    require_known("channel", units, all_names)

    if is_frame(t):
        require(
            u is None and z is None,
            f"{where}: a DataFrame holds all channels. Leave out `u` and `z`.",
        )
        t, u, z = columns_of(t, text(time, "time", where), inputs, outputs)
        titles = {name: name for name in (*inputs, *outputs)} | {TIME: time}
        units |= units_of_titles(titles, units, where)
    seconds = _times(t, units.get(TIME, ""), where)
    u = np.zeros((len(seconds), 0)) if u is None and not inputs else u
    u_si, input_units = _channels(u, "u", inputs, seconds, units, where)
    z_si, output_units = _channels(z, "z", outputs, seconds, units, where)
    _require_inputs_known(u_si, inputs, seconds, where)
    mask = ~np.isnan(z_si)
    for k in np.flatnonzero(~mask.any(axis=0)):
        raise InputError(
            f"{where}: output {outputs[k]!r} has no valid sample, all {len(seconds)} are NaN. "
            "Leave it out of `outputs`."
        )
    return Record(
        t=to_device(np.array(seconds)),  # a copy: it may be the user's array
        u=to_device(np.array(u_si)),
        z=to_device(np.where(mask, z_si, 0.0)),
        mask=to_device(mask),
        constants={
            key: _constant(key, value, units.get(key, ""), where)
            for key, value in constants.items()
        },
        inputs=inputs,
        outputs=outputs,
        input_units=input_units,
        output_units=output_units,
        names=(name,),
    )


def _times(t: Any, unit: str, where: str) -> np.ndarray:
    """Time in seconds, strictly increasing."""
    time = _numbers(t, [TIME], where)
    require(
        time.ndim == 1,
        f"{where}: time 't' has shape {time.shape}. Give one axis, shape (time,): make one record "
        "per manoeuvre, then `stack` them.",
    )
    require(
        len(time) >= 2, f"{where}: time 't' has {len(time)} samples. A record needs at least 2."
    )
    for row in np.flatnonzero(~np.isfinite(time))[:1]:
        raise InputError(
            f"{where}: time 't' is {time[row]} at row {row}. Remove the row, or fill in its time."
        )
    seconds, si = to_si(time, unit, TIME)
    require(
        si in ("", "s"),
        f"{where}: the unit {unit!r} of 't' is not a unit of time. Give 's', 'ms' or "
        "another unit of time.",
    )
    for row in np.flatnonzero(np.diff(seconds) <= 0)[:1] + 1:
        raise InputError(
            f"{where}: time 't' does not increase at row {row}: {seconds[row]:.10g} s after "
            f"{seconds[row - 1]:.10g} s. Remove repeated rows, sort by time, or cut the record in "
            "two where the clock was set back."
        )
    return seconds


def _channels(
    values: Any,
    argument: str,
    names: tuple[str, ...],
    time: np.ndarray,
    units: Mapping[str, str],
    where: str,
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Values of shape (time, channel) in SI units, and the units."""
    kind = "input" if argument == "u" else "output"
    table = _table(values, argument, names, time, where)
    for row, k in np.argwhere(np.isinf(table))[:1]:
        raise InputError(
            f"{where}: {kind} {names[k]!r} is infinite at row {row} (t = {time[row]:.10g} s). "
            + (
                "Replace it by its true value."
                if kind == "input"
                else "Write NaN where the sample is missing."
            )
        )
    converted = [
        to_si(column, units.get(n, ""), n) for n, column in zip(names, table.T, strict=True)
    ]
    si = np.stack([column for column, _ in converted], axis=1) if names else table
    return si, tuple(unit for _, unit in converted)


def _table(
    values: Any, argument: str, names: tuple[str, ...], time: np.ndarray, where: str
) -> np.ndarray:
    """Numbers of shape (time, channel), one column per name and one row per time."""
    kind = "input" if argument == "u" else "output"
    table = _numbers(values, names, where)
    table = table[:, None] if table.ndim == 1 and len(names) == 1 else table
    require(
        table.ndim == 2 and table.shape[1] == len(names),
        f"{where}: `{argument}` has shape {table.shape}, which does not fit its {len(names)} "
        f"{kind}s ({', '.join(names)}). Give shape (time, {len(names)}), one column per name.",
    )
    require(
        len(table) == len(time),
        f"{where}: `{argument}` ({', '.join(names)}) has {len(table)} rows and time 't' has "
        f"{len(time)}. Resample them to the same times, one row per time.",
    )
    return table


def _require_inputs_known(
    u: np.ndarray, inputs: tuple[str, ...], time: np.ndarray, where: str
) -> None:
    """Refuse missing samples of an input: the simulation needs it at every sample."""
    for row, k in np.argwhere(np.isnan(u))[:1]:
        count = np.isnan(u[:, k]).sum()
        raise InputError(
            f"{where}: input {inputs[k]!r} is NaN at row {row} (t = {time[row]:.10g} s), {count} "
            "times in all. An input must be known at every sample: interpolate it, or cut the "
            "record there."
        )


def _numbers(values: Any, names: Sequence[str], where: str) -> np.ndarray:
    """Values in float64; masked entries become NaN.

    Raises:
        InputError: when a value is complex or not a number.
    """
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(float), np.nan)
    try:
        array = np.asarray(values)
    except ValueError as error:  # a list of lists of different lengths
        raise InputError(
            f"{where}: the rows of {', '.join(names)} have different lengths. Give one value per "
            "channel in each row."
        ) from error
    require(
        array.dtype.kind != "c",
        f"{where}: {', '.join(names)} is complex. Give real and imaginary part as two channels.",
    )
    if array.dtype.kind not in "biuf":
        _require_numbers(array, names, where)
    try:
        return array.astype(float)
    except OverflowError as error:  # a whole number without limit
        raise InputError(
            f"{where}: {', '.join(names)} holds a number beyond {sys.float_info.max:.2g}. Correct "
            "it."
        ) from error


def _require_numbers(array: np.ndarray, names: Sequence[str], where: str) -> None:
    """Refuse the first item that is not a number."""
    for index in np.ndindex(array.shape):
        item = array[index]
        row, column = (*index, 0, 0)[:2]
        channel = names[column] if column < len(names) else ", ".join(names)
        require(
            isinstance(item, (bool, int, float, np.bool_, np.integer, np.floating)),
            f"{where}: {channel!r} holds {item!r} (type {type(item).__name__}) at row {row}, which "
            "is not a number. Convert it to a number; write NaN where an output is missing, and "
            "time in seconds from the start.",
        )


def _constant(key: str, value: Any, unit: str, where: str) -> Array:
    """One constant of the record in SI."""
    number = _numbers(value, [key], where)
    require(
        number.ndim == 0,
        f"{where}: constant {key!r} has shape {number.shape}. Give one number per record.",
    )
    require(
        bool(np.isfinite(number)),
        f"{where}: constant {key!r} is {number}. Give a finite number, or leave it out.",
    )
    return to_device(np.array(to_si(number, unit, key)[0]))
