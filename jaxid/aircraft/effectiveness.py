"""By how much the accelerations of a body grow with each aerodynamic coefficient."""

import jax
import jax.numpy as jnp

from .._foundation.types import Array, Float
from .airframe import Airframe
from .rigid_body import solve_3x3

MOVED = {  # the states whose rates a coefficient moves
    **{"CX": ("u", "p", "q", "r"), "CY": ("v", "p", "q", "r"), "CZ": ("w", "p", "q", "r")},
    **dict.fromkeys(("Cl", "Cm", "Cn"), ("p", "q", "r")),
}


def effectiveness(
    airframe: Airframe, qbar: Float[Array, ""], inertia: Float[Array, "3 3"]
) -> Float[Array, "coefficient motion"]:
    """The derivative of `udot vdot wdot pdot qdot rdot` by CX to Cn, inertial coupling and the reference point included.

        d(vdot)/dC = qbar S/m,    d(omegadot)/dC = qbar S I^-1 (reference x e, or b, cbar, b)

    Args:
        airframe: mass and size.
        qbar: dynamic pressure [Pa].
        inertia: I, or what stands in its place where some rates are given [kg m^2].

    Returns:
        One row for each coefficient, one column for each component of motion [m/s^2, rad/s^2].
    """
    arms = jnp.cross(airframe.reference[None], jnp.eye(3))  # of unit forces, row by row
    moments = jnp.concatenate([arms, jnp.diag(airframe.lengths)])
    turned = jax.vmap(lambda moment: solve_3x3(inertia, moment))(moments)
    return qbar * airframe.S * jnp.concatenate([jnp.eye(6, 3) / airframe.mass_properties.mass, turned], axis=1)
