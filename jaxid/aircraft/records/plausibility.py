"""Check of the magnitudes of a flight record, which detects wrong units and signs."""

import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import InputError, require
from ...data.record import Record
from ..air.atmosphere import StandardAtmosphere
from .air_data import density_of, has_pressure

# Upper limits of the 95 % quantile of |channel| [rad, rad/s]; few outliers do not affect it.
# Chosen: an angle of attack above 90 deg does not occur in controlled flight, a pitch above 90 deg
# does not exist; the limits of the rates are 460 deg/s in roll, 230 deg/s in pitch and yaw.
LARGEST = {
    **dict.fromkeys(("alpha", "beta", "pitch", "stabilator", "aileron", "rudder"), np.pi / 2),
    **{"phi": 2 * np.pi, "p": 8.0, "q": 4.0, "r": 4.0},
}
# Least magnitude of the median az [m/s^2]. Chosen: a flight is rarely below it, and a record in g
# is below it unless the median load factor exceeds 3.
LIGHT = 3.0
DENSITY = (0.05, 1.6)  # kg/m^3; limits: standard air at 23 km, arctic air at the ground
# Largest ratio of the density to that of the standard atmosphere, or its inverse. Derived: air 30 K
# off the standard temperature gives 1.12, an indicated V 1.15 at 1,500 m.
DENSITY_FACTOR = 1.15
CZ = (0.01, 5.0)  # limits of |CZ| in mean flight, chosen


def require_plausible(record: Record, *, mass: float, S: float, airspeed: str = "true") -> None:
    """Raise an InputError if the magnitudes of a record indicate a wrong unit or sign.

    The checks and the mistakes that they detect:
        angles and rates: degrees in place of radians
        specific force az: unit g, positive up, or without gravity
        `2 qbar / V^2` against the standard density at the altitude: V in knots or feet per second,
            or indicated instead of true
        `-mass az / (qbar S)`: mass in pounds, or area in square feet

    `consistency` detects smaller errors.

    Args:
        record: a single record, in SI units.
        mass: mass of the aircraft [kg].
        S: reference area [m^2].
        airspeed: quantity of V, "true" or "indicated".

    Raises:
        InputError: with the channel, its value and the probable cause.
    """
    prefix = f"Record {record.names[0]!r}"
    advice = "Read it with its unit, or pass `check=False` where it is right."
    for name, largest in LARGEST.items():
        values = _values(record, name)
        size = float(np.percentile(np.abs(values), 95)) if values.size else 0.0
        unit = "rad/s" if name in "pqr" else "rad"
        require(
            size <= largest,
            f"{prefix}: {name} reaches {size:.4g} {unit} ({np.degrees(size):.4g} in degrees). It "
            f"looks like degrees. {advice}",
        )
    az = float(np.median(_values(record, "az"))) if _values(record, "az").size else -9.81
    if az > -LIGHT:
        cause = (
            "positive up"
            if az > LIGHT
            else "in g, or without gravity"
            if az < 0
            else "in g and positive up"
        )
        raise InputError(
            f"{prefix}: az is {az:.3g} m/s^2 in the middle, and a specific force, positive down, "
            "is about -9.8 in level flight. It "
            f"looks {cause}. Read it with its unit and sign (`signs={{'az': -1}}` of `read_csv`), "
            "or pass `check=False` where it is right."
        )
    _require_air(record, prefix, advice, airspeed)
    V, qbar = _values(record, "V"), _values(record, "qbar")
    if V.size:
        pressure = (
            float(np.median(qbar))
            if qbar.size
            else 0.5 * _density(record) * float(np.median(V)) ** 2
        )
        balancing_cz = -mass * az / (pressure * S)
        require(
            CZ[0] <= balancing_cz <= CZ[1],
            f"{prefix}: with a mass of {mass:.4g} kg, S = {S:.4g} m^2 and qbar = {pressure:.4g} Pa "
            "the weight takes a force "
            f"coefficient of {balancing_cz:.3g}. Check these numbers and their units, or pass "
            "`check=False`.",
        )


def _require_air(record: Record, prefix: str, advice: str, airspeed: str) -> None:
    """Raise an InputError for an impossible density, or one that contradicts the altitude.

    Both the channel `density` and the density `2 qbar / V^2`, which replaces it, are checked.
    """
    given = _values(record, "density")
    if given.size:
        _require_density(record, float(np.median(given)), "its channel `density`", prefix, advice)
    used = density_of(record, airspeed)
    if used is not None and has_pressure(record, airspeed):
        _require_density(record, float(jnp.nanmedian(used)), "2 qbar / V^2", prefix, advice)


def _require_density(record: Record, density: float, source: str, prefix: str, advice: str) -> None:
    """Raise an InputError for an implausible density [kg/m^3]; `source` is its origin in words."""
    require(
        DENSITY[0] <= density <= DENSITY[1],
        f"{prefix}: the density is {density:.3g} kg/m^3 by {source}. V, qbar or density have "
        "another unit, or V is not the true "
        f"airspeed. {advice}",
    )
    altitude = _values(record, "altitude")
    if altitude.size:
        height = float(np.median(altitude))
        standard = float(StandardAtmosphere().air(jnp.asarray(height)).density)
        require(
            1.0 / DENSITY_FACTOR <= density / standard <= DENSITY_FACTOR,
            f"{prefix}: the density is {density:.3g} kg/m^3 by {source}, and {standard:.3g} at its "
            f"altitude of {height:.4g} m in a "
            "standard atmosphere. V, qbar or altitude have another unit, or V is not the true "
            f"airspeed. {advice}",
        )


def _density(record: Record) -> float:
    """Return the standard density at the record's median altitude, else at sea level [kg/m^3]."""
    altitude = _values(record, "altitude")
    height = (
        float(np.median(altitude))
        if altitude.size
        else float(record.constants.get("altitude", 0.0))
    )
    return float(StandardAtmosphere().air(jnp.asarray(height)).density)


def _values(record: Record, name: str) -> np.ndarray:
    """Return the valid samples of a channel; an empty array if there is no such channel."""
    if name not in (*record.inputs, *record.outputs):
        return np.zeros(0)
    values = np.asarray(record.channel(name))
    return values[np.isfinite(values)]
