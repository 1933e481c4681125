"""Files of numbers without names, text or MATLAB, whose columns are identified by number."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..._foundation.checks import InputError, require, require_known
from ..build import TIME
from ..record import Record
from .assemble import assemble, clock, existing, parse_number
from .layouts import Columns
from .mat import mat_variables

COMMENTS = ("#", "%")


class Grid(NamedTuple):
    """The numbers of a file.

    Attributes:
        name: name of the file.
        numbers: shape (row, column).
        place: description of the place of a row in the file, such as "line 7".
    """

    name: str
    numbers: np.ndarray
    place: Callable[[int], str]


def read_columns(
    path: str | Path,
    columns: Columns,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    time: str = TIME,
    sample_time: float | int | None = None,
    skip: int = 0,
    delimiter: str | None = None,
    variable: str | None = None,
    name: str | None = None,
    constants: Mapping[str, Any] | None = None,
) -> Record:
    """Read one record from a file of numbers without names: text or `.mat`.

    The flight data of DLR are such files.

        read_columns(
            "hfb320_1_10.asc", HFB320,
            inputs=("stabilator", "thrust"), outputs=("V", "alpha", "q"),
        )
        read_columns(
            path, {"q": (3, "deg/s"), "aileron": ({7: -0.5, 8: 0.5}, "deg")}, ...,
            sample_time=0.04,
        )

    Blank lines, and lines that begin with # or %, are ignored. Exponents may be written with D, as
    Fortran does. `NaN` in an output is a missing sample. Signs stay as recorded; a factor of -1 in
    the mapping reverses a sign.

    Args:
        path: the file.
        columns: `(column, unit)` by name of channel, columns counted from 1. In place of a column a
            mapping of columns to factors may be given: the channel is the sum of factor times
            column. Units may be "". Available layouts are `HFB320`, `ATTAS`, `ATTAS_STALL` and
            `SIDPAC`.
        inputs: channels that are inputs.
        outputs: channels that are measured outputs.
        time: name of the time channel.
        sample_time: time between samples [s], in place of a time column.
        skip: number of header lines at the top.
        delimiter: separator of the numbers; blanks when left out.
        variable: the array's name in a MATLAB file; the stem of the file when left out.
        name: name of the record; the stem of the file when left out.
        constants: known quantities that are constant over the record [SI].

    Returns:
        The record, in SI units, with the requested channels only.

    Raises:
        InputError: when the file does not exist, a channel has no column, the file has too few
            columns, a line has more or fewer numbers than the others, a cell is not a number, time
            or an input is missing or not finite, time does not increase, or a unit is unknown. The
            message names file, line and column.
    """
    path = existing(path)
    if path.suffix.lower() == ".mat":
        grid = mat_grid(path, path.stem if variable is None else variable)
    else:
        grid = text_grid(path, skip=skip, delimiter=delimiter)
    wanted = (*inputs, *outputs) if sample_time is not None else (time, *inputs, *outputs)
    require_known("channel among `columns`", wanted, columns)
    channels = {n: column(grid, columns, n) for n in wanted}
    units = {n: columns[n][1] for n in wanted}
    if sample_time is not None:
        time, channels[TIME] = TIME, clock(sample_time, len(grid.numbers), path)
    require_finite(grid, columns, {n: channels[n] for n in (time, *inputs)})
    require_increasing(grid, channels[time])
    return assemble(
        channels, time, inputs, outputs, units, None, path.stem if name is None else name, constants
    )


def mat_grid(path: Path, variable: str) -> Grid:
    """The numbers of one array of a MATLAB file.

    Raises:
        InputError: when there is no such array, or it is not a matrix of real numbers.
    """
    variables = mat_variables(path)
    if variable not in variables:
        largest = max(variables, key=lambda name: np.size(variables[name]), default=None)
        advice = "" if largest is None else f" Give the matrix by name, variable={largest!r}."
        try:
            require_known(f"variable in {path.name}", [variable], variables)
        except InputError as error:
            raise InputError(f"{error}{advice}") from None
    values = np.asarray(variables[variable])
    require(
        values.ndim == 2 and values.dtype.kind in "biuf",
        f"{path.name}: variable {variable!r} is not a matrix of real numbers (type "
        f"{values.dtype}, shape {values.shape}). Give the name of another variable in `variable`.",
    )
    return Grid(path.name, values.astype(float), lambda row: f"row {row} (from 0)")


def text_grid(path: Path, *, skip: int, delimiter: str | None) -> Grid:
    """The numbers of a text file.

    Raises:
        InputError: when it is not text, has no numbers, a cell is not a number, or a line has not
            as many numbers as the first line.
    """
    _require_delimiter(path, delimiter)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path.name} is not a text file in UTF-8: {error}. Save it again in UTF-8."
        ) from error
    texts = [(k + 1, line.strip()) for k, line in enumerate(lines) if k >= skip]
    texts = [(number, line) for number, line in texts if line and not line.startswith(COMMENTS)]
    require(
        len(texts) > 0,
        f"{path.name} has no line of numbers below the {skip} lines that are skipped.",
    )
    cells = [line.split(delimiter) for _, line in texts]
    rows = [_row(row, number, path) for row, (number, _) in zip(cells, texts, strict=True)]
    for row, (number, _) in zip(rows, texts, strict=True):
        require(
            len(row) == len(rows[0]),
            f"{path.name}, line {number}: {len(row)} numbers, and line {texts[0][0]} has "
            f"{len(rows[0])}. Correct the line, or give `delimiter`.",
        )
    return Grid(path.name, np.array(rows), lambda k: f"line {texts[k][0]}")


def _require_delimiter(path: Path, delimiter: str | None) -> None:
    """Refuse a delimiter that is not one character."""
    require(
        delimiter is None or (len(delimiter) == 1 and delimiter not in "\r\n"),
        f"{path.name}: the delimiter is {delimiter!r}. Give one character, such as ',', or "
        "leave it out for blanks.",
    )


def column(grid: Grid, columns: Columns, name: str) -> np.ndarray:
    """One channel of a grid: a column, or the sum of columns times their factors."""
    count = grid.numbers.shape[1]
    for number in _parts(columns[name][0]):
        require(
            1 <= number <= count,
            f"{grid.name}: channel {name!r} is column {number}, counted from 1, and there are "
            f"{count}. Correct `columns`, or give `delimiter`.",
        )
    terms = [
        factor * grid.numbers[:, number - 1] for number, factor in _parts(columns[name][0]).items()
    ]
    return np.sum(terms, axis=0) if len(terms) > 1 else terms[0]


def require_finite(grid: Grid, columns: Columns, channels: Mapping[str, np.ndarray]) -> None:
    """Refuse a channel that has a value that is not finite."""
    for name, values in channels.items():
        for row in np.flatnonzero(~np.isfinite(values))[:1]:
            numbers = " and ".join(map(str, _parts(columns[name][0]))) if name in columns else "?"
            raise InputError(
                f"{grid.name}, {grid.place(row)}, column {numbers} ({name!r}): {values[row]} "
                "is not a finite number. Time, inputs and constants must be known in every row: "
                "fill in the value, or cut the record there."
            )


def require_increasing(grid: Grid, t: np.ndarray) -> None:
    """Refuse times that do not increase strictly."""
    for row in np.flatnonzero(np.diff(t) <= 0)[:1] + 1:
        raise InputError(
            f"{grid.name}, {grid.place(row)}: time does not increase, {t[row]:.10g} after "
            f"{t[row - 1]:.10g}. Remove repeated rows, or give `sample_time` where "
            "the file has no time."
        )


def _parts(columns: int | Mapping[int, float]) -> Mapping[int, float]:
    """Factors by column."""
    return {columns: 1.0} if isinstance(columns, int) else columns


def _row(cells: list[str], line: int, path: Path) -> list[float]:
    """The numbers of one line."""
    values = []
    for k, cell in enumerate(cells):
        try:
            values.append(parse_number(cell.strip().replace("D", "E").replace("d", "e")))
        except ValueError as error:
            raise InputError(
                f"{path.name}, line {line}, column {k + 1}: {cell.strip()!r} is not a number. "
                "Correct it, write NaN where a sample is missing, and give `skip` for header lines "
                "at the top, or `delimiter`."
            ) from error
    return values
