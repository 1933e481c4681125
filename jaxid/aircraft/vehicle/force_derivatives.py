"""Derivatives of the accelerations of a body by each aerodynamic coefficient."""

import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.types import Array, Bool, Float
from ..physics.rigid_body import solve_3x3
from .airframe import Airframe

AFFECTED_STATES = {  # states with a rate that depends on the coefficient
    **{"CX": ("u", "p", "q", "r"), "CY": ("v", "p", "q", "r"), "CZ": ("w", "p", "q", "r")},
    **dict.fromkeys(("Cl", "Cm", "Cn"), ("p", "q", "r")),
}


def effectiveness(
    airframe: Airframe,
    qbar: Float[Array, ""],
    inertia: Float[Array, "3 3"],
    turns: Bool[np.ndarray, "3"] | None = None,
) -> Float[Array, "coefficient motion"]:
    """Return the derivative of `udot vdot wdot pdot qdot rdot` by CX to Cn, with inertial coupling
    and the position of the reference point.

        d(vdot)/dC = qbar S/m,    d(omegadot)/dC = qbar S I^-1 (reference x e, or b, cbar, b)

    Args:
        airframe: mass and size.
        qbar: dynamic pressure [Pa].
        inertia: I, with the row of a unit matrix for each rate that no moment changes [kg m^2].
        turns: mask of the rates that moments change; all by default.

    Returns:
        One row for each coefficient, one column for each component of motion [m/s^2, rad/s^2].
    """
    arms = jnp.cross(airframe.reference[None], jnp.eye(3))  # of unit forces, row by row
    moments = jnp.concatenate([arms, jnp.diag(airframe.lengths)])
    if turns is not None:
        moments = moments * jnp.asarray(turns, float)[None]
    turned = jax.vmap(lambda moment: solve_3x3(inertia, moment))(moments)
    return (
        qbar
        * airframe.S
        * jnp.concatenate([jnp.eye(6, 3) / airframe.mass_properties.mass, turned], axis=1)
    )
