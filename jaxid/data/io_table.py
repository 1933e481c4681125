"""CSV files that hold a table over a rectangular grid, one grid point a row."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .._foundation.checks import InputError, require
from .io import existing
from .io_csv import _cells
from .units import to_si

ORIGIN = "origin"


class GridData(NamedTuple):
    """What a file says about a quantity on a grid.

    Attributes:
        axes: names of the axes.
        knots: increasing numbers for each axis [SI].
        units: SI unit for each axis, "" where the column names none.
        values: the quantity, shape (*knots) [SI].
        unit: of the values.
        origin: where each value comes from, shape (*knots), where the file says so.
    """

    axes: tuple[str, ...]
    knots: tuple[tuple[float, ...], ...]
    units: tuple[str, ...]
    values: np.ndarray
    unit: str
    origin: np.ndarray | None


def read_table(path: str | Path, *, value: str, axes: Sequence[str] | None = None, delimiter: str = ",") -> GridData:
    """Read one quantity on a rectangular grid from a CSV file with a row for each grid point.

    A column is called by the name, or by name and unit as `alpha_deg` or `idle_lbf`; a name alone is taken as SI. Knots come
    in increasing order, each point of the grid once. A column `origin` may say where a value comes from; others are left alone.

    Args:
        path: the file.
        value: name of the quantity.
        axes: names of the axes, the first one first in `values`; all columns but those of value and origin when left out.
        delimiter: what separates the cells.

    Returns:
        Knots and values in SI units.

    Raises:
        InputError: when the file, a column, a unit or a grid point is missing or there twice, a cell is no finite number, or the
            knots are not in order; file, line and remedy are named.
    """
    path = existing(path)
    header, *rows = _cells(path, delimiter)
    require(len(rows) > 0, f"{path.name} has a header and no row below it. Give one row for each point of the grid.")
    titles = [cell.strip() for cell in header[1]]
    if axes is None:
        others = [title for k, title in enumerate(titles) if title != ORIGIN and k != _find(value, titles, path)[0]]
        axes = [title.rpartition("_")[0] or title for title in others]
    found = {name: _find(name, titles, path) for name in (*axes, value)}
    lines = [number for number, _ in rows]
    knots, places, units = [], [], []
    for axis in axes:
        column, unit = found[axis]
        points = _numbers(rows, column, titles[column], path)
        levels = _levels(points, lines, titles[column], path)
        places.append(np.searchsorted(levels, points))
        in_si, si = _to_si(levels, unit, titles[column], path)
        knots.append(tuple(in_si.tolist()))
        units.append(si)
    shape = tuple(map(len, knots))
    own = [(titles[found[axis][0]], found[axis][0]) for axis in axes]
    words = [", ".join(f"{title} {cells[k].strip()}" for title, k in own) for _, cells in rows]
    order = _order(places, shape, words, lines, path)
    column, unit = found[value]
    numbers, si = _to_si(_numbers(rows, column, titles[column], path), unit, titles[column], path)
    origin = None
    if ORIGIN in titles:
        origins = np.array([cells[titles.index(ORIGIN)].strip() for _, cells in rows], str)
        origin = origins[order].reshape(shape)
    return GridData(tuple(axes), tuple(knots), tuple(units), numbers[order].reshape(shape), si, origin)


def _find(name: str, titles: list[str], path: Path) -> tuple[int, str]:
    """Column and unit of a name: `alpha` itself, or `alpha_` and a unit."""
    matches = [k for k, title in enumerate(titles) if title == name]
    matches = matches or [k for k, title in enumerate(titles) if title.startswith(f"{name}_")]
    have = ", ".join(titles)
    require(
        len(matches) > 0,
        f"{path.name} has no column {name!r}, nor one such as '{name}_deg' with a unit. Its columns are: {have}. Rename one.",
    )
    require(
        len(matches) == 1,
        f"{path.name}: more than one column can be {name!r}. Its columns are: {have}. Rename one, or remove it.",
    )
    return matches[0], titles[matches[0]][len(name) + 1 :]


def _numbers(rows: list[tuple[int, list[str]]], column: int, title: str, path: Path) -> np.ndarray:
    """One column as numbers, all of them there and finite."""
    numbers = np.empty(len(rows))
    for k, (line, cells) in enumerate(rows):
        text = cells[column].strip()
        try:
            numbers[k] = float(text)
        except ValueError:
            numbers[k] = np.nan
        if not np.isfinite(numbers[k]):
            raise InputError(
                f"{path.name}, line {line}, column {title!r}: {text!r} is no finite number. A table has no gaps: correct it."
            )
    return numbers


def _levels(points: np.ndarray, lines: list[int], title: str, path: Path) -> np.ndarray:
    """The knots of an axis, in the order in which they first appear; that must be increasing."""
    levels, first = np.unique(points, return_index=True)
    appearance = np.argsort(first)
    wrong = np.flatnonzero(np.diff(appearance) < 0)
    if len(wrong):
        before, after = levels[appearance[wrong[0]]], levels[appearance[wrong[0] + 1]]
        line = lines[first[appearance[wrong[0] + 1]]]
        raise InputError(
            f"{path.name}, line {line}, column {title!r}: the knots are not in order, {after:g} comes after {before:g}. Sort "
            "the rows by increasing knots, or correct the cell."
        )
    require(
        len(levels) > 1,
        f"{path.name}, column {title!r}: there is one knot, {levels[0]:g}. Give two or more, or leave the axis out.",
    )
    return levels


def _to_si(numbers: np.ndarray, unit: str, title: str, path: Path) -> tuple[np.ndarray, str]:
    """Numbers in SI, and the unit; a refusal names the file."""
    try:
        return to_si(numbers, unit, title)
    except InputError as error:
        raise InputError(
            f"{path.name}: the end of the column's name is read as its unit. {error} A column is called `name` or `name_unit`."
        ) from error


def _order(
    places: list[np.ndarray], shape: tuple[int, ...], words: list[str], lines: list[int], path: Path
) -> np.ndarray:
    """Which row holds each point of the grid, in the grid's flat order; each is there once. `words` name a row's point."""
    flat = np.ravel_multi_index(tuple(places), shape)
    order = np.argsort(flat, kind="stable")
    for one, two in itertools.pairwise(order.tolist()):
        if flat[one] == flat[two]:
            raise InputError(
                f"{path.name}, line {lines[two]}: the grid point {words[two]} is there already, in line {lines[one]}. Remove one."
            )
    missing = np.setdiff1d(np.arange(np.prod(shape)), flat)
    if len(missing):
        index = np.unravel_index(missing[0], shape)
        samples = [np.flatnonzero(place == k)[0] for place, k in zip(places, index, strict=True)]
        point = ", ".join(words[row].split(", ")[axis] for axis, row in enumerate(samples))
        before = lines[order[max(int(np.sum(flat < missing[0])) - 1, 0)]]
        raise InputError(
            f"{path.name}: {len(missing)} of {np.prod(shape)} grid points are missing; the first, {point}, would come after line "
            f"{before}. Add the rows, or correct the knot that makes a point of its own."
        )
    return order
