"""CSV files of inputs alone: what was done, or shall be done, to fly a model with it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require, require_float64, require_known, require_unique
from .._foundation.types import Array, Float
from .io import clock, existing
from .io_csv import named_columns
from .units import convert, to_si

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
    time: str = "t",
    sample_time: float | int | None = None,
    units: Mapping[str, str] | None = None,
    units_row: bool = False,
    expect: Mapping[str, str] | None = None,
    delimiter: str = ",",
) -> InputHistory:
    """Read inputs from the named columns of a CSV file, on any grid of times, and bring them to other times if so asked.

    Units come as in `read_csv`: from `units`, a file beside it, the row of units, or the header written as `aileron [deg]`.

    Args:
        path: the file.
        t: times at which the inputs are wanted, shape (time,) [s]; those of the file when left out.
        inputs: columns, in the order in which the model wants them.
        hold: how they run between the rows where `t` has other times: "zero_order" (each value until the next) or
            "linear". Nothing is interpolated without it, and nothing beyond the file's ends.
        time: column of time.
        sample_time: time between rows [s], for a file without a column of time.
        units: unit by name of column.
        units_row: True when the second line holds units.
        expect: unit by name that the model wants, such as its `units()`; a column with a unit of another kind, or without
            one, is refused.
        delimiter: what separates the cells.

    Returns:
        Times, inputs in SI units, names and units.

    Raises:
        InputError: when the file or a column is missing, a cell is empty, infinite or no number, time does not increase, a
            unit is unknown or of the wrong kind, or `t` leaves the file's times, or has others and `hold` is not given;
            file, line and column are named.
    """
    require_float64()
    path = existing(path)
    require(
        not isinstance(inputs, str) and len(inputs) > 0,
        f"{path.name}: `inputs` is {inputs!r}. Give a tuple of column names, such as ('aileron',).",
    )
    require_unique("input", inputs)
    wanted = tuple(inputs) if sample_time is not None else (time, *inputs)
    columns, found, lines = named_columns(path, wanted, units_row=units_row, delimiter=delimiter)
    require(len(lines) > 0, f"{path.name} has no row below its header. Give at least one.")
    require_known(f"column of {path.name} with a unit", units or {}, wanted)
    found = {n: unit for n, unit in (found | dict(units or {})).items() if n in wanted}
    _require_numbers(columns, lines, path)
    if sample_time is not None:
        seconds = clock(sample_time, len(lines), path)
    else:
        seconds = _seconds(columns[time], found.get(time, ""), time, lines, path)
    converted = [_in_si(columns[n], n, found, expect or {}, path) for n in inputs]
    u = np.stack([column for column, _ in converted], axis=1)
    if t is not None:
        seconds, u = _at(np.asarray(t, float), seconds, u, hold, path)
    return InputHistory(jnp.asarray(seconds), jnp.asarray(u), tuple(inputs), tuple(unit for _, unit in converted))


def _require_numbers(columns: Mapping[str, np.ndarray], lines: Sequence[int], path: Path) -> None:
    """Every cell holds a finite number."""
    for name, column in columns.items():
        for row in np.flatnonzero(~np.isfinite(column))[:1]:
            what = "is empty" if np.isnan(column[row]) else "is infinite"
            raise InputError(
                f"{path.name}, line {lines[row]}, column {name!r}: the cell {what}. Time and inputs must be known in every "
                "row: fill in the value, or remove the row."
            )


def _seconds(values: np.ndarray, unit: str, time: str, lines: Sequence[int], path: Path) -> np.ndarray:
    """Times in seconds, strictly increasing."""
    seconds, si = to_si(values, unit, time)
    require(
        si in ("", "s"),
        f"{path.name}, column {time!r}: the unit {unit!r} is not one of time. Give 's', 'ms', 'min' or the like.",
    )
    for row in np.flatnonzero(np.diff(seconds) <= 0)[:1] + 1:
        raise InputError(
            f"{path.name}, line {lines[row]}, column {time!r}: time does not increase, {seconds[row]:.10g} s after "
            f"{seconds[row - 1]:.10g} s. Remove repeated rows, or sort by time."
        )
    return seconds


def _in_si(
    values: np.ndarray, name: str, found: Mapping[str, str], expect: Mapping[str, str], path: Path
) -> tuple[np.ndarray, str]:
    """One column in SI units, and its unit; of the kind that is expected."""
    unit, wanted = found.get(name, ""), expect.get(name, "")
    if not wanted:
        return to_si(values, unit, name)
    require(
        unit != "",
        f"{path.name}, column {name!r} states no unit, and the model takes {wanted!r}. Write the header as "
        f"'{name} [{wanted}]' with the unit of the numbers in the file, or give units={{{name!r}: ...}}.",
    )
    try:
        convert(values, unit, wanted, name)  # refuses another kind
    except InputError as error:
        raise InputError(f"{path.name}, column {name!r}: {error}") from error
    return to_si(values, unit, name)


def _at(
    t: np.ndarray, seconds: np.ndarray, u: np.ndarray, hold: Hold | None, path: Path
) -> tuple[np.ndarray, np.ndarray]:
    """The inputs at other times."""
    require(t.ndim == 1 and t.size > 0, f"{path.name}: `t` has shape {t.shape}. Give one axis, shape (time,).")
    require(bool(np.isfinite(t).all()), f"{path.name}: `t` holds a time that is not finite. Give times in seconds.")
    near = 1e-9 * max(float(np.ptp(seconds)), 1e-3)  # the same time, but for the digits with which it was written
    require(
        bool(t.min() >= seconds[0] - near and t.max() <= seconds[-1] + near),
        f"{path.name} holds inputs from {seconds[0]:.10g} to {seconds[-1]:.10g} s, and they are wanted from {t.min():.10g} to "
        f"{t.max():.10g} s. Choose times inside, or add rows to the file: nothing is continued beyond its ends.",
    )
    row = np.clip(np.searchsorted(seconds, t + near, side="right") - 1, 0, len(seconds) - 1)
    there = np.abs(seconds[row] - t) <= near
    if there.all():
        return t, u[row]
    missing = t[np.argmin(there)]
    require(
        hold in ("zero_order", "linear"),
        f"{path.name} has no row at {missing:.10g} s, {np.sum(~there)} of the {t.size} times have none, and `hold` is "
        f"{hold!r}. Leave `t` out to take the times of the file, or say how inputs run between rows: hold='zero_order' or "
        "hold='linear'.",
    )
    if hold == "zero_order":
        return t, u[row]
    return t, np.where(there[:, None], u[row], np.stack([np.interp(t, seconds, column) for column in u.T], axis=1))
