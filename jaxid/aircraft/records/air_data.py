"""Air density and altitude along a flight, from the channels and constants of its record."""

import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import InputError
from ..._foundation.types import Array, Float
from ...data.record import Record
from ...data.smoothing.spline import SmoothingSpline
from ..air.atmosphere import StandardAtmosphere

SLOW_FREQUENCY = 0.25  # Hz, chosen: the density along a flight varies more slowly
MIN_SAMPLES = 8  # least number of valid samples for a spline, chosen
CEILING = 20000.0  # m, the validity limit of `StandardAtmosphere`


def density_of(record: Record, airspeed: str = "true") -> Float[Array, " time"] | None:
    """Return the density of the air at each sample [kg/m^3], or None if the record does not
    determine it.

        density = standard(altitude) * mean of (2 qbar / V^2) / standard(altitude)

    varies with the recorded altitude; the mean reduces the noise of qbar and V. Without a recorded
    altitude, `2 qbar / V^2` is smoothed by a spline with a cut-off frequency of 0.25 Hz.

    The channel `density` is used only if qbar or the true V is missing, or if fewer than 8 samples
    of both are valid. Reason: such a channel usually comes from a standard atmosphere and then
    disagrees with the measured qbar, which scales the forces.

    Args:
        record: a single record, with `qbar` and the true airspeed V, or with `density`.
        airspeed: quantity of V, "true" or "indicated"; from an indicated airspeed the density
            cannot be computed.
    """
    channels = {*record.inputs, *record.outputs}
    recorded = record.channel("density") if "density" in channels else None
    if not has_pressure(record, airspeed):
        return recorded
    ratio = np.asarray(2.0 * record.channel("qbar") / record.channel("V") ** 2)
    t, valid = np.asarray(record.t), np.isfinite(ratio)
    if np.sum(valid) < MIN_SAMPLES:
        return jnp.asarray(ratio) if recorded is None else recorded
    if "altitude" in channels:
        standard = _standard(record.channel("altitude"))
        return standard * np.nanmean(ratio[valid] / np.asarray(standard)[valid])
    valid_t = t[valid]
    cutoff = np.clip(
        SLOW_FREQUENCY, 0.25 / (valid_t[-1] - valid_t[0]), 0.5 / np.mean(np.diff(valid_t))
    )  # cut-off within the range that the spline accepts
    return jnp.asarray(
        np.interp(t, valid_t, SmoothingSpline(float(cutoff))(valid_t, ratio[valid]).value)
    )


def has_pressure(record: Record, airspeed: str) -> bool:
    """True if a record has the dynamic pressure and the true airspeed, which give the density."""
    return {"qbar", "V"} <= {*record.inputs, *record.outputs} and airspeed == "true"


def air_known(
    record: Record, placed: set[str], airspeed: str = "true"
) -> tuple[tuple[str, ...], dict[str, float]]:
    """Return which of density and altitude are measured, and constant values if they are not.

    An altitude that is neither measured nor given is that of the mean density in the standard
    atmosphere.

    Args:
        record: a single record.
        placed: names of signals that the model has already; they are not returned.
        airspeed: quantity of V, "true" or "indicated".

    Returns:
        Names of the measured signals, and constants by name [kg/m^3, m].

    Raises:
        InputError: when neither density nor altitude can be determined.
    """
    density = None if "density" in placed else density_of(record, airspeed)
    measured = () if density is None else ("density",)
    constants = {}
    if density is None and "density" not in placed and "density" in record.constants:
        constants["density"] = float(record.constants["density"])
    if "altitude" in placed:
        return measured, constants
    if "altitude" in (*record.inputs, *record.outputs):
        return (*measured, "altitude"), constants
    if "altitude" in record.constants:
        return measured, constants | {"altitude": float(record.constants["altitude"])}
    if not {*placed, *measured, *constants} & {"density"}:
        raise InputError(
            f"Record {record.names[0]!r} has no data of the air: no density, no qbar with V, no "
            "altitude. Read one of them, "
            "or hold it: `held={'altitude': 3000.0}` [m]."
        )
    return measured, constants | {"altitude": _altitude_of_mean(density, constants)}


def _altitude_of_mean(density: Float[Array, " time"] | None, constants: dict[str, float]) -> float:
    """Return the standard altitude of the mean density [m]; zero if no density is given."""
    if "density" in constants:
        return altitude_of(constants["density"])
    return 0.0 if density is None else altitude_of(float(jnp.nanmean(density)))


def altitude_of(density: float) -> float:
    """Return the altitude at which the standard atmosphere has a given density [m].

    It is limited to the range from sea level to 20 km.

    Args:
        density: [kg/m^3].
    """
    heights = np.linspace(0.0, CEILING, 2001)
    return float(np.interp(-density, -np.asarray(_standard(jnp.asarray(heights))), heights))


def _standard(altitude: Float[Array, " sample"]) -> Float[Array, " sample"]:
    """Return the density of the standard atmosphere at altitudes [m]."""
    return jax.vmap(StandardAtmosphere().air)(altitude).density
