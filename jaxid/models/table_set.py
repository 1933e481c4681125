"""Many tables at once: quantities that share a grid are looked up together."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import numpy as np

from .._foundation.types import Array, Float
from ..data.io_table import GridData
from .tables import Extrapolation, Interpolation, Table


class TableSet(eqx.Module):
    """Named quantities in as few tables as there are grids. A value is called `Cm.alpha=10,beta=-5`.

    Args:
        grids: knots and values by name of quantity.
        interpolation: between knots, see `Table`.
        extrapolation: beyond them.

    Raises:
        InputError: when a grid cannot be a table.
    """

    tables: tuple[Table, ...]

    transparent: ClassVar[tuple[str, ...]] = ("tables",)

    def __init__(
        self,
        grids: Mapping[str, GridData],
        *,
        interpolation: Interpolation = "linear",
        extrapolation: Extrapolation = "hold",
    ):
        shared: dict[tuple, list[str]] = {}
        for name, grid in grids.items():
            shared.setdefault((grid.knots, grid.axes, grid.units), []).append(name)
        self.tables = tuple(
            Table(
                np.stack([grids[name].values for name in names], axis=-1),
                *(knots, axes),
                units=units,
                quantities=names,
                interpolation=interpolation,
                extrapolation=extrapolation,
            )
            for (knots, axes, units), names in shared.items()
        )

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        return {"tables": tuple(name for table in self.tables for name in table.element_names["values"])}

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """What all tables cover, by axis [SI]."""
        return _common([table.limits for table in self.tables])

    @property
    def refuses(self) -> dict[str, tuple[float, float]]:
        """Ranges outside which a table gives NaN, by axis [SI]."""
        return _common([table.limits for table in self.tables if table.extrapolation == "refuse"])

    def __call__(self, signals: Mapping[str, Float[Array, ""]]) -> dict[str, Float[Array, ""]]:
        """All quantities by name.

        Args:
            signals: scalars by name [SI].

        Raises:
            InputError: when the signal of an axis is not there.
        """
        return {
            name: value for table in self.tables for name, value in zip(table.quantities, table(signals), strict=True)
        }


def _common(ranges: list[dict[str, tuple[float, float]]]) -> dict[str, tuple[float, float]]:
    names = list(dict.fromkeys(name for limits in ranges for name in limits))
    pairs = {name: [limits[name] for limits in ranges if name in limits] for name in names}
    return {name: (max(low for low, _ in own), min(high for _, high in own)) for name, own in pairs.items()}
