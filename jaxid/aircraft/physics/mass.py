"""Mass and inertia of a rigid aircraft."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..._foundation.traced_checks import require_value
from ..._foundation.types import Array, Float


class MassProperties(eqx.Module):
    """Mass, moments and products of inertia about the centre of gravity, in body axes.

    Products are the positive integrals, `Ixz = integral of x z dm`.

    Args:
        mass: m [kg].
        Ix, Iy, Iz: moments of inertia [kg m^2].
        Ixy, Ixz, Iyz: products of inertia [kg m^2].

    Raises:
        InputError: when mass is not positive, or a moment of inertia exceeds the sum of the two
            others, which no body allows.
    """

    mass: Float[Array, ""]
    Ix: Float[Array, ""]
    Iy: Float[Array, ""]
    Iz: Float[Array, ""]
    Ixy: Float[Array, ""]
    Ixz: Float[Array, ""]
    Iyz: Float[Array, ""]

    def __init__(self, *, mass, Ix, Iy, Iz, Ixy=0.0, Ixz=0.0, Iyz=0.0):
        self.mass = jnp.asarray(mass, float)
        self.Ix, self.Iy, self.Iz = (
            jnp.asarray(Ix, float),
            jnp.asarray(Iy, float),
            jnp.asarray(Iz, float),
        )
        self.Ixy, self.Ixz, self.Iyz = (
            jnp.asarray(Ixy, float),
            jnp.asarray(Ixz, float),
            jnp.asarray(Iyz, float),
        )
        require_value(self.mass, lambda mass: mass > 0, "The mass is {} kg. Give a positive one.")
        moments = jnp.stack([self.Ix, self.Iy, self.Iz])
        require_value(
            moments,
            lambda moment: (moment > 0) & (2.0 * moment <= np.sum(moment)),
            "The moments of inertia are {} kg m^2: in a body each is positive and at most the sum "
            "of the two others. "
            "Check their order and their unit.",
        )

    def inertia(self) -> Float[Array, "3 3"]:
        """The inertia tensor, `[[Ix, -Ixy, -Ixz], [-Ixy, Iy, -Iyz], [-Ixz, -Iyz, Iz]]` [kg m^2]."""
        return jnp.stack(
            [
                jnp.stack([self.Ix, -self.Ixy, -self.Ixz]),
                jnp.stack([-self.Ixy, self.Iy, -self.Iyz]),
                jnp.stack([-self.Ixz, -self.Iyz, self.Iz]),
            ]
        )
