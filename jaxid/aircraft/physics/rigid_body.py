"""Equations of motion of a rigid body (Newton and Euler)."""

import jax.numpy as jnp

from ..._foundation.types import Array, Float


def accelerations(
    mass: Float[Array, ""],
    inertia: Float[Array, "3 3"],
    velocity: Float[Array, "3"],
    omega: Float[Array, "3"],
    force: Float[Array, "3"],
    moment: Float[Array, "3"],
    momentum: Float[Array, "3"],
) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Rates of the velocity and of the angular rate, in body axes about the centre of gravity (App.
    D.1.1, D.1.2).

        vdot = F/m - omega x v,        I omegadot = M - omega x (I omega + h)

    The inertia tensor is full, so that all products of inertia act; the report prints its inverse
    element by element.

    Args:
        mass: m [kg].
        inertia: I [kg m^2].
        velocity: of the centre of gravity over ground [m/s].
        omega: angular rate (p, q, r) [rad/s].
        force: F, weight included [N].
        moment: M about the centre of gravity [N m].
        momentum: h, of the engines' rotors, constant in body axes [kg m^2/s].

    Returns:
        (udot, vdot, wdot) [m/s^2] and (pdot, qdot, rdot) [rad/s^2].
    """
    turning = jnp.cross(omega, inertia @ omega + momentum)
    return force / mass - jnp.cross(omega, velocity), solve_3x3(inertia, moment - turning)


def solve_3x3(A: Float[Array, "3 3"], b: Float[Array, "3"]) -> Float[Array, "3"]:
    """Return `A^-1 b` by cofactors, which avoids a factorisation at each step of a simulation."""
    x, y, z = jnp.cross(A[1], A[2]), jnp.cross(A[2], A[0]), jnp.cross(A[0], A[1])
    return (b[0] * x + b[1] * y + b[2] * z) / jnp.dot(A[0], x)


def specific_force(
    vdot: Float[Array, "3"],
    velocity: Float[Array, "3"],
    omega: Float[Array, "3"],
    gravity: Float[Array, "3"],
) -> Float[Array, "3"]:
    """Return the specific force at the centre of gravity, from the rate of the velocity (D.2.7.1)
    [m/s^2].

        a = vdot + omega x v - g

    Args:
        vdot: rate of the body components of velocity [m/s^2].
        velocity: over ground, body axes [m/s].
        omega: angular rate [rad/s].
        gravity: in body axes [m/s^2].
    """
    return vdot + jnp.cross(omega, velocity) - gravity
