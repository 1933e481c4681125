"""Reading and writing of records as CSV files, with their units."""

import codecs
import csv
import itertools
import json
import math
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..._foundation.checks import InputError, require, require_known, require_unique
from ..arguments import channel_names, text
from ..build import TIME
from ..record import Record
from .assemble import assemble, clock, existing, parse_number
from .document import write_new

MOST_LINES = 10**6  # above a header (chosen)
UTF8 = "utf-8-sig"  # UTF-8, with or without its mark at the start


def read_csv(
    path: str | Path,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    time: str = "t",
    sample_time: float | int | None = None,
    units: Mapping[str, str] | None = None,
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
    header, as in `alpha [deg]`. Empty cells in outputs are missing samples. Times may be dates in
    the form of ISO 8601, such as `2026-01-31T12:00:00.25`; they become seconds from the first row.

    Args:
        path: the file.
        inputs: columns that are inputs.
        outputs: columns that are measured outputs.
        time: name of the time column.
        sample_time: time between samples [s], for a file without a time column.
        units: unit by name of column or constant.
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
        InputError: when the file or a column is missing, a cell is not a number (the message names
            file, row and column), or `record` refuses the values.
    """
    path = existing(path)
    inputs = channel_names(inputs, "inputs", path.name)
    outputs = channel_names(outputs, "outputs", path.name)
    text(time, "time", path.name)
    wanted = (*inputs, *outputs) if sample_time is not None else (time, *inputs, *outputs)
    columns, file_units, lines = named_columns(
        path,
        wanted,
        units_row=units_row,
        layout=Layout(delimiter, decimal, encoding, skip),
        time=None if sample_time is not None else time,
    )
    if sample_time is not None:
        time, columns[TIME] = TIME, clock(sample_time, len(lines), path)
    return assemble(
        columns,
        time,
        inputs,
        outputs,
        file_units,
        units,
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
        InputError: when the record is a stack, the file exists, or the folder does not.
    """
    require(
        not record.is_stack,
        "A CSV file holds a single record, and this is a stack. Write each `stack[i]` to its "
        "own file.",
    )
    names, units = (*record.inputs, *record.outputs), (*record.input_units, *record.output_units)
    for n in names:
        require(
            not re.search(r'[\[\](),"\r\n]', n) and n == n.strip(),
            f"Channel {n!r} has a comma, quote or bracket, or a blank at its end. Rename it for "
            "CSV.",
        )
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


class Layout(NamedTuple):
    """How a CSV file is written.

    Attributes:
        delimiter: separator of the cells.
        decimal: sign before the decimals.
        encoding: of the file.
        skip: number of lines above the header.
    """

    delimiter: str = ","
    decimal: str = "."
    encoding: str = UTF8
    skip: int = 0


def named_columns(
    path: Path,
    wanted: Sequence[str],
    *,
    units_row: bool,
    layout: Layout,
    time: str | None = None,
) -> tuple[dict[str, np.ndarray], dict[str, str], list[int]]:
    """Return the requested columns of a CSV file, in the units of the file.

    Args:
        path: the file.
        wanted: names of the columns.
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
    titles = [_title(cell, wanted) for cell in header[1]]
    names = [n for n, _ in titles]
    require_known(f"column in {path.name}", wanted, names)
    require_unique(f"column in {path.name}:", [n for n in names if n in wanted])
    file_units = {n: unit for n, unit in titles if unit}
    if units_row:
        require(
            len(body) > 0,
            f"{path.name} has no row of units below its header. Leave out `units_row`.",
        )
        file_units |= _units_of_row(names, body.pop(0)[1])
    file_units |= _units_of_file(path)
    columns = {
        n: _column(body, names.index(n), n, path, layout.decimal, dated=n == time) for n in wanted
    }
    return columns, file_units, [number for number, _ in body]


def _units_of_row(names: list[str], cells: list[str]) -> dict[str, str]:
    """Units by name of column, from the cells that are not blank."""
    return {name: cell.strip() for name, cell in zip(names, cells, strict=True) if cell.strip()}


def cells_of(path: Path, layout: Layout) -> list[tuple[int, list[str]]]:
    """Lines of a CSV file that are not blank, with their line numbers counted from 1.

    Raises:
        InputError: when the file is not CSV or is empty, or the numbers of cells differ.
    """
    _require_layout(path, layout)
    try:
        with path.open(newline="", encoding=layout.encoding) as file:
            skipped = sum(1 for _ in itertools.islice(file, layout.skip))
            reader = csv.reader(file, delimiter=layout.delimiter)
            lines = [
                (reader.line_num + skipped, cells)
                for cells in reader
                if any(cell.strip() for cell in cells)
            ]
    except (UnicodeError, csv.Error) as error:
        name = "UTF-8" if layout.encoding == UTF8 else layout.encoding
        raise InputError(
            f"{path.name} is not a CSV file in {name}: {error}. Save it again in UTF-8, or give "
            "`encoding`."
        ) from error
    require(
        len(lines) > 0, f"{path.name} is empty. Its first line must hold the names of the columns."
    )
    width = len(lines[0][1])
    for number, cells in lines:
        require(
            len(cells) == width,
            f"{path.name}, line {number}: {len(cells)} cells, and the header has {width}. Give "
            "every line as many cells as the header; numbers take a decimal point, not a comma.",
        )
    return lines


def _require_layout(path: Path, layout: Layout) -> None:
    """Refuse signs and numbers of lines that no file can have."""
    for argument in ("delimiter", "decimal", "encoding"):
        text(getattr(layout, argument), argument, path.name)
    require(
        len(layout.delimiter) == 1 and layout.delimiter not in '"\r\n',
        f"{path.name}: the delimiter is {layout.delimiter!r}. Give one character, such as ',' or "
        "';'.",
    )
    require(
        layout.decimal in (".", ","),
        f"{path.name}: the decimal sign is {layout.decimal!r}. Give '.' or ','.",
    )
    require(
        layout.decimal != layout.delimiter,
        f"{path.name}: {layout.decimal!r} is both `decimal` and `delimiter`. Give the delimiter of "
        "the file, such as ';'.",
    )
    require(
        not isinstance(layout.skip, bool)
        and isinstance(layout.skip, int)
        and 0 <= layout.skip <= MOST_LINES,
        f"{path.name}: `skip` is {layout.skip!r}. Give a number of lines from 0 on.",
    )
    try:
        codecs.lookup(layout.encoding)
    except (LookupError, ValueError) as error:
        raise InputError(
            f"{path.name}: the encoding {layout.encoding!r} is not known. Give a name such as "
            "'utf-8', 'latin-1' or 'utf-16'."
        ) from error


def _title(cell: str, wanted: Sequence[str]) -> tuple[str, str]:
    """Name and unit of a column from a header such as `alpha [deg]`."""
    text = cell.strip()
    match = re.fullmatch(r"(.*?)\s*\[([^\]]*)\]", text)
    return (text, "") if text in wanted or match is None else (match[1], match[2].strip())


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
            raise InputError(
                f"{path.name}, line {line}, column {name!r}: {text!r} {wanted}. Correct "
                "the cell, or empty it where the sample is missing; a row of units needs "
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


def _units_of_file(path: Path) -> dict[str, str]:
    """Units from the units file of a CSV file, or an empty mapping if it does not exist."""
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
            return units
    return {}
