"""The engine of the F-16 with the tables of Stevens and Lewis."""

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

import numpy as np

from ..._foundation.types import Array, Float
from ...data.io.table import GridData, read_table
from ...data.units import convert
from ...models.tables import Table
from ..vehicle.engine import Engine
from ..vehicle.turbofan import RATINGS, Turbofan
from .shared import DATA


def f16_engine(setting: Float[Array, ""] | float = 0.0) -> Engine:
    """Return the F-16's engine, along the x axis through the centre of gravity, with an angular
    momentum of 160 slug ft^2/s.

    Use it as `Aircraft(f16_low(), engines=(f16_engine(),))`; a trim then solves for its throttle.

    Args:
        setting: throttle in trim, 0 to 1.

    Source: Stevens and Lewis, Aircraft Control and Simulation, 2nd ed., Wiley 2003, App. A.
    """
    momentum = float(convert(160.0, "slug*ft^2/s", "kg*m^2/s"))
    return Engine(Turbofan(f16_thrust(), setting), momentum=momentum)


def f16_thrust() -> Table:
    """Return the thrust of the F-16's engine at `idle`, `mil` (military) and `max` power [N], over
    `altitude` [m] and `mach`.

    The knots are 0 to 50,000 ft and Mach 0 to 1; interpolation and extrapolation are linear, as in
    Stevens and Lewis, App. A.
    """
    grids = _thrust()
    first = grids[RATINGS[0]]
    values = np.stack([grids[name].values for name in RATINGS], axis=-1)
    return Table(
        values,
        first.knots,
        first.axes,
        units=first.units,
        quantities=RATINGS,
        extrapolation="linear",
    )


@cache
def _thrust() -> Mapping[str, GridData]:
    """Read the engine's three tables (cached)."""
    file = DATA / "f16_low" / "engine" / "thrust.csv"
    return MappingProxyType(
        {name: read_table(file, value=name, axes=("altitude", "mach")) for name in RATINGS}
    )
