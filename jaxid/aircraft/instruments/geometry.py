"""Readings of ideal instruments at their position and along their axis (App. D.2)."""

from collections.abc import Mapping

import jax.numpy as jnp

from ..._foundation.types import Array, Float
from ..air.atmosphere import indicated_airspeed
from .channels import ANGULAR, FLOW, FORCE, RATES

Signals = Mapping[str, Float[Array, ""]]
Vector = Float[Array, " xyz"]


def velocity_at(velocity: Vector, omega: Vector, position: Vector) -> Vector:
    """Return the velocity of a point of the body, `v + omega x l`.

    Args:
        velocity: velocity of the c.g., over ground or relative to the air, body axes [m/s].
        omega: angular rate [rad/s].
        position: l, from the c.g. to the point [m].
    """
    return velocity + jnp.cross(omega, position)


def specific_force_at(force: Vector, omega: Vector, omegadot: Vector, position: Vector) -> Vector:
    """Return the specific force at a point of the body, `f + omegadot x l + omega x (omega x l)`
    (D.2.7.2, D.2.7.6).

    Args:
        force: f, specific force at the c.g., body axes [m/s^2].
        omega: angular rate [rad/s].
        omegadot: angular acceleration [rad/s^2].
        position: l, from the c.g. [m].
    """
    return force + jnp.cross(omegadot, position) + jnp.cross(omega, jnp.cross(omega, position))


def sensitive_axis(name: str, angles: Float[Array, " angle"]) -> Vector:
    """Return the unit vector along which a misaligned instrument measures: a row of the matrix of
    its Euler angles (D.2.2.1, D.2.7).

        x (psi, theta): (cos theta cos psi,  cos theta sin psi,  -sin theta)  ->  (1, psi, -theta)
        y (psi, phi):   (-cos phi sin psi,   cos phi cos psi,     sin phi)    ->  (-psi, 1, phi)
        z (theta, phi): (cos phi sin theta,  -sin phi,   cos phi cos theta)   ->  (theta, -phi, 1)

    The approximations for small angles on the right are the report's, except for the sign of phi in
    the pitch gyro of D.2.2.1 and the pitch accelerometer of D.2.3.1: the report prints `q - r phi`,
    while a rotation, and the report's lateral accelerometer (D.2.7.4), give `+`.

    Args:
        name: "x", "y" or "z".
        angles: its two misalignment angles, in the order above [rad].
    """
    (c1, c2), (s1, s2) = jnp.cos(angles), jnp.sin(angles)
    if name == "x":
        return jnp.stack([c2 * c1, c2 * s1, -s2])
    if name == "y":
        return jnp.stack([-c2 * s1, c2 * c1, s2])
    return jnp.stack([c2 * s1, -s2, c2 * c1])


def vane_alpha(signals: Signals, position: Vector) -> Float[Array, ""]:
    """Return the angle of attack of a vane, `atan2(w_l, u_l)` of the velocity at its position
    relative to the air (D.2.5.1) [rad].
    """
    u, _, w = velocity_at(vector(signals, FLOW), vector(signals, RATES), position)
    return jnp.arctan2(w, u)


def vane_beta(signals: Signals, position: Vector) -> Float[Array, ""]:
    """Return the flank angle of a vane of sideslip, `atan2(v_l, u_l)` (D.2.6.1) [rad].

    A vane hinged about the z axis measures this flank angle, with the tangent
    `tan(beta)/cos(alpha)` of the sideslip `beta = asin(v/V)`, even at the c.g.; `corrected_angles`
    converts it to the sideslip (D.2.6.2).
    """
    u, v, _ = velocity_at(vector(signals, FLOW), vector(signals, RATES), position)
    return jnp.arctan2(v, u)


def ideal_reading(
    channel: str, signals: Signals, position: Vector, angles: Float[Array, " angle"]
) -> Float[Array, ""]:
    """Return the reading of one instrument without scale error and bias.

    Args:
        channel: name of the channel, one of `CHANNELS`.
        signals: the motion at this instant.
        position: position of the instrument, for channels that depend on it [m].
        angles: misalignment angles, for channels with an axis [rad].

    Returns:
        The reading, a scalar [the channel's unit].
    """
    if channel in ("alpha", "beta"):
        return (vane_alpha if channel == "alpha" else vane_beta)(signals, position)
    if channel == "V":
        return indicated_airspeed(signals["density"], signals["V"], signals["mach"])
    if channel in RATES:
        return sensitive_axis("xyz"[RATES.index(channel)], angles) @ vector(signals, RATES)
    if channel in ANGULAR:
        return sensitive_axis("xyz"[ANGULAR.index(channel)], angles) @ vector(signals, ANGULAR)
    if channel in (*FORCE, "az_pilot"):
        # All three components are taken at the position of this instrument; D.2.7.3 to D.2.7.5 of
        # the report take them at three different positions.
        force, omega, omegadot = (vector(signals, names) for names in (FORCE, RATES, ANGULAR))
        return sensitive_axis(channel[1], angles) @ specific_force_at(
            force, omega, omegadot, position
        )
    return signals[channel]


def vector(signals: Signals, names: tuple[str, ...]) -> Vector:
    """Return three signals as one vector."""
    return jnp.stack([signals[name] for name in names])
