"""Cells of CSV files, by line."""

import codecs
import csv
import itertools
from pathlib import Path
from typing import NamedTuple

from ..._foundation.checks import InputError, require
from ..arguments import text

MOST_LINES = 10**6  # above a header (chosen)
UTF8 = "utf-8-sig"  # UTF-8, with or without its mark at the start

READERS = {  # by ending, for files that are not CSV
    ".mat": "jaxid.read_mat",
    ".h5": "jaxid.data.read_hdf5",
    ".hdf5": "jaxid.data.read_hdf5",
    ".parquet": "jaxid.data.read_parquet",
    ".ulg": "jaxid.data.read_ulog",
    ".mf4": "jaxid.data.read_mdf",
    ".xlsx": "pandas.read_excel` and `jaxid.record",
}


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
        reader = READERS.get(path.suffix.lower())
        require(
            reader is None, f"{path.name} does not look like a CSV file. Read it with `{reader}`."
        )
        name = "UTF-8" if layout.encoding == UTF8 else layout.encoding
        raise InputError(
            f"{path.name} is not a CSV file in {name}: {error}. Save it again in UTF-8, or give "
            "`encoding`."
        ) from error
    require(
        len(lines) > 0, f"{path.name} is empty. Its first line must hold the names of the columns."
    )
    width = len(lines[0][1])
    _require_delimiter(lines[0][1], path)
    for number, cells in lines:
        require(
            len(cells) == width,
            f"{path.name}, line {number}: {len(cells)} cells, and the header has {width}. Give "
            "every line as many cells as the header. A decimal comma needs another delimiter, "
            "such as `delimiter=';', decimal=','`.",
        )
    return lines


def _require_delimiter(header: list[str], path: Path) -> None:
    """Refuse a header of one cell that another usual delimiter divides."""
    others = [sign for sign in ";\t|" if len(header) == 1 and sign in header[0]]
    require(
        not others,
        f"{path.name}: the header {header[0]!r} is one cell. Give "
        f"`delimiter={''.join(others[:1])!r}`, and `decimal=','` where the numbers have a decimal "
        "comma; in a study file, where the files differ, "
        f'`delimiter = {{ "{path.name}" = "{"".join(others[:1])}" }}`.',
    )


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
