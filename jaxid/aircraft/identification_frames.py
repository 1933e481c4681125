"""Two ways to write translation: body components of velocity (E.1 to E.3), or speed and air angles (Tables E.1, E.2)."""

from collections.abc import Callable, Collection, Mapping
from typing import NamedTuple

import jax.numpy as jnp

from .._foundation.types import Array, Float
from .frames import air_angles, velocity
from .instrument_channels import RATES

Three = Float[Array, "3"]


class Translation(NamedTuple):
    """A set of three states for the velocity of the centre of gravity.

    Attributes:
        names: of the states, in order.
        equation: by force coefficient, the state whose equation it dominates.
        moves: by force coefficient, the states whose rates it moves.
        velocity: body components [m/s] from the three states.
        states: the three states from body components [m/s].
        rates: of the three states, from velocity [m/s] and its rate in body axes [m/s^2]; linear in the latter.
        accelerations: the rate of the velocity [m/s^2], from velocity [m/s] and the rates of the three states.
    """

    names: tuple[str, str, str]
    equation: Mapping[str, str]
    moves: Mapping[str, tuple[str, ...]]
    velocity: Callable[[Three], Three]
    states: Callable[[Three], Three]
    rates: Callable[[Three, Three], Three]
    accelerations: Callable[[Three, Three], Three]

    def moved(self, coefficient: str, states: Collection[str]) -> tuple[str, ...]:
        """Those of some states whose rates a coefficient moves; a moment, the rates of all."""
        return tuple(state for state in (*self.moves.get(coefficient, ()), *RATES) if state in states)


def _air_axes(v: Three) -> tuple[Float[Array, "3 3"], Three]:
    """Unit vectors along which V, alpha and beta grow, row by row, and what turns their rates into accelerations [m/s]."""
    V, alpha, beta = air_angles(v)
    (ca, cb), (sa, sb) = (jnp.cos(alpha), jnp.cos(beta)), (jnp.sin(alpha), jnp.sin(beta))
    rows = [[ca * cb, sb, sa * cb], [-sa, jnp.zeros(()), ca], [-ca * sb, cb, -sa * sb]]
    return jnp.stack([jnp.stack(row) for row in rows]), jnp.stack([jnp.ones(()), V * cb, V])


def _air_rates(v: Three, vdot: Three) -> Three:
    """Vdot, alphadot, betadot by the chain rule: what Table E.1 prints garbled."""
    axes, arms = _air_axes(v)
    return axes @ vdot / arms


def _body_accelerations(v: Three, rates: Three) -> Three:
    """The same backwards, for accelerometers (Table E.2)."""
    axes, arms = _air_axes(v)
    return axes.T @ (arms * rates)


BODY = Translation(
    names=("u", "v", "w"),
    equation={"CX": "u", "CY": "v", "CZ": "w"},
    moves={"CX": ("u",), "CY": ("v",), "CZ": ("w",)},
    velocity=lambda states: states,
    states=lambda v: v,
    rates=lambda v, vdot: vdot,
    accelerations=lambda v, rates: rates,
)

AIR_PATH = Translation(
    names=("V", "alpha", "beta"),
    equation={"CX": "V", "CY": "beta", "CZ": "alpha"},
    moves={"CX": ("V", "alpha", "beta"), "CY": ("V", "beta"), "CZ": ("V", "alpha", "beta")},
    velocity=lambda states: velocity(*states),
    states=lambda v: jnp.stack(air_angles(v)),
    rates=_air_rates,
    accelerations=_body_accelerations,
)

FRAMES = {"body": BODY, "air path": AIR_PATH}
