"""Translation in two sets of states.

The states are body components of velocity (E.1 to E.3), or speed and air angles (Tables E.1, E.2).
"""

from collections.abc import Callable, Collection, Mapping
from typing import NamedTuple

import jax.numpy as jnp

from ..._foundation.types import Array, Float
from ..instruments.channels import RATES
from ..physics.frames import air_angles, velocity

Three = Float[Array, "3"]


class Translation(NamedTuple):
    """A set of three states for the velocity of the centre of gravity.

    Attributes:
        names: names of the states, in order.
        equation: state whose equation a force coefficient dominates, by coefficient.
        affected: states whose rates a force coefficient changes, by coefficient.
        velocity: function from the three states to body components [m/s].
        states: function from body components [m/s] to the three states.
        rates: function from velocity [m/s] and its rate in body axes [m/s^2] to the rates of the
            three states; linear in the latter.
        accelerations: function from velocity [m/s] and the rates of the three states to the rate of
            the velocity in body axes [m/s^2].
    """

    names: tuple[str, str, str]
    equation: Mapping[str, str]
    affected: Mapping[str, tuple[str, ...]]
    velocity: Callable[[Three], Three]
    states: Callable[[Three], Three]
    rates: Callable[[Three, Three], Three]
    accelerations: Callable[[Three, Three], Three]

    def affected_states(self, coefficient: str, states: Collection[str]) -> tuple[str, ...]:
        """Return the states whose rates a coefficient changes.

        Every coefficient changes the angular rates.

        Args:
            coefficient: "CX" to "Cn".
            states: states to select from.
        """
        return tuple(
            state for state in (*self.affected.get(coefficient, ()), *RATES) if state in states
        )


def _air_axes(v: Three) -> tuple[Float[Array, "3 3"], Three]:
    """Return the unit vectors of growing V, alpha and beta by row, and their lever arms.

    The rates of V, alpha and beta times the arms (1, V cos(beta), V) [m/s] are accelerations.
    """
    V, alpha, beta = air_angles(v)
    (ca, cb), (sa, sb) = (jnp.cos(alpha), jnp.cos(beta)), (jnp.sin(alpha), jnp.sin(beta))
    rows = [[ca * cb, sb, sa * cb], [-sa, jnp.zeros(()), ca], [-ca * sb, cb, -sa * sb]]
    return jnp.stack([jnp.stack(row) for row in rows]), jnp.stack([jnp.ones(()), V * cb, V])


def _air_rates(v: Three, vdot: Three) -> Three:
    """Return Vdot, alphadot, betadot by the chain rule (Table E.1, whose print is corrupt)."""
    axes, arms = _air_axes(v)
    return axes @ vdot / arms


def _body_accelerations(v: Three, rates: Three) -> Three:
    """Return the rate of the velocity in body axes, the inverse of `_air_rates` (Table E.2)."""
    axes, arms = _air_axes(v)
    return axes.T @ (arms * rates)


BODY = Translation(
    names=("u", "v", "w"),
    equation={"CX": "u", "CY": "v", "CZ": "w"},
    affected={"CX": ("u",), "CY": ("v",), "CZ": ("w",)},
    velocity=lambda states: states,
    states=lambda v: v,
    rates=lambda v, vdot: vdot,
    accelerations=lambda v, rates: rates,
)

AIR_PATH = Translation(
    names=("V", "alpha", "beta"),
    equation={"CX": "V", "CY": "beta", "CZ": "alpha"},
    affected={"CX": ("V", "alpha", "beta"), "CY": ("V", "beta"), "CZ": ("V", "alpha", "beta")},
    velocity=lambda states: velocity(*states),
    states=lambda v: jnp.stack(air_angles(v)),
    rates=_air_rates,
    accelerations=_body_accelerations,
)

FRAMES = {"body": BODY, "air path": AIR_PATH}
