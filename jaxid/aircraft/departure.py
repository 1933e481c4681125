"""Static derivatives that tell, without a flight, at which angle of attack an aircraft departs."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp

from .._foundation.types import Array, Float
from .aerodynamics import COEFFICIENTS
from .airframe import Airframe

AT_REST = ("beta", "stabilator", "aileron", "rudder", "phat", "qhat", "rhat")


class DepartureCriteria(NamedTuple):
    """Derivatives at one angle of attack or at several [1/rad].

    Attributes:
        Cm_alpha: positive where the aircraft pitches up by itself.
        Cl_beta: dihedral effect.
        Cn_beta: directional stability, body axes.
        Cn_beta_dyn: what of both turns the velocity back into the plane of symmetry; negative: it departs in yaw.
    """

    Cm_alpha: Float[Array, "*point"]
    Cl_beta: Float[Array, "*point"]
    Cn_beta: Float[Array, "*point"]
    Cn_beta_dyn: Float[Array, "*point"]


def departure_criteria(
    airframe: Airframe,
    alpha: Float[Array, "*point"],
    signals: Mapping[str, Float[Array, ""]] | None = None,
) -> DepartureCriteria:
    r"""Pitch-up, directional stability, and dynamic directional stability without sideslip and rotation.

        Cn_beta_dyn = Cn_beta cos(alpha) - Iz/Ix Cl_beta sin(alpha)

    Where it is positive, sideslip swings at about `sqrt(qbar S b Cn_beta_dyn / Iz)` [rad/s]; where it is negative, sideslip
    grows at about `sqrt(-qbar S b Cn_beta_dyn / Iz)` [1/s]. Products of inertia and rates are left out.

    Args:
        airframe: whose tables or polynomials are differentiated.
        alpha: angles of attack, of any shape [rad].
        signals: what else the aerodynamics ask for, such as `stabilator` [rad], or `qbar` and `pressure` [Pa] for a
            scheduled flap; surfaces and rates are zero where they are not given.

    Source: J. R. Chambers, E. L. Anglin, Analysis of lateral-directional stability characteristics of a twin-jet fighter
    airplane at high angles of attack, NASA TN D-5361, 1969.
    """
    still = dict.fromkeys(AT_REST, jnp.zeros(())) | dict(signals or {})
    coefficients = airframe.aerodynamics.coefficients

    def at(angles):
        return coefficients(still | {"alpha": angles[0], "beta": still["beta"] + angles[1]})

    flat = jnp.ravel(alpha)
    slopes = jax.vmap(jax.jacfwd(at))(jnp.stack([flat, jnp.zeros_like(flat)], axis=-1))
    row = {name: slopes[:, k].reshape((*alpha.shape, 2)) for k, name in enumerate(COEFFICIENTS)}
    Cl_beta, Cn_beta = row["Cl"][..., 1], row["Cn"][..., 1]
    ratio = airframe.mass_properties.Iz / airframe.mass_properties.Ix
    dynamic = Cn_beta * jnp.cos(alpha) - ratio * Cl_beta * jnp.sin(alpha)
    return DepartureCriteria(row["Cm"][..., 0], Cl_beta, Cn_beta, dynamic)
