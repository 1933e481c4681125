"""CSV files of inputs alone, recorded or planned, for the simulation of a model."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import (
    InputError,
    require,
    require_float64,
    require_known,
    require_unique,
)
from ..._foundation.types import Array, Float
from ..units import convert, to_si
from .assemble import clock, existing, time_column
from .cells import Layout
from .csv import named_columns

Hold = Literal["zero_order", "linear"]


class InputHistory(NamedTuple):
    """Inputs over time, in SI units.

    Args:
        t: sample times, shape (time,) [s].
        u: inputs, shape (time, input) [`units`].
        inputs: names of the columns.
        units: SI units of the columns, "" where there is none.
    """

    t: Float[Array, " time"]
    u: Float[Array, "time input"]
    inputs: tuple[str, ...]
    units: tuple[str, ...]


def read_inputs(
    path: str | Path,
    t: Any = None,
    *,
    inputs: Sequence[str],
    hold: Hold | None = None,
    time: str | None = None,
    sample_time: float | int | None = None,
    units: Mapping[str, str] | None = None,
    units_row: bool = False,
    expect: Mapping[str, str] | None = None,
    delimiter: str = ",",
) -> InputHistory:
    """Read inputs from the named columns of a CSV file, on any grid of times.

    With `t` and `hold` the inputs are interpolated to other times. Units are found as in
    `read_csv`: from `units`, a units file in the same folder, the row of units, or the header, such
    as `aileron [deg]`.

    Args:
        path: the file.
        t: times of the result, shape (time,) [s]; the times of the file when left out.
        inputs: columns, in the order of the model's inputs.
        hold: interpolation between the rows, for times in `t` that the file does not have:
            "zero_order" (each value until the next) or "linear". Without it there is no
            interpolation. There is never an extrapolation beyond the file's ends.
        time: name of the time column, "t" by default; give either `time` or `sample_time`.
        sample_time: time between rows [s], for a file without a time column.
        units: unit by name of column.
        units_row: True when the second line holds units.
        expect: required unit by name, such as the model's `units()`; a column with a unit of
            another kind, or without a unit, is refused.
        delimiter: separator of the cells.

    Returns:
        Times, inputs in SI units, names and units.

    Raises:
        InputError: when the file or a column is missing, both `time` and `sample_time` are given, a
            cell is empty, infinite or not a number,
            time does not increase, a unit is unknown or of the wrong kind, `t` exceeds the file's
            times, or `t` has times that the file does not have and `hold` is not given. The message
            names file, line and column.
    """
    require_float64()
    path = existing(path)
    _require_names(inputs, path)
    time = time_column(time, sample_time, path)
    wanted = tuple(inputs) if time is None else (time, *inputs)
    columns, file_units, lines = named_columns(
        path, wanted, given=units or (), units_row=units_row, layout=Layout(delimiter)
    )
    require(len(lines) > 0, f"{path.name} has no row below its header. Give at least one.")
    given_units = dict(units or {})
    require_known(f"column of {path.name} with a unit", given_units, wanted)
    all_units = file_units | given_units
    column_units = {n: unit for n, unit in all_units.items() if n in wanted}
    _require_numbers(columns, lines, path)
    if sample_time is not None:
        seconds = clock(sample_time, len(lines), path)
    else:
        name = str(time)
        seconds = _seconds(columns[name], column_units.get(name, ""), name, lines, path)
    u, si = _all_in_si([columns[n] for n in inputs], inputs, column_units, expect or {}, path)
    if t is not None:
        seconds, u = _at(np.asarray(t, float), seconds, u, hold, path)
    return InputHistory(jnp.asarray(seconds), jnp.asarray(u), tuple(inputs), si)


def _require_names(inputs: Sequence[str], path: Path) -> None:
    """Refuse names of columns that are no tuple, or a name that occurs twice."""
    require(
        not isinstance(inputs, str) and len(inputs) > 0,
        f"{path.name}: `inputs` is {inputs!r}. Give a tuple of column names, such as ('aileron',).",
    )
    require_unique("input", inputs)


def _require_numbers(columns: Mapping[str, np.ndarray], lines: Sequence[int], path: Path) -> None:
    """Refuse a cell that is not a finite number."""
    for name, column in columns.items():
        for row in np.flatnonzero(~np.isfinite(column))[:1]:
            defect = "is empty" if np.isnan(column[row]) else "is infinite"
            raise InputError(
                f"{path.name}, line {lines[row]}, column {name!r}: the cell {defect}. Time and "
                "inputs must be known in every row: fill in the value, or remove the row."
            )


def _seconds(
    values: np.ndarray, unit: str, time: str, lines: Sequence[int], path: Path
) -> np.ndarray:
    """Times in seconds, strictly increasing."""
    seconds, si = to_si(values, unit, time)
    require(
        si in ("", "s"),
        f"{path.name}, column {time!r}: the unit {unit!r} is not a unit of time. Give 's', "
        "'ms' or another unit of time.",
    )
    for row in np.flatnonzero(np.diff(seconds) <= 0)[:1] + 1:
        raise InputError(
            f"{path.name}, line {lines[row]}, column {time!r}: time does not increase, "
            f"{seconds[row]:.10g} s after {seconds[row - 1]:.10g} s. Remove repeated rows, "
            "or sort by time."
        )
    return seconds


def _all_in_si(
    columns: Sequence[np.ndarray],
    names: Sequence[str],
    units: Mapping[str, str],
    expect: Mapping[str, str],
    path: Path,
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Columns in SI units, shape (time, column), and their units."""
    pairs = [
        _in_si(column, name, units, expect, path)
        for column, name in zip(columns, names, strict=True)
    ]
    return np.stack([values for values, _ in pairs], axis=1), tuple(unit for _, unit in pairs)


def _in_si(
    values: np.ndarray, name: str, units: Mapping[str, str], expect: Mapping[str, str], path: Path
) -> tuple[np.ndarray, str]:
    """One column in SI units, and its unit; a unit of another kind than expected is refused."""
    unit, wanted = units.get(name, ""), expect.get(name, "")
    if not wanted:
        return to_si(values, unit, name)
    require(
        unit != "",
        f"{path.name}, column {name!r} has no unit, and the model takes {wanted!r}. Write the "
        f"header as '{name} [{wanted}]' with the unit of the numbers in the file, or give "
        f"units={{{name!r}: ...}}.",
    )
    try:
        convert(values, unit, wanted, name)  # to refuse a unit of another kind
    except InputError as error:
        raise InputError(f"{path.name}, column {name!r}: {error}") from error
    return to_si(values, unit, name)


def _at(
    t: np.ndarray, seconds: np.ndarray, u: np.ndarray, hold: Hold | None, path: Path
) -> tuple[np.ndarray, np.ndarray]:
    """Return times and inputs at the times `t`."""
    require(
        t.ndim == 1 and t.size > 0,
        f"{path.name}: `t` has shape {t.shape}. Give one axis, shape (time,).",
    )
    require(
        bool(np.isfinite(t).all()),
        f"{path.name}: `t` holds a time that is not finite. Give times in seconds.",
    )
    # Tolerance (chosen) for times that differ only by the digits with which they were written.
    near = 1e-9 * max(float(np.ptp(seconds)), 1e-3)
    require(
        bool(t.min() >= seconds[0] - near and t.max() <= seconds[-1] + near),
        f"{path.name} holds inputs from {seconds[0]:.10g} to {seconds[-1]:.10g} s, and `t` "
        f"goes from {t.min():.10g} to {t.max():.10g} s. Choose times inside, or add rows to the "
        "file: inputs are not extrapolated.",
    )
    row = np.clip(np.searchsorted(seconds, t + near, side="right") - 1, 0, len(seconds) - 1)
    exact = np.abs(seconds[row] - t) <= near
    if exact.all():
        return t, u[row]
    missing = t[np.argmin(exact)]
    require(
        hold in ("zero_order", "linear"),
        f"{path.name} has no row at {missing:.10g} s, {np.sum(~exact)} of the {t.size} times have "
        f"none, and `hold` is {hold!r}. Leave `t` out to take the times of the file, or choose an "
        "interpolation between rows: hold='zero_order' or hold='linear'.",
    )
    if hold == "zero_order":
        return t, u[row]
    return t, np.where(
        exact[:, None], u[row], np.stack([np.interp(t, seconds, column) for column in u.T], axis=1)
    )
