"""The air that a record was flown in: density and altitude, from what it says of them."""

import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError
from .._foundation.types import Array, Float
from ..data.record import Record
from ..data.smoothing_spline import SmoothingSpline
from .atmosphere import StandardAtmosphere

SLOW = 0.25  # Hz
FEWEST = 8  # samples, for a spline
CEILING = 20000.0  # m, of the standard atmosphere at hand


def density_of(record: Record, airspeed: str = "true") -> Float[Array, " time"] | None:
    """The density that a record says [kg/m^3]: its channel, else what follows from `qbar` and V; None where it says neither.

        density = standard(altitude) * mean of (2 qbar / V^2) / standard(altitude)

    so that it follows the altitude, and the noise of qbar and V stays out. Where the altitude is not recorded, `2 qbar / V^2` is
    smoothed by a spline that passes what is slower than 0.25 Hz, as no altitude changes faster.

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
    t, known = np.asarray(record.t), np.isfinite(ratio)
    if np.sum(known) < FEWEST:
        return jnp.asarray(ratio)
    if "altitude" in has:
        standard = _standard(record.channel("altitude"))
        return standard * np.nanmean(ratio[known] / np.asarray(standard)[known])
    there = t[known]
    cutoff = np.clip(SLOW, 0.25 / (there[-1] - there[0]), 0.5 / np.mean(np.diff(there)))  # as far as the spline can
    return jnp.asarray(np.interp(t, there, SmoothingSpline(float(cutoff))(there, ratio[known]).value))


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
    return float(np.interp(-density, -np.asarray(_standard(jnp.asarray(heights))), heights))


def _standard(altitude: Float[Array, " sample"]) -> Float[Array, " sample"]:
    """Density of the standard atmosphere at altitudes [m]."""
    return jax.vmap(StandardAtmosphere().air)(altitude).density
