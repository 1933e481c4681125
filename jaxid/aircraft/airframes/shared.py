"""Data folder of the airframes, and conversion of the units of the sources."""

import math
from pathlib import Path

from ...data.units import convert
from ..physics.mass import MassProperties

DATA = Path(__file__).parent / "data"


def ft(length: float) -> float:
    """Return metres from feet."""
    return float(convert(length, "ft", "m"))


def ft2(area: float) -> float:
    """Return square metres from square feet."""
    return float(convert(area, "ft^2", "m^2"))


def angles(**ranges_deg: tuple[float, float]) -> dict[str, tuple[float, float]]:
    """Return ranges of angles by name, from degrees [rad]."""
    return {
        name: (math.radians(low), math.radians(high)) for name, (low, high) in ranges_deg.items()
    }


def mass_properties(*, weight_lb: float, **inertia_slug_ft2: float) -> MassProperties:
    """Return mass and inertia [SI] from the pounds and slugs of American sources; Ixy and Iyz are
    zero by default.
    """
    inertia = {
        name: float(convert(value, "slug*ft^2", "kg*m^2"))
        for name, value in inertia_slug_ft2.items()
    }
    return MassProperties(mass=float(convert(weight_lb, "lb", "kg")), **inertia)
