"""`TableSet`: tables of many quantities; quantities on the same grid share a table."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import numpy as np

from .._foundation.types import Array, Float
from ..data.io.table import GridData
from .tables import Extrapolation, Interpolation, Table


class TableSet(eqx.Module):
    """Named quantities in tables, one table per grid.

    The name of a value is `Cm.alpha=10,beta=-5`.

    Args:
        grids: knots and values by name of quantity.
        interpolation: interpolation between knots, see `Table`.
        extrapolation: extrapolation beyond the knots.

    Raises:
        InputError: when a grid is not valid for a table.
    """

    tables: tuple[Table, ...]

    transparent: ClassVar[tuple[str, ...]] = ("tables",)

    def __init__(
        self,
        grids: Mapping[str, GridData],
        *,
        interpolation: Interpolation | str = Interpolation.LINEAR,
        extrapolation: Extrapolation | str = Extrapolation.HOLD,
    ):
        shared: dict[tuple, list[str]] = {}
        for name, grid in grids.items():
            shared.setdefault((grid.knots, grid.axes, grid.units), []).append(name)
        self.tables = tuple(
            Table(
                np.stack([grids[name].values for name in names], axis=-1),
                knots,
                axes,
                units=units,
                quantities=names,
                interpolation=interpolation,
                extrapolation=extrapolation,
            )
            for (knots, axes, units), names in shared.items()
        )

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        return {
            "tables": tuple(name for table in self.tables for name in table.element_names["values"])
        }

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Range that all tables cover, by axis [SI]."""
        return common_ranges([table.limits for table in self.tables])

    @property
    def hard_limits(self) -> dict[str, tuple[float, float]]:
        """Ranges outside which a table gives NaN, by axis [SI]."""
        return common_ranges(
            [table.limits for table in self.tables if table.extrapolation is Extrapolation.REFUSE]
        )

    def __call__(self, signals: Mapping[str, Float[Array, ""]]) -> dict[str, Float[Array, ""]]:
        """All quantities by name.

        Args:
            signals: scalars by name [SI].

        Raises:
            InputError: when the signal of an axis is missing.
        """
        return {
            name: value
            for table in self.tables
            for name, value in zip(table.quantities, table(signals), strict=True)
        }


def common_ranges(ranges: list[dict[str, tuple[float, float]]]) -> dict[str, tuple[float, float]]:
    """Return the intersection of the ranges of each name.

    Args:
        ranges: lowest and highest value by name [SI].
    """
    names = list(dict.fromkeys(name for limits in ranges for name in limits))
    pairs = {name: [limits[name] for limits in ranges if name in limits] for name in names}
    return {
        name: (max(low for low, _ in limits), min(high for _, high in limits))
        for name, limits in pairs.items()
    }
