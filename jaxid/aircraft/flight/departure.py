"""Departure criteria: static derivatives that predict the angle of attack of a departure."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..._foundation.types import Array, Float
from ..vehicle.aerodynamics import COEFFICIENTS
from ..vehicle.airframe import Airframe

AT_REST = ("beta", "stabilator", "aileron", "rudder", "phat", "qhat", "rhat")


class DepartureCriteria(NamedTuple):
    """Derivatives at one or more angles of attack [1/rad].

    Attributes:
        Cm_alpha: static pitch stability; positive where the aircraft pitches up.
        Cl_beta: dihedral effect.
        Cn_beta: directional stability, body axes.
        Cn_beta_dyn: dynamic directional stability; negative where the aircraft departs in yaw.
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
    r"""Return derivatives of pitch and directional stability at zero sideslip and rates.

        Cn_beta_dyn = Cn_beta cos(alpha) - Iz/Ix Cl_beta sin(alpha)

    If Cn_beta_dyn is positive, sideslip oscillates at about `sqrt(qbar S b Cn_beta_dyn / Iz)`
    [rad/s]; if it is negative, sideslip grows at about `sqrt(-qbar S b Cn_beta_dyn / Iz)` [1/s].
    Products of inertia and rates are neglected.

    Args:
        airframe: airframe with the tables or polynomials to differentiate.
        alpha: angles of attack, of any shape [rad].
        signals: further signals of the aerodynamics, such as `stabilator` [rad], or `qbar` and
            `pressure` [Pa] for a scheduled flap; surfaces and rates are zero by default.

    Source: J. R. Chambers, E. L. Anglin, `Analysis of lateral-directional stability characteristics
    of a twin-jet fighter airplane at high angles of attack`, NASA TN D-5361, 1969.
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
