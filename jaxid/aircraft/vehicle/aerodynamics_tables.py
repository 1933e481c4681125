"""Coefficients as look-up tables: a static part, and parts in proportion to controls and rates."""

import functools
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import InputError, require, require_known
from ..._foundation.types import Array, Float
from ...data.io.table import GridData, read_table
from ...models.table_set import TableSet
from ...models.tables import Extrapolation, Interpolation
from .aerodynamics import COEFFICIENTS, AbstractAerodynamics

TABLE_FACTORS = {
    "": "",
    **{"p": "phat", "q": "qhat", "r": "rhat"},
    **{"ds": "stabilator", "da": "aileron", "dr": "rudder"},
}
ANGLE_AXES = ("alpha", "beta", "stabilator", "aileron", "rudder")


class TableAerodynamics(AbstractAerodynamics):
    r"""Six coefficients from tables, `C = C(alpha, beta) + sum_k C_k(alpha, beta) s_k` (App. D.1.1,
    D.1.2).

    The name of a table defines its role: a coefficient alone, such as `Cm`, is the static part; the
    suffix `p`, `q` or `r` makes it the factor of `phat`, `qhat` or `rhat`, and `ds`, `da` or `dr`
    the factor of `stabilator`, `aileron` or `rudder`, all per radian. Each table has its own axes,
    with names of signals; a missing table is zero. The name of a value is `Cmds.alpha=10`.

    Args:
        grids: knots and values by name of table, as `read_coefficients` reads them from a folder.
        interpolation: between knots, see `Table`.
        extrapolation: beyond the knots.

    Raises:
        InputError: when a name is not of this form, or a grid cannot be a table.
    """

    tables: TableSet

    transparent: ClassVar[tuple[str, ...]] = ("tables",)

    def __init__(
        self,
        grids: Mapping[str, GridData],
        *,
        interpolation: Interpolation | str = Interpolation.MONOTONE,
        extrapolation: Extrapolation | str = Extrapolation.HOLD,
    ):
        require_known(
            "aerodynamic table",
            grids,
            [c + suffix for c in COEFFICIENTS for suffix in TABLE_FACTORS],
        )
        self.tables = TableSet(grids, interpolation=interpolation, extrapolation=extrapolation)

    def coefficients(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " coefficient"]:
        require_known("signal", [factor for factor in TABLE_FACTORS.values() if factor], signals)
        total = jnp.zeros(len(COEFFICIENTS))
        for table in self.tables.tables:
            parts = [
                (COEFFICIENTS.index(name[:2]), TABLE_FACTORS[name[2:]]) for name in table.quantities
            ]
            static = jnp.ones(())
            factors = jnp.stack([signals[factor] if factor else static for _, factor in parts])
            into = np.array(
                [[float(row == k) for row, _ in parts] for k in range(len(COEFFICIENTS))]
            )
            total = total + into @ (factors * table(signals))
        return total

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        return self.tables.limits

    @property
    def hard_limits(self) -> dict[str, tuple[float, float]]:
        return self.tables.hard_limits


def read_coefficients(folder: str | Path) -> Mapping[str, GridData]:
    """Read all tables of a folder: `Cm.csv` is the table `Cm`. A folder is read again only if a
    file has changed.

    A file has a column for each axis with its unit, such as `alpha_deg`, a column with the name of
    the file, and may have a column `origin` with the source of each value.

    Args:
        folder: folder of the CSV files.

    Returns:
        Grids by name.

    Raises:
        InputError: when the folder holds no CSV file, a file cannot be read, or an angle comes
            without its unit.
    """
    files = sorted(Path(folder).glob("*.csv"))
    require(
        len(files) > 0,
        f"There is no CSV file in the folder {folder}. Give one for each table, such as Cm.csv.",
    )
    return _read(tuple((file, file.stat().st_mtime_ns, file.stat().st_size) for file in files))


@functools.cache
def _read(stamped: tuple[tuple[Path, int, int], ...]) -> Mapping[str, GridData]:
    """Read the tables of files, given with time of last change and size as key of the cache."""
    files = [file for file, *_ in stamped]
    grids = {file.stem: read_table(file, value=file.stem) for file in files}
    for name, grid in grids.items():
        for axis, unit in zip(grid.axes, grid.units, strict=True):
            if axis.removeprefix("abs_") in ANGLE_AXES and unit != "rad":
                unit_text = f"the unit [{unit}]" if unit else "no unit"
                raise InputError(
                    f"{name}.csv: the axis {axis!r} is an angle and has {unit_text}. Call its "
                    f"column '{axis}_deg' or '{axis}_rad'."
                )
    return MappingProxyType(grids)


def origins(grids: Mapping[str, GridData]) -> dict[str, str]:
    """Return the origin of each value, by its parameter name, such as `Cm.alpha=10,beta=-5`.

    Args:
        grids: by name of table.

    Returns:
        The texts of the column `origin`, for files with this column.
    """
    return {
        value: str(origin)
        for name, grid in grids.items()
        if grid.origin is not None
        for value, origin in zip(
            TableSet({name: grid}).element_names["tables"], grid.origin.ravel(), strict=True
        )
    }
