"""Reading and writing of records as CSV files, with their units."""

import csv
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..._foundation.checks import InputError, require, require_known, require_unique
from ..build import TIME
from ..record import Record
from .assemble import assemble, clock, existing, parse_number


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
) -> Record:
    """Read one record from a CSV file whose first line holds the names of its columns.

    The unit of a column is the first one given by: `units`; a file `<stem>.units.json` or
    `<stem>.units.toml` in the same folder (a mapping of names to units); the row of units; the
    header, as in `alpha [deg]`. Empty cells in outputs are missing samples.

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

    Returns:
        The record, in SI units.

    Raises:
        InputError: when the file or a column is missing, a cell is not a number (the message names
            file, row and column), or `record` refuses the values.
    """
    path = existing(path)
    wanted = (*inputs, *outputs) if sample_time is not None else (time, *inputs, *outputs)
    columns, file_units, lines = named_columns(
        path, wanted, units_row=units_row, delimiter=delimiter
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
    path = Path(path)
    require(
        not record.is_stack,
        "A CSV file holds a single record, and this is a stack. Write each `stack[i]` to its "
        "own file.",
    )
    require(
        not path.exists(),
        f"{path} exists already and is not overwritten. Choose another name, or remove it.",
    )
    require(path.parent.is_dir(), f"The folder {path.parent} does not exist. Create it first.")
    names, units = (*record.inputs, *record.outputs), (*record.input_units, *record.output_units)
    for n in names:
        require(
            not re.search(r'[\[\](),"\n]', n),
            f"Channel {n!r} has a comma, quote or bracket. Rename it for CSV.",
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
    temporary = path.with_name(f".{path.name}.part")
    try:
        with temporary.open("x", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")
        temporary.rename(path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


class CsvColumns(NamedTuple):
    """Columns of a CSV file.

    Attributes:
        values: by name, NaN where a cell is empty.
        units: by name, as far as the file states them.
        lines: line of each row in the file, counted from 1.
    """

    values: dict[str, np.ndarray]
    units: dict[str, str]
    lines: list[int]


def named_columns(
    path: Path, wanted: Sequence[str], *, units_row: bool, delimiter: str
) -> tuple[dict[str, np.ndarray], dict[str, str], list[int]]:
    """Return the requested columns of a CSV file, in the units of the file.

    Args:
        path: the file.
        wanted: names of the columns.
        units_row: True when the second line holds units.
        delimiter: separator of the cells.

    Returns:
        Numbers by name, NaN where a cell is empty; units by name, from the units file, else the row
        of units, else the header; and for each row its line in the file, counted from 1.

    Raises:
        InputError: when a column is missing or occurs twice, or a cell is not a number.
    """
    header, *body = _cells(path, delimiter)
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
    columns = {n: _column(body, names.index(n), n, path) for n in wanted}
    return columns, file_units, [number for number, _ in body]


def _units_of_row(names: list[str], cells: list[str]) -> dict[str, str]:
    """Units by name of column, from the cells that are not blank."""
    return {name: cell.strip() for name, cell in zip(names, cells, strict=True) if cell.strip()}


def _cells(path: Path, delimiter: str) -> list[tuple[int, list[str]]]:
    """Lines of a CSV file that are not blank, with their line numbers counted from 1.

    Raises:
        InputError: when the file is not CSV or is empty, or the numbers of cells differ.
    """
    require(
        len(delimiter) == 1 and delimiter not in '"\r\n',
        f"{path.name}: the delimiter is {delimiter!r}. Give one character, such as ',' or ';'.",
    )
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, delimiter=delimiter)
            lines = [
                (reader.line_num, cells) for cells in reader if any(cell.strip() for cell in cells)
            ]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"{path.name} is not a CSV file in UTF-8: {error}. Save it again in UTF-8."
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


def _title(cell: str, wanted: Sequence[str]) -> tuple[str, str]:
    """Name and unit of a column from a header such as `alpha [deg]`."""
    text = cell.strip()
    match = re.fullmatch(r"(.*?)\s*\[([^\]]*)\]", text)
    return (text, "") if text in wanted or match is None else (match[1], match[2].strip())


def _column(lines: list[tuple[int, list[str]]], k: int, name: str, path: Path) -> np.ndarray:
    """Numbers of one column, NaN where the cell is empty."""
    values = np.empty(len(lines))
    for i, (line, cells) in enumerate(lines):
        text = cells[k].strip()
        try:
            values[i] = parse_number(text) if text else np.nan
        except ValueError as error:
            raise InputError(
                f"{path.name}, line {line}, column {name!r}: {text!r} is not a number. Correct "
                "the cell, or empty it where the sample is missing; a row of units needs "
                "`units_row=True`."
            ) from error
    return values


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
