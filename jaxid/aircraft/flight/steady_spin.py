"""`steady_spin`: equilibrium of a spin at given surfaces."""

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import require, require_known
from ..._foundation.types import Array, Float
from ...simulation.trim import solve_equilibrium
from ..air.wind import Wind
from ..physics.frames import quaternion, rotation, velocity
from ..vehicle.controls import SURFACES
from .aircraft import Aircraft
from .trims import ACCELERATIONS, ANGLE_LIMITS, TRIM_TOLERANCE, Trimmed

UNKNOWN = {"V": "m/s", "alpha": "rad", "beta": "rad", "phi": "rad", "pitch": "rad"}
UNKNOWN |= {"turn_rate": "rad/s"}
LIMITS = ANGLE_LIMITS | {"V": (10.0, 400.0), "turn_rate": (-10.0, 10.0)}  # chosen
SPIN_STARTS_DEG = (80.0, 60.0, 45.0)  # chosen: initial angles of attack, one after the other
START_V = 90.0  # m/s (chosen)
REMEDY = (
    "Start at another rate or angle of attack, or choose other surfaces: not every aircraft has a "
    "spin at every deflection."
)


class _Spin(NamedTuple):
    """Given values of a spin: aircraft in calm air, altitude [m], surfaces [rad], setting."""

    aircraft: Aircraft
    altitude: Float[Array, ""]
    surfaces: dict[str, Float[Array, ""]]
    setting: Float[Array, ""]


def steady_spin(
    aircraft: Aircraft,
    altitude: Float[Array, ""] | float,
    surfaces: Mapping[str, Float[Array, ""] | float],
    *,
    turn_rate: float,
    alpha: float | None = None,
    setting: Float[Array, ""] | float = 0.0,
) -> Trimmed:
    """Return a steady spin at given surfaces: a descent along a helix about the vertical, relative
    to the air.

        (p, q, r) = turn_rate (-sin(pitch), sin(phi) cos(pitch), cos(phi) cos(pitch))
        udot = vdot = wdot = pdot = qdot = rdot = 0

    The unknowns are V, alpha, beta, phi, pitch and the turn rate. The density is constant, at this
    altitude. The wind at this altitude is added to the velocity of the returned state. An aircraft
    may have several spins, or none; the start of the search selects one. A spin may be unstable:
    simulate a flight from the returned state.

    Args:
        aircraft: aircraft; its feedback and actuators are out of the loop.
        altitude: altitude [m].
        surfaces: stabilator, aileron and rudder [rad]; zero for a surface that is not given.
        turn_rate: start of the search, positive to the right, such as 2.0 [rad/s].
        alpha: start of the search [rad]; by default 80, 60 and 45 deg in turn.
        setting: setting of every engine (the thrust [N] of a constant thrust).

    Returns:
        Aircraft with these surfaces, state and equilibrium.

    Raises:
        InputError: for an unknown surface, a rate of zero, or if no spin is found.
    """
    require_known("surface", surfaces, SURFACES)
    require(turn_rate != 0, "The start of the turn rate is zero; a spin turns, such as at 2 rad/s.")
    known = {name: jnp.asarray(surfaces.get(name, 0.0), float) for name in SURFACES}
    calm = eqx.tree_at(lambda node: node.wind, aircraft, Wind())
    spin = _Spin(calm, jnp.asarray(altitude, float), known, jnp.asarray(setting, float))
    angles = np.radians(SPIN_STARTS_DEG) if alpha is None else np.array([alpha])
    starts = [[START_V, angle, 0.0, 0.0, angle - np.pi / 2, turn_rate] for angle in angles]
    trim = solve_equilibrium(
        _residual,
        jnp.array(starts),
        spin,
        names=tuple(UNKNOWN),
        units=tuple(UNKNOWN.values()),
        equations=tuple(ACCELERATIONS),
        equation_units=tuple(ACCELERATIONS.values()),
        lower=jnp.array([LIMITS[name][0] for name in UNKNOWN]),
        upper=jnp.array([LIMITS[name][1] for name in UNKNOWN]),
        tolerance=TRIM_TOLERANCE,
        remedy=REMEDY,
    )
    through_air, omega, e = _motion(trim.values)
    ground = through_air + rotation(e) @ aircraft.wind.velocity(spin.altitude)
    position = jnp.stack([jnp.zeros(()), jnp.zeros(()), spin.altitude])
    held = aircraft.trimmed(known, spin.setting)
    return Trimmed(held, held.flight_state(ground, omega, e, position), trim)


def _motion(values: Float[Array, " unknown"]):
    """Return velocity [m/s], angular rate [rad/s] and attitude, a quaternion, in body axes."""
    V, alpha, beta, phi, pitch, turn_rate = values
    e = quaternion(phi, pitch, 0.0)
    return velocity(V, alpha, beta), turn_rate * rotation(e)[:, 2], e


def _residual(values: Float[Array, " unknown"], spin: _Spin) -> Float[Array, " equation"]:
    through_air, omega, e = _motion(values)
    return spin.aircraft.steady_rates(
        through_air, omega, e, spin.altitude, spin.surfaces, spin.setting
    )
