"""Reading and writing of records as CSV files, with their units."""

import json
import math
import re
import tomllib
from collections.abc import Callable, Collection, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from ..._foundation.checks import InputError, require, require_known, require_unique
from ..arguments import channel_names
from ..build import TIME
from ..record import Record
from ..titles import parse_title, units_of_titles
from .assemble import assemble, clock, existing, parse_number, time_column
from .by_channel import columns_by_channel, signs_by_channel, units_by_channel
from .cells import UTF8, Layout, cells_of
from .document import write_new


def read_csv(
    path: str | Path,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    columns: Mapping[str, str] | None = None,
    time: str | None = None,
    sample_time: float | int | None = None,
    units: Mapping[str, str] | None = None,
    signs: Mapping[str, int] | None = None,
    units_row: bool = False,
    name: str | None = None,
    constants: Mapping[str, Any] | None = None,
    delimiter: str = ",",
    decimal: str = ".",
    encoding: str = UTF8,
    skip: int = 0,
) -> Record:
    """Read one record from a CSV file whose first line holds the names of its columns.

    The unit of a column is the first one given by: `units`; a file `<stem>.units.json` or
    `<stem>.units.toml` in the same folder (a mapping of names to units); the row of units; the
    header, as in `alpha [deg]` or `Time (ms)`, whose name is `alpha` or the complete title. A title
    that seems to hold a unit, such as `q_deg_s` or `speed (R)`, is refused where no unit is given.
    Empty cells in outputs are missing samples. Times may be dates in the form of ISO 8601, such as
    `2026-01-31T12:00:00.25`; they become seconds from the first row.

    Args:
        path: the file.
        inputs: names of the inputs, which are columns unless `columns` names others.
        outputs: names of the measured outputs, by the same rule.
        columns: the file's column by channel, where the two names differ, such as
            `{"alpha": "AOA_1"}`; `"t"` may be among them.
        time: name of the time column, "t" by default; give either `time` or `sample_time`.
        sample_time: time between samples [s], for a file without a time column.
        units: unit by name of channel, column or constant.
        signs: 1 or -1 by channel, such as `{"az": -1}` for one recorded positive up; 1 for the
            other channels.
        units_row: True when the second line holds units.
        name: name of the record; the stem of the file when left out.
        constants: known quantities that are constant over the record [`units`, else SI].
        delimiter: separator of the cells.
        decimal: sign before the decimals, "." or ",".
        encoding: of the file, such as "latin-1" or "utf-16".
        skip: number of lines above the header.

    Returns:
        The record, in SI units.

    Raises:
        InputError: when the file or a column is missing, both `time` and `sample_time` are given, a
            cell is not a number (the message names file, row and column), or `record` refuses the
            values.
    """
    path = existing(path)
    inputs = channel_names(inputs, "inputs", path.name)
    outputs = channel_names(outputs, "outputs", path.name)
    time = time_column(time, sample_time, path)
    wanted = (*inputs, *outputs) if time is None else (time, *inputs, *outputs)
    column_of = columns_by_channel(columns, wanted, path)
    given = units_by_channel(units, column_of, path)
    table, file_units, lines = named_columns(
        path,
        tuple(column_of.values()),
        given=[column_of.get(str(time) if name == TIME else name, "") for name in given],
        units_row=units_row,
        layout=Layout(delimiter, decimal, encoding, skip),
        time=None if time is None else column_of[time],
    )
    sign_of = signs_by_channel(signs, (*inputs, *outputs), path)
    values = {name: sign_of.get(name, 1) * table[column] for name, column in column_of.items()}
    if sample_time is not None:
        time, values[TIME] = TIME, clock(sample_time, len(lines), path)
    return assemble(
        values,
        str(time),
        inputs,
        outputs,
        {name: file_units[column] for name, column in column_of.items() if column in file_units},
        given,
        path.stem if name is None else name,
        constants,
    )


def write_csv(record: Record, path: str | Path) -> Path:
    """Write a single record; `read_csv` returns the same numbers, bit for bit.

    The header has the names with their units, as in `alpha [rad]`, and a missing sample is an empty
    cell. The name of the record and its constants are not written. The file is written under a
    temporary name and renamed when complete, so that no incomplete file remains.

    Args:
        record: a single record.
        path: path of the new file, in an existing folder.

    Returns:
        The path.

    Raises:
        InputError: when the record is a stack, the name of a channel does not fit a header, the
            file exists, or the folder does not.
    """
    require(
        not record.is_stack,
        "A CSV file holds a single record, and this is a stack. Write each `stack[i]` to its "
        "own file.",
    )
    names, units = (*record.inputs, *record.outputs), (*record.input_units, *record.output_units)
    require_csv_names(names)
    header = [
        "t [s]",
        *(f"{n} [{unit}]" if unit else n for n, unit in zip(names, units, strict=True)),
    ]
    columns = [np.asarray(record.t), *(np.asarray(record.channel(n)) for n in names)]
    lines = [",".join(header)]
    lines += [
        ",".join("" if np.isnan(x) else repr(float(x)) for x in row)
        for row in zip(*columns, strict=True)
    ]
    return write_new(path, "\n".join(lines) + "\n")


def require_csv_names(names: Sequence[str]) -> None:
    """Refuse names of channels that the header of a CSV file cannot hold.

    Raises:
        InputError: when a name has a comma, quote or bracket, or a blank at its end.
    """
    for n in names:
        require(
            not re.search(r'[\[\](),"\r\n]', n) and n == n.strip(),
            f"Channel {n!r} has a comma, quote or bracket, or a blank at its end. Rename it for "
            "CSV.",
        )


def named_columns(
    path: Path,
    wanted: Sequence[str],
    *,
    given: Collection[str],
    units_row: bool,
    layout: Layout,
    time: str | None = None,
) -> tuple[dict[str, np.ndarray], dict[str, str], list[int]]:
    """Return the requested columns of a CSV file, in the units of the file.

    Args:
        path: the file.
        wanted: names of the columns, with or without a unit in brackets.
        given: columns with a unit given in the call; the unit in a title is not read.
        units_row: True when the second line holds units.
        layout: delimiter, decimal sign, encoding, and lines above the header.
        time: the column that may hold dates.

    Returns:
        Numbers by name, NaN where a cell is empty; units by name, from the units file, else the row
        of units, else the header; and for each row its line in the file, counted from 1.

    Raises:
        InputError: when a column is missing or occurs twice, or a cell is not a number.
    """
    header, *body = cells_of(path, layout)
    titles = [cell.strip() for cell in header[1]]
    names = _names(titles, wanted)
    _require_columns(wanted, names, time, path)
    require_unique(f"column in {path.name}:", [n for n in names if n in wanted])
    file_units = {}
    if units_row:
        require(
            len(body) > 0,
            f"{path.name} has no row of units below its header. Leave out `units_row`.",
        )
        file_units |= _units_of_row(names, body.pop(0)[1])
    file_units |= _units_of_file(path, names)
    title_of = {n: titles[names.index(n)] for n in wanted}
    file_units |= units_of_titles(title_of, (*given, *file_units), path.name)
    columns = {
        n: _column(body, names.index(n), n, path, layout.decimal, dated=n == time) for n in wanted
    }
    return columns, file_units, [number for number, _ in body]


def _names(titles: Sequence[str], wanted: Sequence[str]) -> list[str]:
    """Names of the columns: the complete title where it is wanted, else without its unit."""
    return [title if title in wanted else parse_title(title).name for title in titles]


def _require_columns(wanted: Sequence[str], names: list[str], time: str | None, path: Path) -> None:
    """Refuse columns that the file does not have, with the argument that names another one."""
    for name in wanted:
        remedy = (
            "`time` names the column of time; a file without one needs `sample_time`."
            if name == time
            else "`columns` names the column of a channel with another name."
        )
        require_known(f"column in {path.name}", [name], names, remedy)


def _units_of_row(names: list[str], cells: list[str]) -> dict[str, str]:
    """Units by name of column, from the cells that are not blank."""
    return {name: cell.strip() for name, cell in zip(names, cells, strict=True) if cell.strip()}


def _column(
    lines: list[tuple[int, list[str]]],
    k: int,
    name: str,
    path: Path,
    decimal: str = ".",
    *,
    dated: bool = False,
) -> np.ndarray:
    """Numbers of one column, NaN where the cell is empty; dates in seconds from the first one."""
    values = np.empty(len(lines))
    read = _date_reader(lines[0][1][k]) if dated and lines else None
    for i, (line, cells) in enumerate(lines):
        text = cells[k].strip()
        try:
            values[i] = _number(text, decimal) if read is None else read(text)
        except (ValueError, TypeError) as error:  # TypeError: a date with and one without a zone
            wanted = "is not a number" if read is None else "is not a date like the first one"
            comma = " a decimal comma needs `decimal=','`," if "," in text else ""
            raise InputError(
                f"{path.name}, line {line}, column {name!r}: {text!r} {wanted}. Correct "
                f"the cell, or empty it where the sample is missing;{comma} a row of units needs "
                "`units_row=True`."
            ) from error
    return values


def _number(text: str, decimal: str) -> float:
    """Return the number in a cell, NaN for an empty one."""
    if decimal != "." and "." in text:
        raise ValueError("a point in a file with another decimal sign")
    return parse_number(text.replace(decimal, ".")) if text else math.nan


def _date_reader(first: str) -> Callable[[str], float] | None:
    """Return a function from a date to seconds since the first date; None if that is no date."""
    try:
        parse_number(first.strip())
    except ValueError:
        pass
    else:
        return None
    try:
        start = datetime.fromisoformat(first.strip())
    except ValueError:
        return None
    return lambda text: (datetime.fromisoformat(text) - start).total_seconds()


def _units_of_file(path: Path, names: Sequence[str]) -> dict[str, str]:
    """Units by name of column from the units file of a CSV file, or an empty mapping if it does not
    exist.
    """
    for suffix, parse in ((".json", json.loads), (".toml", tomllib.loads)):
        file = path.with_name(f"{path.stem}.units{suffix}")
        if file.is_file():
            try:
                units = parse(file.read_text(encoding="utf-8"))
            except ValueError as error:  # both parsers' errors are ValueErrors
                raise InputError(
                    f"{file.name} cannot be read: {error}. Correct it, or remove it."
                ) from error
            require(
                isinstance(units, dict) and all(isinstance(unit, str) for unit in units.values()),
                f'{file.name} is not a mapping of names to units. Write it as {{"alpha": "deg"}}.',
            )
            require_known(f"column in {path.name}", units, names, f"{file.name} names it.")
            return units
    return {}
