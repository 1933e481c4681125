"""Flight records in the layout of SIDPAC: an array `fdata` of 90 columns."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ..._foundation.checks import require, require_known
from ..._foundation.grid import is_uniform
from ..build import TIME
from ..record import Record
from ..units import to_si
from .assemble import assemble, clock, existing
from .columns import Grid, column, mat_grid, require_finite, require_increasing, text_grid
from .layouts import SIDPAC

COLUMNS = 90
# Last column of the moments and products of inertia. Older versions of the layout end at different
# columns after it.
MIN_COLUMNS = 52
SURFACES = ("stabilator", "aileron", "rudder")
# Largest range, relative to its size, of a mass or inertia that is taken as constant (chosen).
CONSTANT_RANGE = 1e-2
# relative difference of steps that is taken as rounding of the time stamps (chosen)
TIMESTAMP_RTOL = 1e-2
# Constants of a record, in groups of the same size: the range of a butt line near zero is compared
# with the fuselage station.
CONSTANT = (("xcg", "ycg", "zcg"), ("mass",), ("Ix", "Iy", "Iz", "Ixz"), ("S",), ("b",), ("cbar",))


def read_sidpac(
    path: str | Path,
    *,
    inputs: Sequence[str] = SURFACES,
    outputs: Sequence[str] | None = None,
    sample_time: float | int | None = None,
    signs: Mapping[str, int] | None = None,
    variable: str = "fdata",
    skip: int = 0,
    delimiter: str | None = None,
    name: str | None = None,
) -> Record:
    """Read one record from a file in SIDPAC's layout, a MATLAB file (up to version 7) or text of 90
    columns.

    These columns are read, in SI (`SIDPAC` has the numbers, units and sources):

    - outputs, if not empty: `V alpha beta p q r phi pitch psi ax ay az qbar mach density altitude
      pdot qdot rdot`;
    - inputs: `stabilator` (the elevator's column), `aileron`, `rudder`, as recorded, also if zero;
    - `thrust`, the sum of columns 38 to 41, if not empty: an input if it varies, else a constant;
    - constants, if not empty: `mass Ix Iy Iz Ixz S b cbar`, and `xcg ycg zcg` [m] as recorded:
      fuselage station, butt line and waterline, positive aft, right and up. A column that varies by
      up to 1 % of its size is replaced by its mean, as in SIDPAC.

    A column of zeros is empty, as in SIDPAC. Other columns are not read. `NaN` in an output is a
    missing sample.

    Signs stay as recorded. The layout does not define the signs of the surfaces. In the F-16
    simulation of SIDPAC, as in this library, positive elevator is nose down, positive aileron rolls
    left and positive rudder yaws left. Check the signs of a new aircraft, and reverse those that
    differ by `signs`.

    Args:
        path: the file; `.mat` for MATLAB, else text.
        inputs: channels that are inputs, any of the channels above.
        outputs: channels to read as outputs, in this order; all that are not empty when left out.
        sample_time: time between samples [s], in place of column 1.
        signs: 1 or -1 by channel, such as `{"aileron": -1}`; 1 for the other channels.
        variable: the array's name in a MATLAB file. This array may have fewer columns, down to 52,
            as older versions do; the missing columns count as empty.
        skip: number of header lines at the top of a text file.
        delimiter: separator of the numbers of a text file; when left out a comma in a `.csv` file,
            else blanks.
        name: name of the record; the stem of the file when left out.

    Returns:
        The record, in SI units.

    Raises:
        InputError: when there is no such file or variable, it has not 90 columns, time does not
            increase evenly (to 1 %), time, an input or a constant is not finite, a constant varies
            by more than 1 %, an input, output or sign is of an unknown channel, a chosen output is
            empty, an input or a constant, or all outputs are empty. The message names file, column
            and row.
    """
    path, signs = existing(path), signs or {}
    grid = _grid(path, variable, skip, delimiter)
    _check_options(inputs, outputs or (), signs, path)
    channels = _columns(grid, signs)
    channels[TIME] = (
        _time(grid, channels[TIME])
        if sample_time is None
        else clock(sample_time, len(grid.numbers), path)
    )
    filled = _filled(channels)
    constants = _constants(grid, channels, [n for n in filled if n not in inputs])
    inputs = _with_thrust(inputs, filled, constants)
    available = [n for n in filled if n not in (TIME, *inputs, *constants)]
    outputs = available if outputs is None else list(outputs)
    require_known(f"output in {path.name} that is filled in", outputs, available)
    require_finite(grid, SIDPAC, {n: channels[n] for n in (TIME, *inputs)})
    units = {n: SIDPAC[n][1] for n in (TIME, *inputs, *outputs)}
    return assemble(
        channels, TIME, inputs, outputs, units, None, path.stem if name is None else name, constants
    )


def _check_options(
    inputs: Sequence[str], outputs: Sequence[str], signs: Mapping[str, int], path: Path
) -> None:
    """Refuse channels that the layout does not have, and signs other than 1 and -1."""
    require_known(
        "channel of SIDPAC's layout (in `inputs`)", inputs, [n for n in SIDPAC if n != TIME]
    )
    require_known(
        "channel of SIDPAC's layout (in `outputs`)", outputs, [n for n in SIDPAC if n != TIME]
    )
    require_known("channel of SIDPAC's layout (in `signs`)", signs, SIDPAC)
    for n, sign in signs.items():
        require(sign in (1, -1), f"{path.name}: the sign of {n!r} is {sign}. Give 1 or -1.")


def _grid(path: Path, variable: str, skip: int, delimiter: str | None) -> Grid:
    """The array of the file, padded by zeros to 90 columns."""
    if path.suffix.lower() != ".mat":
        comma = "," if path.suffix.lower() == ".csv" else None
        grid = text_grid(path, skip=skip, delimiter=comma if delimiter is None else delimiter)
        min_columns = COLUMNS
    else:
        grid = mat_grid(path, variable)
        min_columns = MIN_COLUMNS
    rows, count = grid.numbers.shape
    advice = " It may be transposed: each row must be a time." if rows == COLUMNS != count else ""
    require(
        min_columns <= count <= COLUMNS,
        f"{path.name} has {count} columns (and {rows} rows), and SIDPAC's layout "
        f"{COLUMNS}.{advice} Read other layouts by `read_columns`.",
    )
    return grid._replace(numbers=np.pad(grid.numbers, ((0, 0), (0, COLUMNS - count))))


def _columns(grid: Grid, signs: Mapping[str, int]) -> dict[str, np.ndarray]:
    """Channels by name, in the layout's units, with the signs of this library."""
    return {n: signs.get(n, 1) * column(grid, SIDPAC, n) for n in SIDPAC}


def _filled(channels: Mapping[str, np.ndarray]) -> list[str]:
    """Names of the channels that are not all zeros."""
    return [name for name, values in channels.items() if np.any(values != 0)]


def _with_thrust(
    inputs: Sequence[str], filled: Sequence[str], constants: Mapping[str, float]
) -> Sequence[str]:
    """The inputs, with the thrust if it is not empty and varies."""
    varies = "thrust" in filled and "thrust" not in (*inputs, *constants)
    return (*inputs, "thrust") if varies else inputs


def _time(grid: Grid, t: np.ndarray) -> np.ndarray:
    """Column 1; times that do not increase evenly are refused."""
    require_finite(grid, SIDPAC, {TIME: t})
    require(
        bool(np.any(t != 0)),
        f"{grid.name}: column 1 (time) is not filled in. Give `sample_time` [s].",
    )
    require_increasing(grid, t)
    steps = np.diff(t)
    row = int(np.argmax(np.abs(steps - np.median(steps))))
    require(
        is_uniform(t, TIMESTAMP_RTOL),
        f"{grid.name}, {grid.place(row + 1)}, column 1 (time): the step is {steps[row]:.6g} s, "
        f"elsewhere {np.median(steps):.6g}. "
        "The layout needs even samples: resample them to even times, or give `sample_time` where "
        "only the time stamps are wrong.",
    )
    return t


def _constants(
    grid: Grid, channels: Mapping[str, np.ndarray], names: Sequence[str]
) -> dict[str, float]:
    """Constants of the record [SI], with the thrust if it does not vary."""
    constants = {}
    for group in CONSTANT:
        filled = [n for n in group if n in names]
        require_finite(grid, SIDPAC, {n: channels[n] for n in filled})
        size = max((np.max(np.abs(channels[n])) for n in filled), default=0.0)
        for n in filled:
            lowest, highest = np.min(channels[n]), np.max(channels[n])
            require(
                bool(highest - lowest <= CONSTANT_RANGE * size),
                f"{grid.name}, column {SIDPAC[n][0]} ({n!r}) goes from {lowest:.6g} to "
                f"{highest:.6g} {SIDPAC[n][1]}, and "
                "must be constant. Cut the record into shorter ones, or read it as an input: "
                f"inputs=(..., {n!r}).",
            )
            constants[n] = float(to_si(np.mean(channels[n]), SIDPAC[n][1], n)[0])
    if "thrust" in names and np.all(channels["thrust"] == channels["thrust"][0]):
        constants["thrust"] = float(to_si(channels["thrust"][0], SIDPAC["thrust"][1], "thrust")[0])
    return constants
