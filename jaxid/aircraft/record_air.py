"""The air that a record was flown in: density and altitude, from what it says of them."""

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError
from .._foundation.types import Array, Float
from ..data.record import Record
from .atmosphere import StandardAtmosphere

CEILING = 20000.0  # m, of the standard atmosphere at hand


def density_of(record: Record, airspeed: str = "true") -> Float[Array, " time"] | None:
    """The density that a record says [kg/m^3]: its channel, else what follows from `qbar` and V; None where it says neither.

        density = standard(altitude) * mean of (2 qbar / V^2) / standard(altitude)

    so that it follows the altitude, and the noise of qbar and V stays out. Where the altitude is not recorded, a straight line in
    time stands in its place.

    Args:
        record: a single one, with `density`, or with `qbar` and the true airspeed V.
        airspeed: what V is; from an indicated one nothing follows.
    """
    has = (*record.inputs, *record.outputs)
    if "density" in has:
        return record.channel("density")
    if not {"qbar", "V"} <= set(has) or airspeed != "true":
        return None
    ratio = np.asarray(2.0 * record.channel("qbar") / record.channel("V") ** 2)
    if "altitude" in has:
        standard = StandardAtmosphere().air(record.channel("altitude")).density
        return standard * np.nanmean(ratio / np.asarray(standard))
    t, known = np.asarray(record.t - jnp.mean(record.t)), np.isfinite(ratio)
    if np.sum(known) < 2:
        return jnp.full_like(record.t, jnp.nan)
    return jnp.asarray(np.polyval(np.polyfit(t[known], ratio[known], 1), t))


def air_known(record: Record, placed: set[str], airspeed: str = "true") -> tuple[tuple[str, ...], dict[str, float]]:
    """Which of density and altitude a model measures, and which it holds.

    Args:
        record: a single one.
        placed: what is settled already.
        airspeed: what V is, "true" or "indicated".

    Returns:
        Names of what is measured, and constants by name [kg/m^3, m].

    Raises:
        InputError: when the record says nothing of the air.
    """
    measured, held = [], {}
    density = density_of(record, airspeed)
    if "density" in placed:
        density = None
    elif density is not None:
        measured.append("density")
    elif "density" in record.constants:
        held["density"] = float(record.constants["density"])
    if "altitude" in placed:
        return tuple(measured), held
    if "altitude" in (*record.inputs, *record.outputs):
        return (*measured, "altitude"), held
    if "altitude" in record.constants:
        return tuple(measured), held | {"altitude": float(record.constants["altitude"])}
    if density is None and "density" not in held and "density" not in placed:
        raise InputError(
            f"Record {record.names[0]!r} says nothing of the air: no density, no qbar beside V, no altitude. Read one of them, "
            "or hold it: `held={'altitude': 3000.0}` [m]."
        )
    mean = held.get("density", None if density is None else float(jnp.nanmean(density)))
    return tuple(measured), held | {"altitude": 0.0 if mean is None else altitude_of(mean)}


def altitude_of(density: float) -> float:
    """The altitude of a density in the standard atmosphere, at most its ceiling and at least the sea [m].

    Args:
        density: [kg/m^3].
    """
    heights = np.linspace(0.0, CEILING, 2001)
    table = np.asarray(StandardAtmosphere().air(jnp.asarray(heights)).density)
    return float(np.interp(-density, -table, heights))
