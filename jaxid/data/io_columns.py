"""Files of numbers without names, text or MATLAB: columns are known by their number."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._foundation.checks import InputError, require, require_known
from .build import TIME
from .io import assemble, clock, existing
from .io_mat import mat_variables
from .layouts import Columns
from .record import Record

COMMENTS = ("#", "%")


class Grid(NamedTuple):
    """The numbers of a file.

    Attributes:
        name: of the file.
        numbers: shape (row, column).
        place: words for where a row stands in the file, such as "line 7".
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
    """Read one record from a file of numbers, columns by their number, such as those of DLR: text, or `.mat` up to version 7.

        read_columns("hfb320_1_10.asc", HFB320, inputs=("stabilator", "thrust"), outputs=("V", "alpha", "q"))
        read_columns(path, {"q": (3, "deg/s"), "aileron": ({7: -0.5, 8: 0.5}, "deg")}, ..., sample_time=0.04)

    Blank lines, and lines that begin with # or %, are passed over. Exponents may be written with D, as Fortran does. `NaN` in an
    output is a missing sample. Signs stay as recorded; a factor of -1 in the mapping turns one.

    Args:
        path: the file.
        columns: by name of channel `(column, unit)`, columns counted from 1; in place of a column a mapping of columns to
            factors, which are multiplied and summed. Units may be "". Layouts at hand are `HFB320`, `ATTAS`, `ATTAS_STALL`
            and `SIDPAC`.
        inputs: channels that are inputs.
        outputs: channels that are measured outputs.
        time: channel of time.
        sample_time: time between samples [s], in place of a column of time.
        skip: number of lines at the top that are no numbers.
        delimiter: what separates the numbers; blanks when left out.
        variable: the array's name in a MATLAB file; the stem of the file when left out.
        name: name of the record; the stem of the file when left out.
        constants: what is known and constant over the record [SI].

    Returns:
        The record, in SI units, with the channels asked for and no others.

    Raises:
        InputError: when there is no such file, a channel has no column or the file too few of them, a line has more or fewer
            numbers than the others, a cell is no number, time or an input is missing or not finite, time does not increase, or a
            unit is unknown; file, line and column are named.
    """
    path = existing(path)
    if path.suffix.lower() == ".mat":
        grid = mat_grid(path, path.stem if variable is None else variable)
    else:
        grid = text_grid(path, skip=skip, delimiter=delimiter)
    wanted = (*inputs, *outputs) if sample_time is not None else (time, *inputs, *outputs)
    require_known("channel among `columns`", wanted, columns)
    found = {n: column(grid, columns, n) for n in wanted}
    units = {n: columns[n][1] for n in wanted}
    if sample_time is not None:
        time, found[TIME] = TIME, clock(sample_time, len(grid.numbers), path)
    require_finite(grid, columns, {n: found[n] for n in (time, *inputs)})
    require_increasing(grid, found[time])
    return assemble(found, time, inputs, outputs, units, None, path.stem if name is None else name, constants)


def mat_grid(path: Path, variable: str) -> Grid:
    """The numbers of one array of a MATLAB file.

    Raises:
        InputError: when there is no such array, or it is no matrix of real numbers.
    """
    variables = mat_variables(path)
    require_known(f"variable in {path.name}", [variable], variables)
    values = np.asarray(variables[variable])
    require(
        values.ndim == 2 and values.dtype.kind in "biuf",
        f"{path.name}: variable {variable!r} is no matrix of real numbers (type {values.dtype}, shape {values.shape}). Name "
        "another by `variable`.",
    )
    return Grid(path.name, values.astype(float), lambda row: f"row {row} (from 0)")


def text_grid(path: Path, *, skip: int, delimiter: str | None) -> Grid:
    """The numbers of a text file.

    Raises:
        InputError: when it is no text, has no numbers, or a line has a cell that is no number or another count than the first.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise InputError(f"{path.name} is not a text file in UTF-8: {error}. Save it anew as such.") from error
    texts = [(k + 1, line.strip()) for k, line in enumerate(lines) if k >= skip]
    texts = [(number, line) for number, line in texts if line and not line.startswith(COMMENTS)]
    require(len(texts) > 0, f"{path.name} has no line of numbers below the {skip} that are skipped.")
    cells = [line.split(delimiter) for _, line in texts]
    rows = [_row(row, number, path) for row, (number, _) in zip(cells, texts, strict=True)]
    for row, (number, _) in zip(rows, texts, strict=True):
        require(
            len(row) == len(rows[0]),
            f"{path.name}, line {number}: {len(row)} numbers, and line {texts[0][0]} has {len(rows[0])}. Correct the line, or "
            "give `delimiter`.",
        )
    return Grid(path.name, np.array(rows), lambda k: f"line {texts[k][0]}")


def column(grid: Grid, columns: Columns, name: str) -> np.ndarray:
    """One channel of a grid as it stands there, or the sum of several columns with factors."""
    count = grid.numbers.shape[1]
    for number in _parts(columns[name][0]):
        require(
            1 <= number <= count,
            f"{grid.name}: channel {name!r} is column {number}, counted from 1, and there are {count}. Correct `columns`, or "
            "give `delimiter`.",
        )
    found = [factor * grid.numbers[:, number - 1] for number, factor in _parts(columns[name][0]).items()]
    return np.sum(found, axis=0) if len(found) > 1 else found[0]


def require_finite(grid: Grid, columns: Columns, found: Mapping[str, np.ndarray]) -> None:
    """Refuse a channel that must be known in every row and is not."""
    for name, values in found.items():
        for row in np.flatnonzero(~np.isfinite(values))[:1]:
            numbers = " and ".join(map(str, _parts(columns[name][0]))) if name in columns else "?"
            raise InputError(
                f"{grid.name}, {grid.place(row)}, column {numbers} ({name!r}): {values[row]} is no finite number. Time, inputs "
                "and constants must be known in every row: fill in the value, or cut the record there."
            )


def require_increasing(grid: Grid, t: np.ndarray) -> None:
    """Refuse time that stands still or runs back."""
    for row in np.flatnonzero(np.diff(t) <= 0)[:1] + 1:
        raise InputError(
            f"{grid.name}, {grid.place(row)}: time does not increase, {t[row]:.10g} after {t[row - 1]:.10g}. Remove repeated "
            "rows, or give `sample_time` where the file has no time."
        )


def _parts(columns: int | Mapping[int, float]) -> Mapping[int, float]:
    """Columns with their factors."""
    return {columns: 1.0} if isinstance(columns, int) else columns


def _row(cells: list[str], number: int, path: Path) -> list[float]:
    """The numbers of one line."""
    values = []
    for k, cell in enumerate(cells):
        try:
            values.append(float(cell.strip().replace("D", "E").replace("d", "e")))
        except ValueError as error:
            raise InputError(
                f"{path.name}, line {number}, column {k + 1}: {cell.strip()!r} is no number. Correct it, write NaN where a "
                "sample is missing, and give `skip` for lines of words at the top, or `delimiter`."
            ) from error
    return values
