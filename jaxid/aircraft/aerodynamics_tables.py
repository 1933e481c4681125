"""Coefficients as look-up tables: a static part, and parts in proportion to controls and rates."""

import functools
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require, require_known
from .._foundation.types import Array, Float
from ..data.io_table import GridData, read_table
from ..models.table_set import TableSet
from ..models.tables import Extrapolation, Interpolation
from .aerodynamics import COEFFICIENTS, AbstractAerodynamics

FACTORS = {
    "": "",
    **{"p": "phat", "q": "qhat", "r": "rhat"},
    **{"ds": "stabilator", "da": "aileron", "dr": "rudder"},
}
ANGLES = ("alpha", "beta", "stabilator", "aileron", "rudder")


class TableAerodynamics(AbstractAerodynamics):
    r"""Six coefficients from tables, `C = C(alpha, beta) + sum_k C_k(alpha, beta) s_k` (App. D.1.1, D.1.2).

    The name of a table says what it is: a coefficient alone is the static part; behind it `p`, `q` or `r` make it the factor of
    `phat`, `qhat` or `rhat`, and `ds`, `da` or `dr` that of `stabilator`, `aileron` or `rudder`, all per radian. Each table
    has its own axes, named like signals; what is not there is zero. A value is called `Cmds.alpha=10`.

    Args:
        grids: knots and values by name of table, as `read_coefficients` reads them from a folder.
        interpolation: between knots, see `Table`.
        extrapolation: beyond them.

    Raises:
        InputError: when a name is none of these, or a grid cannot be a table.
    """

    tables: TableSet

    transparent: ClassVar[tuple[str, ...]] = ("tables",)

    def __init__(
        self,
        grids: Mapping[str, GridData],
        *,
        interpolation: Interpolation = "monotone",
        extrapolation: Extrapolation = "hold",
    ):
        require_known("aerodynamic table", grids, [c + suffix for c in COEFFICIENTS for suffix in FACTORS])
        self.tables = TableSet(grids, interpolation=interpolation, extrapolation=extrapolation)

    def coefficients(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " coefficient"]:
        require_known("signal", [factor for factor in FACTORS.values() if factor], signals)
        total = jnp.zeros(len(COEFFICIENTS))
        for table in self.tables.tables:
            parts = [(COEFFICIENTS.index(name[:2]), FACTORS[name[2:]]) for name in table.quantities]
            one = jnp.ones(())
            factors = jnp.stack([signals[factor] if factor else one for _, factor in parts])
            into = np.array([[float(row == k) for row, _ in parts] for k in range(len(COEFFICIENTS))])
            total = total + into @ (factors * table(signals))
        return total

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        return self.tables.limits

    @property
    def refuses(self) -> dict[str, tuple[float, float]]:
        return self.tables.refuses


def read_coefficients(folder: str | Path) -> Mapping[str, GridData]:
    """Read all tables of a folder, `Cm.csv` the table `Cm`; again only where a file has changed.

    A file has a column for each axis with its unit, such as `alpha_deg`, one called as the file, and may have one called
    `origin` that says where a value comes from.

    Args:
        folder: holds the CSV files.

    Returns:
        Grids by name.

    Raises:
        InputError: when the folder holds no CSV file, a file cannot be read, or an angle comes without its unit.
    """
    files = sorted(Path(folder).glob("*.csv"))
    require(len(files) > 0, f"There is no CSV file in the folder {folder}. Give one for each table, such as Cm.csv.")
    return _read(tuple((file, file.stat().st_mtime_ns, file.stat().st_size) for file in files))


@functools.cache
def _read(stamped: tuple[tuple[Path, int, int], ...]) -> Mapping[str, GridData]:
    """The tables of these files, with the time of their last change and their size."""
    files = [file for file, *_ in stamped]
    grids = {file.stem: read_table(file, value=file.stem) for file in files}
    for name, grid in grids.items():
        for axis, unit in zip(grid.axes, grid.units, strict=True):
            if axis.removeprefix("abs_") in ANGLES and unit != "rad":
                found = f"the unit [{unit}]" if unit else "no unit"
                raise InputError(
                    f"{name}.csv: the axis {axis!r} is an angle and has {found}. Call its column '{axis}_deg' or '{axis}_rad'."
                )
    return MappingProxyType(grids)


def origins(grids: Mapping[str, GridData]) -> dict[str, str]:
    """Where each value comes from, by the name that it has as a parameter, `Cm.alpha=10,beta=-5`.

    Args:
        grids: by name of table.

    Returns:
        The words of the column `origin`, for those files that have one.
    """
    return {
        value: str(origin)
        for name, grid in grids.items()
        if grid.origin is not None
        for value, origin in zip(TableSet({name: grid}).element_names["tables"], grid.origin.ravel(), strict=True)
    }
