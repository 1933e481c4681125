"""CSV files of a table on a rectangular grid, with one grid point per row."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..._foundation.checks import InputError, require
from ..units import to_si
from .assemble import existing, parse_number
from .cells import Layout, cells_of

ORIGIN = "origin"


class GridData(NamedTuple):
    """A quantity on a rectangular grid, read from a file.

    Attributes:
        axes: names of the axes.
        knots: increasing numbers for each axis [SI].
        units: SI unit for each axis, "" if the column has none.
        values: the quantity, shape (*knots) [SI].
        unit: SI unit of the values, "" if the column has none.
        origin: source of each value, shape (*knots), or None if the file has no such column.
    """

    axes: tuple[str, ...]
    knots: tuple[tuple[float, ...], ...]
    units: tuple[str, ...]
    values: np.ndarray
    unit: str
    origin: np.ndarray | None


def read_table(
    path: str | Path, *, value: str, axes: Sequence[str] | None = None, delimiter: str = ","
) -> GridData:
    """Read one quantity on a rectangular grid from a CSV file with a row for each grid point.

    The title of a column is the name, or name and unit as in `alpha_deg` or `idle_lbf`; a name
    alone means SI. Knots must be in increasing order, with each point of the grid once. A column
    `origin` may give the source of each value; other columns are ignored.

    Args:
        path: the file.
        value: name of the quantity.
        axes: names of the axes in the order of the axes of `values`; all columns except value and
            origin when left out.
        delimiter: separator of the cells.

    Returns:
        Knots and values in SI units.

    Raises:
        InputError: when the file, a column, a unit or a grid point is missing or occurs twice, a
            cell is not a finite number, or the knots are not in order. The message names file, line
            and remedy.
    """
    path = existing(path)
    header, *rows = cells_of(path, Layout(delimiter))
    require(
        len(rows) > 0,
        f"{path.name} has a header and no row below it. Give one row for each point of the grid.",
    )
    titles = [cell.strip() for cell in header[1]]
    axes = _all_axes(titles, value, path) if axes is None else axes
    located = {name: _find(name, titles, path) for name in (*axes, value)}
    lines = [number for number, _ in rows]
    knots, places, units = [], [], []
    for axis in axes:
        column, unit = located[axis]
        points = _numbers(rows, column, titles[column], path)
        levels = _levels(points, lines, titles[column], path)
        places.append(np.searchsorted(levels, points))
        in_si, si = _to_si(levels, unit, titles[column], path)
        knots.append(tuple(in_si.tolist()))
        units.append(si)
    shape = tuple(map(len, knots))
    words = _points(rows, titles, [located[axis][0] for axis in axes])
    order = _order(places, shape, words, lines, path)
    column, unit = located[value]
    numbers, si = _to_si(_numbers(rows, column, titles[column], path), unit, titles[column], path)
    origins = _origins(rows, titles)
    origin = None if origins is None else origins[order].reshape(shape)
    return GridData(
        tuple(axes), tuple(knots), tuple(units), numbers[order].reshape(shape), si, origin
    )


def _all_axes(titles: list[str], value: str, path: Path) -> list[str]:
    """Names of all columns except value and origin."""
    column = _find(value, titles, path)[0]
    others = [title for k, title in enumerate(titles) if title != ORIGIN and k != column]
    return [title.rpartition("_")[0] or title for title in others]


def _points(rows: list[tuple[int, list[str]]], titles: list[str], columns: list[int]) -> list[str]:
    """Description of the grid point of each row."""
    return [", ".join(f"{titles[k]} {cells[k].strip()}" for k in columns) for _, cells in rows]


def _origins(rows: list[tuple[int, list[str]]], titles: list[str]) -> np.ndarray | None:
    """The column of origins, or None if the file has none."""
    if ORIGIN not in titles:
        return None
    return np.array([cells[titles.index(ORIGIN)].strip() for _, cells in rows], str)


def _find(name: str, titles: list[str], path: Path) -> tuple[int, str]:
    """Column and unit of a name: the column `alpha`, or `alpha_` followed by a unit."""
    matches = [k for k, title in enumerate(titles) if title == name]
    matches = matches or [k for k, title in enumerate(titles) if title.startswith(f"{name}_")]
    have = ", ".join(titles)
    require(
        len(matches) > 0,
        f"{path.name} has no column {name!r}, nor one such as '{name}_deg' with a unit. Its "
        f"columns are: {have}. Rename one.",
    )
    require(
        len(matches) == 1,
        f"{path.name}: more than one column can be {name!r}. Its columns are: {have}. Rename one, "
        "or remove it.",
    )
    return matches[0], titles[matches[0]][len(name) + 1 :]


def _numbers(rows: list[tuple[int, list[str]]], column: int, title: str, path: Path) -> np.ndarray:
    """Numbers of one column; a cell that is not a finite number is refused."""
    numbers = np.empty(len(rows))
    for k, (line, cells) in enumerate(rows):
        text = cells[column].strip()
        try:
            numbers[k] = parse_number(text)
        except ValueError:
            numbers[k] = np.nan
        if not np.isfinite(numbers[k]):
            raise InputError(
                f"{path.name}, line {line}, column {title!r}: {text!r} is not a finite number. A "
                "table must have no gaps: correct it."
            )
    return numbers


def _levels(points: np.ndarray, lines: list[int], title: str, path: Path) -> np.ndarray:
    """The knots of an axis; an order of first occurrence that is not increasing is refused."""
    levels, first = np.unique(points, return_index=True)
    appearance = np.argsort(first)
    wrong = np.flatnonzero(np.diff(appearance) < 0)
    if len(wrong):
        before, after = levels[appearance[wrong[0]]], levels[appearance[wrong[0] + 1]]
        line = lines[first[appearance[wrong[0] + 1]]]
        raise InputError(
            f"{path.name}, line {line}, column {title!r}: the knots are not in order, {after:g} "
            f"comes after {before:g}. Sort the rows by increasing knots, or correct the cell."
        )
    require(
        len(levels) > 1,
        f"{path.name}, column {title!r}: there is one knot, {levels[0]:g}. Give two or more, or "
        "leave the axis out.",
    )
    return levels


def _to_si(numbers: np.ndarray, unit: str, title: str, path: Path) -> tuple[np.ndarray, str]:
    """Numbers in SI, and the SI unit; the error message names the file."""
    try:
        return to_si(numbers, unit, title)
    except InputError as error:
        raise InputError(
            f"{path.name}: the end of a column's title is its unit. {error} The title of a column "
            "must be `name` or `name_unit`."
        ) from error


def _order(
    places: list[np.ndarray], shape: tuple[int, ...], words: list[str], lines: list[int], path: Path
) -> np.ndarray:
    """The row of each point of the grid, in the grid's flat order.

    A point that is missing or occurs twice is refused; `words` describes the point of each row.
    """
    flat = np.ravel_multi_index(tuple(places), shape)
    order = np.argsort(flat, kind="stable")
    for first, second in itertools.pairwise(order.tolist()):
        if flat[first] == flat[second]:
            raise InputError(
                f"{path.name}, line {lines[second]}: the grid point {words[second]} is already "
                f"in line {lines[first]}. Remove one."
            )
    missing = np.setdiff1d(np.arange(np.prod(shape)), flat)
    if len(missing):
        index = np.unravel_index(missing[0], shape)
        samples = [np.flatnonzero(place == k)[0] for place, k in zip(places, index, strict=True)]
        point = ", ".join(words[row].split(", ")[axis] for axis, row in enumerate(samples))
        before = lines[order[max(int(np.sum(flat < missing[0])) - 1, 0)]]
        raise InputError(
            f"{path.name}: {len(missing)} of {np.prod(shape)} grid points are missing; the first, "
            f"{point}, belongs after line "
            f"{before}. Add the rows, or correct a knot that is in one row only."
        )
    return order
