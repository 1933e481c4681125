"""Axes and attitude: earth axes (north, east, down), body axes (forward, right, down), and the unit
quaternion between.

The quaternion turns earth axes into body axes. It has no singularity, where Euler angles have one
at a pitch of 90 deg. Source: B. L. Stevens, F. L. Lewis, Aircraft Control and Simulation, 2nd ed.,
Wiley 2003, section 1.2.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ..._foundation.types import Array, Float

Scalar = Float[Array, ""] | float | int
# Levi-Civita's symbol: (CROSS @ v) @ w = w x v
CROSS = np.cross(np.eye(3)[:, None], np.eye(3)[None])


class EulerAngles(NamedTuple):
    """Attitude as three Euler angles [rad].

    Attributes:
        phi: bank angle.
        pitch: pitch angle.
        psi: heading.
    """

    phi: Float[Array, ""]
    pitch: Float[Array, ""]
    psi: Float[Array, ""]


class EulerRates(NamedTuple):
    """Time derivatives of the Euler angles [rad/s].

    Attributes:
        phidot: rate of the bank angle.
        pitchdot: rate of the pitch angle.
        psidot: rate of the heading.
    """

    phidot: Float[Array, ""]
    pitchdot: Float[Array, ""]
    psidot: Float[Array, ""]


class AirAngles(NamedTuple):
    """Velocity relative to the air in polar form.

    Attributes:
        V: speed [m/s].
        alpha: angle of attack [rad].
        beta: angle of sideslip [rad].
    """

    V: Float[Array, ""]
    alpha: Float[Array, ""]
    beta: Float[Array, ""]


def quaternion(phi: Scalar, pitch: Scalar, psi: Scalar) -> Float[Array, "4"]:
    """Return the quaternion of three Euler angles, turned in the order psi, pitch, phi.

        e = (c c c + s s s,  s c c - c s s,  c s c + s c s,  c c s - s s c)

    with c and s the cosines and sines of phi/2, pitch/2, psi/2, in this order.

    Args:
        phi, pitch, psi: bank, pitch and heading [rad].

    Returns:
        The unit quaternion (e0, e1, e2, e3).
    """
    half = 0.5 * jnp.stack([jnp.asarray(angle, float) for angle in (phi, pitch, psi)])
    (cf, ct, cp), (sf, st, sp) = jnp.cos(half), jnp.sin(half)
    return jnp.stack(
        [
            cf * ct * cp + sf * st * sp,
            sf * ct * cp - cf * st * sp,
            cf * st * cp + sf * ct * sp,
            cf * ct * sp - sf * st * cp,
        ]
    )


def rotation(e: Float[Array, "4"]) -> Float[Array, "3 3"]:
    """The matrix that turns a vector's earth components into its body components, `v_body = T
    v_earth`.

    The quaternion is normalised, so that the matrix is a rotation after a small change of any
    element. The third column is the direction of gravity, `(-sin pitch, sin phi cos pitch,
    cos phi cos pitch)` (App. D.1.1).

    Args:
        e: quaternion, of any length but zero.
    """
    e0, v = e[0], e[1:]
    T = (e0**2 - jnp.dot(v, v)) * jnp.eye(3) + 2.0 * (jnp.outer(v, v) + e0 * (CROSS @ v))
    return T / jnp.dot(e, e)


def euler(e: Float[Array, "4"]) -> EulerAngles:
    """Return bank, pitch and heading of an attitude [rad], as `euler_of(rotation(e))`.

    Args:
        e: quaternion, of any length but zero.
    """
    return euler_of(rotation(e))


def euler_of(T: Float[Array, "3 3"]) -> EulerAngles:
    """Return bank, pitch and heading of a rotation [rad]; at a pitch of 90 deg bank and heading are
    not unique.

        phi = atan2(T23, T33),    pitch = atan2(-T13, sqrt(T11^2 + T12^2)),    psi = atan2(T12, T11)

    Args:
        T: rotation matrix from earth to body axes.
    """
    level = jnp.sqrt(T[0, 0] ** 2 + T[0, 1] ** 2)
    return EulerAngles(
        phi=jnp.arctan2(T[1, 2], T[2, 2]),
        pitch=jnp.arctan2(-T[0, 2], level),
        psi=jnp.arctan2(T[0, 1], T[0, 0]),
    )


def quaternion_rate(
    e: Float[Array, "4"], omega: Float[Array, "3"], restoring: float = 1.0
) -> Float[Array, "4"]:
    """Return the rate of the quaternion at a body rate, with a term that restores unit length.

        edot = 1/2 (-e1 p - e2 q - e3 r,  e0 p - e3 q + e2 r,  e3 p + e0 q - e1 r,  -e2 p + e1 q +
        e0 r) + k (1 - e'e) e

    The second term is zero in exact motion and corrects the drift of numerical integration.

    Args:
        e: quaternion.
        omega: angular rate (p, q, r) in body axes [rad/s].
        restoring: k [1/s].
    """
    e0, v = e[0], e[1:]
    turning = jnp.concatenate([-jnp.dot(v, omega)[None], e0 * omega - (CROSS @ v) @ omega])
    return 0.5 * turning + restoring * (1.0 - jnp.dot(e, e)) * e


def velocity(V: Scalar, alpha: Scalar, beta: Scalar) -> Float[Array, "3"]:
    """Body components of a velocity given by speed and air angles, `V (cos a cos b, sin b, sin a
    cos b)` (Eq. 2.1, 2.2).

    Args:
        V: speed [m/s].
        alpha, beta: angle of attack and of sideslip [rad].
    """
    V, alpha, beta = (jnp.asarray(value, float) for value in (V, alpha, beta))
    return V * jnp.stack(
        [jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)]
    )


def air_angles(v: Float[Array, "3"]) -> AirAngles:
    """Speed [m/s], angle of attack and of sideslip [rad] of a velocity in body axes (Eq. 2.1, 2.2).

        V = |v|,    alpha = atan2(w, u),    beta = atan2(v, sqrt(u^2 + w^2))

    The last equals `asin(v/V)` and keeps its derivative at 90 deg.

    Args:
        v: velocity relative to the air, body axes, not zero [m/s].
    """
    in_plane = jnp.sqrt(v[0] ** 2 + v[2] ** 2)
    return AirAngles(
        V=jnp.sqrt(jnp.dot(v, v)),
        alpha=jnp.arctan2(v[2], v[0]),
        beta=jnp.arctan2(v[1], in_plane),
    )


def air_angle_rates(
    v: Float[Array, "3"], vdot: Float[Array, "3"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Return the rates of the angles of attack and of sideslip [rad/s]: the derivatives of
    `air_angles` in closed form.

        alphadot = (u wdot - w udot)/(u^2 + w^2),    betadot = (vdot - v Vdot/V)/sqrt(u^2 + w^2)

    Args:
        v: velocity relative to the air, body axes, not along the y axis [m/s].
        vdot: its rate [m/s^2].
    """
    in_plane = v[0] ** 2 + v[2] ** 2
    along = jnp.dot(v, vdot) / jnp.dot(v, v)  # Vdot/V
    return (v[0] * vdot[2] - v[2] * vdot[0]) / in_plane, (vdot[1] - v[1] * along) / jnp.sqrt(
        in_plane
    )


def euler_rates(
    phi: Float[Array, ""], pitch: Float[Array, ""], omega: Float[Array, "3"]
) -> EulerRates:
    """Return the rates of bank, pitch and heading at a body rate (E.9 to E.11) [rad/s]; singular at
    a pitch of 90 deg.

        phidot = p + (q sin phi + r cos phi) tan(pitch),   pitchdot = q cos phi - r sin phi,
        psidot = (q sin phi + r cos phi)/cos(pitch)

    Args:
        phi, pitch: bank and pitch [rad].
        omega: angular rate (p, q, r) [rad/s].
    """
    p, q, r = omega
    turning = q * jnp.sin(phi) + r * jnp.cos(phi)
    return EulerRates(
        phidot=p + turning * jnp.tan(pitch),
        pitchdot=q * jnp.cos(phi) - r * jnp.sin(phi),
        psidot=turning / jnp.cos(pitch),
    )


def downwards(phi: Float[Array, ""], pitch: Float[Array, ""]) -> Float[Array, "3"]:
    """The direction of gravity in body axes, `(-sin pitch, sin phi cos pitch, cos phi cos pitch)`
    (App. D.1.1).

    Args:
        phi, pitch: bank and pitch [rad].
    """
    level = jnp.cos(pitch)
    return jnp.stack([-jnp.sin(pitch), jnp.sin(phi) * level, jnp.cos(phi) * level])
