"""CSV files: records in and out, with their units."""

import csv
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .._foundation.checks import InputError, require, require_known, require_unique
from .build import TIME
from .io import assemble, clock, existing
from .record import Record


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

    Units come, the first that has one, from `units`, a file `<stem>.units.json` or `<stem>.units.toml` beside it (a
    mapping of names to units), the row of units, or the header written as `alpha [deg]`. Empty cells in outputs are
    missing samples.

    Args:
        path: the file.
        inputs: columns that are inputs.
        outputs: columns that are measured outputs.
        time: column of time.
        sample_time: time between samples [s], for a file without a column of time.
        units: unit by name of column or constant.
        units_row: True when the second line holds units.
        name: name of the record; the stem of the file when left out.
        constants: what is known and constant over the record [`units`, else SI].
        delimiter: what separates the cells.

    Returns:
        The record, in SI units.

    Raises:
        InputError: when the file or a column is missing, a cell is no number (file, row and column are named), or
            `record` refuses the values.
    """
    path = existing(path)
    wanted = (*inputs, *outputs) if sample_time is not None else (time, *inputs, *outputs)
    columns, found, lines = named_columns(path, wanted, units_row=units_row, delimiter=delimiter)
    if sample_time is not None:
        time, columns[TIME] = TIME, clock(sample_time, len(lines), path)
    return assemble(columns, time, inputs, outputs, found, units, path.stem if name is None else name, constants)


def write_csv(record: Record, path: str | Path) -> Path:
    """Write a single record so that `read_csv` gives it back, bit for bit.

    Names stand in the header with their units, as `alpha [rad]`; a missing sample is an empty cell. Name and constants
    are not written. The file appears whole or not at all.

    Args:
        record: a single record.
        path: where to write; the folder exists, the file does not.

    Returns:
        The path.

    Raises:
        InputError: when the record is a stack, the file exists, or the folder does not.
    """
    path = Path(path)
    require(not record.is_stack, "A CSV file holds a single record, and this is a stack. Write `stack[i]` one by one.")
    require(not path.exists(), f"{path} exists already and is not overwritten. Choose another name, or remove it.")
    require(path.parent.is_dir(), f"The folder {path.parent} does not exist. Make it first.")
    names, units = (*record.inputs, *record.outputs), (*record.input_units, *record.output_units)
    for n in names:
        require(not re.search(r'[\[\](),"\n]', n), f"Channel {n!r} has a comma, quote or bracket. Rename it for CSV.")
    header = ["t [s]", *(f"{n} [{unit}]" if unit else n for n, unit in zip(names, units, strict=True))]
    columns = [np.asarray(record.t), *(np.asarray(record.channel(n)) for n in names)]
    lines = [",".join(header)]
    lines += [",".join("" if np.isnan(x) else repr(float(x)) for x in row) for row in zip(*columns, strict=True)]
    temporary = path.with_name(f".{path.name}.part")
    try:
        with temporary.open("x", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")
        temporary.rename(path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


def named_columns(
    path: Path, wanted: Sequence[str], *, units_row: bool, delimiter: str
) -> tuple[dict[str, np.ndarray], dict[str, str], list[int]]:
    """The columns of a CSV file that are asked for, as they stand in it.

    Args:
        path: the file.
        wanted: names of the columns.
        units_row: True when the second line holds units.
        delimiter: what separates the cells.

    Returns:
        Numbers by name, NaN where a cell is empty; units by name, as far as the header, the row of units or the file beside it
        has them, the last one first; and the line in the file of each row, counted from 1.

    Raises:
        InputError: when a column is missing or there twice, or a cell is no number.
    """
    header, *body = _cells(path, delimiter)
    titles = [_title(cell, wanted) for cell in header[1]]
    names = [n for n, _ in titles]
    require_known(f"column in {path.name}", wanted, names)
    require_unique(f"column in {path.name}:", [n for n in names if n in wanted])
    found = {n: unit for n, unit in titles if unit}
    if units_row:
        require(len(body) > 0, f"{path.name} has no row of units below its header. Leave out `units_row`.")
        found |= {n: cell.strip() for n, cell in zip(names, body.pop(0)[1], strict=True) if cell.strip()}
    found |= _sidecar(path)
    columns = {n: _column(body, names.index(n), n, path) for n in wanted}
    return columns, found, [number for number, _ in body]


def _cells(path: Path, delimiter: str) -> list[tuple[int, list[str]]]:
    """Lines of a CSV file that are not blank, with their numbers counted from 1, each as long as the header."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, delimiter=delimiter)
            lines = [(reader.line_num, cells) for cells in reader if any(cell.strip() for cell in cells)]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path.name} is not a CSV file in UTF-8: {error}. Save it anew as such.") from error
    require(len(lines) > 0, f"{path.name} is empty. Its first line must hold the names of the columns.")
    width = len(lines[0][1])
    for number, cells in lines:
        require(
            len(cells) == width,
            f"{path.name}, line {number}: {len(cells)} cells, and the header has {width}. Give every line as many "
            "cells as the header; numbers take a decimal point, not a comma.",
        )
    return lines


def _title(cell: str, wanted: Sequence[str]) -> tuple[str, str]:
    """Name and unit of a column from a header such as `alpha [deg]`."""
    text = cell.strip()
    match = re.fullmatch(r"(.*?)\s*\[([^\]]*)\]", text)
    return (text, "") if text in wanted or match is None else (match[1], match[2].strip())


def _column(lines: list[tuple[int, list[str]]], k: int, name: str, path: Path) -> np.ndarray:
    """One column as numbers, NaN where the cell is empty."""
    values = np.empty(len(lines))
    for i, (number, cells) in enumerate(lines):
        text = cells[k].strip()
        try:
            values[i] = float(text) if text else np.nan
        except ValueError as error:
            raise InputError(
                f"{path.name}, line {number}, column {name!r}: {text!r} is no number. Correct the cell, or empty it "
                "where the sample is missing; a row of units needs `units_row=True`."
            ) from error
    return values


def _sidecar(path: Path) -> dict[str, str]:
    """Units from the file beside a CSV file, if there is one."""
    for suffix, parse in ((".json", json.loads), (".toml", tomllib.loads)):
        beside = path.with_name(f"{path.stem}.units{suffix}")
        if beside.is_file():
            try:
                units = parse(beside.read_text(encoding="utf-8"))
            except ValueError as error:  # both parsers' errors are ValueErrors
                raise InputError(f"{beside.name} cannot be read: {error}. Correct it, or remove it.") from error
            require(
                isinstance(units, dict) and all(isinstance(unit, str) for unit in units.values()),
                f'{beside.name} is not a mapping of names to units. Write it as {{"alpha": "deg"}}.',
            )
            return units
    return {}
