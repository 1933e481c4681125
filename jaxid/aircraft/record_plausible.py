"""Whether the magnitudes of a record's channels can be those of an aircraft, or tell of another unit or sign."""

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require
from ..data.record import Record
from .atmosphere import StandardAtmosphere
from .record_air import density_of

# Largest sizes [rad, rad/s] that 95 % of the samples may have; single wild samples decide nothing. Beyond a right angle there is
# no angle of attack in controlled flight, and no pitch at all; the rates are 460 deg/s in roll, 230 in pitch and yaw.
LARGEST = {
    **dict.fromkeys(("alpha", "beta", "pitch", "stabilator", "aileron", "rudder"), np.pi / 2),
    **{"phi": 2 * np.pi, "p": 8.0, "q": 4.0, "r": 4.0},
}
LIGHT = 3.0  # m/s^2: specific force that hardly anybody flies for half of a record, and that of 3 g if read as g
DENSITY = (0.05, 1.6)  # kg/m^3, at 23 km and in arctic air at the ground
OFF = 1.15  # by which factor density may differ from the standard atmosphere's: 30 K make 1.12, an indicated V this at 1,500 m
CZ = (0.01, 5.0)  # force coefficient that carries the weight


def require_plausible(record: Record, *, mass: float, S: float, airspeed: str = "true") -> None:
    """Refuse a record whose magnitudes tell of another unit or sign than the one it was read with.

    Looked at are: angles and rates (in degrees?), the specific force az (in g? positive up? without gravity?), the density
    `2 qbar / V^2` beside the altitude's (V in knots or feet per second? indicated?), and the coefficient that carries the weight
    (mass in pounds? area in square feet?). `consistency` finds what is finer than a factor.

    Args:
        record: a single one, in SI units.
        mass: [kg].
        S: reference area [m^2].
        airspeed: what V is, "true" or "indicated".

    Raises:
        InputError: naming the channel, what is found, and what it looks like.
    """
    who = f"Record {record.names[0]!r}"
    end = "Read it with its unit, or pass `check=False` where it is right."
    for name, largest in LARGEST.items():
        values = _values(record, name)
        size = float(np.percentile(np.abs(values), 95)) if values.size else 0.0
        unit = "rad/s" if name in "pqr" else "rad"
        require(
            size <= largest,
            f"{who}: {name} reaches {size:.4g} {unit} ({np.degrees(size):.4g} in degrees). It looks like degrees. {end}",
        )
    az = float(np.median(_values(record, "az"))) if _values(record, "az").size else -9.81
    if az > -LIGHT:
        looks = "positive up" if az > LIGHT else "in g, or without gravity" if az < 0 else "in g and positive up"
        raise InputError(
            f"{who}: az is {az:.3g} m/s^2 in the middle, and a specific force, positive down, is about -9.8 in level flight. It "
            f"looks {looks}. {end}"
        )
    _require_air(record, who, end, airspeed)
    V, qbar = _values(record, "V"), _values(record, "qbar")
    if V.size:
        pressure = float(np.median(qbar)) if qbar.size else 0.5 * _density(record) * float(np.median(V)) ** 2
        lifting = -mass * az / (pressure * S)
        require(
            CZ[0] <= lifting <= CZ[1],
            f"{who}: with a mass of {mass:.4g} kg, S = {S:.4g} m^2 and qbar = {pressure:.4g} Pa the weight takes a force "
            f"coefficient of {lifting:.3g}. Check these numbers and their units, or pass `check=False`.",
        )


def _require_air(record: Record, who: str, end: str, airspeed: str) -> None:
    """Density from qbar and V beside what can be, and beside the altitude's."""
    found = density_of(record, airspeed)
    if found is None:
        return
    density = float(jnp.nanmedian(found))
    said = "its channel `density`" if "density" in (*record.inputs, *record.outputs) else "2 qbar / V^2"
    require(
        DENSITY[0] <= density <= DENSITY[1],
        f"{who}: the density is {density:.3g} kg/m^3 by {said}. V, qbar or density have another unit, or V is not the true "
        f"airspeed. {end}",
    )
    altitude = _values(record, "altitude")
    if altitude.size:
        height = float(np.median(altitude))
        standard = float(StandardAtmosphere().air(jnp.asarray(height)).density)
        require(
            1.0 / OFF <= density / standard <= OFF,
            f"{who}: the density is {density:.3g} kg/m^3 by {said}, and {standard:.3g} at its altitude of {height:.4g} m in a "
            f"standard atmosphere. V, qbar or altitude have another unit, or V is not the true airspeed. {end}",
        )


def _density(record: Record) -> float:
    """The density in the middle of the record, as far as it is said; at sea level else."""
    altitude = _values(record, "altitude")
    height = float(np.median(altitude)) if altitude.size else float(record.constants.get("altitude", 0.0))
    return float(StandardAtmosphere().air(jnp.asarray(height)).density)


def _values(record: Record, name: str) -> np.ndarray:
    """The valid samples of a channel, none where there is no such channel."""
    if name not in (*record.inputs, *record.outputs):
        return np.zeros(0)
    values = np.asarray(record.channel(name))
    return values[np.isfinite(values)]
