"""Flight records in the layout of SIDPAC: an array `fdata` of 90 columns."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.grid import is_uniform
from .build import TIME
from .io import assemble, clock, existing
from .io_columns import Grid, column, mat_grid, require_finite, require_increasing, text_grid
from .layouts import SIDPAC
from .record import Record
from .units import to_si

COLUMNS = 90
FEWEST = 52  # with the moments and products of inertia; older versions of the layout end somewhere behind them
SURFACES = ("stabilator", "aileron", "rudder")
STEADY = 1e-2  # of its size: a mass or inertia that varies by less is a constant
STAMPS = 1e-2  # relative: steps that differ by less are even, their time stamps rounded
# What is constant over a record, in groups of one size: a butt line near zero is as steady as the fuselage station.
CONSTANT = (("xcg", "ycg", "zcg"), ("mass",), ("Ix", "Iy", "Iz", "Ixz"), ("S",), ("b",), ("cbar",))


def read_sidpac(
    path: str | Path,
    *,
    inputs: Sequence[str] = SURFACES,
    sample_time: float | int | None = None,
    signs: Mapping[str, int] | None = None,
    variable: str = "fdata",
    skip: int = 0,
    delimiter: str | None = None,
    name: str | None = None,
) -> Record:
    """Read one record from a file in SIDPAC's layout, a MATLAB file (up to version 7) or text of 90 columns.

    Columns that are read (`SIDPAC` has the numbers, units and sources), in SI:

    - outputs, those that are filled in: `V alpha beta p q r phi pitch psi ax ay az qbar mach density altitude pdot qdot rdot`;
    - inputs: `stabilator` (the elevator's column), `aileron`, `rudder`, as recorded, zeros too;
    - `thrust`, the sum of columns 38 to 41, where filled in: an input where it varies, else a constant;
    - constants, those that are filled in: `mass Ix Iy Iz Ixz S b cbar`, and `xcg ycg zcg` [m] as recorded: fuselage station, butt
      line and waterline, positive aft, right and up. A column that varies by up to 1 % of its size is taken by its mean, as
      SIDPAC does.

    A column of zeros is one that nobody filled in, as SIDPAC has it. Other columns are not read. `NaN` in an output is a missing
    sample.

    Signs stay as recorded. The layout does not fix those of the surfaces; the F-16 simulation of SIDPAC has positive elevator
    nose down, aileron roll left and rudder yaw left, as this library has. Check a new aircraft's, and turn what differs by
    `signs`.

    Args:
        path: the file; `.mat` for MATLAB, else text.
        inputs: channels that are inputs; any that are read.
        sample_time: time between samples [s], in place of column 1.
        signs: 1 or -1 by channel, such as `{"aileron": -1}`; what is not named stays.
        variable: the array's name in a MATLAB file. There it may have fewer columns, down to 52, as older versions do; those that
            lack were not filled in.
        skip: number of lines at the top of a text file that are no numbers.
        delimiter: what separates the numbers of a text file; when left out a comma in a file `.csv`, else blanks.
        name: name of the record; the stem of the file when left out.

    Returns:
        The record, in SI units.

    Raises:
        InputError: when there is no such file or variable, it has not 90 columns, time does not increase evenly (to 1 %), time,
            an input or a constant is not finite, a constant varies by more than 1 %, an input or sign is of an unknown channel,
            or no output is filled in; file, column and row are named.
    """
    path, signs = existing(path), signs or {}
    grid = _grid(path, variable, skip, delimiter)
    require_known("channel of SIDPAC's layout (in `inputs`)", inputs, [n for n in SIDPAC if n != TIME])
    require_known("channel of SIDPAC's layout (in `signs`)", signs, SIDPAC)
    for n, sign in signs.items():
        require(sign in (1, -1), f"{path.name}: the sign of {n!r} is {sign}. Give 1 or -1.")
    found = {n: signs.get(n, 1) * column(grid, SIDPAC, n) for n in SIDPAC}
    found[TIME] = _time(grid, found[TIME]) if sample_time is None else clock(sample_time, len(grid.numbers), path)
    filled = [n for n in SIDPAC if np.any(found[n] != 0)]
    constants = _constants(grid, found, [n for n in filled if n not in inputs])
    if "thrust" in filled and "thrust" not in (*inputs, *constants):
        inputs = (*inputs, "thrust")
    outputs = [n for n in filled if n not in (TIME, *inputs, *constants)]
    require_finite(grid, SIDPAC, {n: found[n] for n in (TIME, *inputs)})
    units = {n: SIDPAC[n][1] for n in (TIME, *inputs, *outputs)}
    return assemble(found, TIME, inputs, outputs, units, None, path.stem if name is None else name, constants)


def _grid(path: Path, variable: str, skip: int, delimiter: str | None) -> Grid:
    """The array of the file, 90 columns wide."""
    if path.suffix.lower() != ".mat":
        comma = "," if path.suffix.lower() == ".csv" else None
        grid = text_grid(path, skip=skip, delimiter=comma if delimiter is None else delimiter)
        fewest = COLUMNS
    else:
        grid = mat_grid(path, variable)
        fewest = FEWEST
    rows, count = grid.numbers.shape
    turned = " It may be the wrong way round: put time down the rows." if rows == COLUMNS != count else ""
    require(
        fewest <= count <= COLUMNS,
        f"{path.name} has {count} columns (and {rows} rows), and SIDPAC's layout {COLUMNS}.{turned} Read other layouts by "
        "`read_columns`.",
    )
    return grid._replace(numbers=np.pad(grid.numbers, ((0, 0), (0, COLUMNS - count))))


def _time(grid: Grid, t: np.ndarray) -> np.ndarray:
    """Column 1, which increases evenly."""
    require_finite(grid, SIDPAC, {TIME: t})
    require(bool(np.any(t != 0)), f"{grid.name}: column 1 (time) is not filled in. Give `sample_time` [s].")
    require_increasing(grid, t)
    steps = np.diff(t)
    row = int(np.argmax(np.abs(steps - np.median(steps))))
    require(
        is_uniform(t, STAMPS),
        f"{grid.name}, {grid.place(row + 1)}, column 1 (time): the step is {steps[row]:.6g} s, elsewhere {np.median(steps):.6g}. "
        "The layout wants even samples: bring them to one clock, or give `sample_time` where only the stamps are off.",
    )
    return t


def _constants(grid: Grid, found: Mapping[str, np.ndarray], names: Sequence[str]) -> dict[str, float]:
    """What does not change over the record [SI], and thrust where it does not."""
    constants = {}
    for group in CONSTANT:
        there = [n for n in group if n in names]
        require_finite(grid, SIDPAC, {n: found[n] for n in there})
        size = max((np.max(np.abs(found[n])) for n in there), default=0.0)
        for n in there:
            lowest, highest = np.min(found[n]), np.max(found[n])
            require(
                bool(highest - lowest <= STEADY * size),
                f"{grid.name}, column {SIDPAC[n][0]} ({n!r}) goes from {lowest:.6g} to {highest:.6g} {SIDPAC[n][1]}, and "
                f"is taken as constant. Cut the record into shorter ones, or read it as an input: inputs=(..., {n!r}).",
            )
            constants[n] = float(to_si(np.mean(found[n]), SIDPAC[n][1], n)[0])
    if "thrust" in names and np.all(found["thrust"] == found["thrust"][0]):
        constants["thrust"] = float(to_si(found["thrust"][0], SIDPAC["thrust"][1], "thrust")[0])
    return constants
