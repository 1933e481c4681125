"""Engines: how much they push, where and in which direction, and how their rotors spin."""

import abc
from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from .._foundation.types import Array, Float

Signals = Mapping[str, Float[Array, ""]]


class AbstractThrust(eqx.Module):
    """How the push of one engine follows its setting.

    Attributes:
        states: its own states, names.
        inputs: what the pilot moves, names.
    """

    states: eqx.AbstractClassVar[tuple[str, ...]]
    inputs: eqx.AbstractClassVar[tuple[str, ...]]

    @abc.abstractmethod
    def thrust(self, x: Float[Array, " state"], signals: Signals) -> Float[Array, ""]:
        """The push [N], from its states and the air's `altitude` and `mach`."""

    @abc.abstractmethod
    def rates(
        self, x: Float[Array, " state"], lever: Float[Array, " input"], signals: Signals
    ) -> Float[Array, " state"]:
        """Rates of its states; the lever adds to the trim setting."""

    @abc.abstractmethod
    def trimmed(self, setting: Float[Array, ""]) -> "AbstractThrust":
        """The same with another setting in trim."""

    @abc.abstractmethod
    def resting(self) -> Float[Array, " state"]:
        """The states at which its trim setting holds it."""


class ConstantThrust(AbstractThrust):
    """A push that does not change over a manoeuvre, as in the report's test cases; its setting is the push itself.

    Args:
        force: [N].
    """

    force: Float[Array, ""]

    states: ClassVar[tuple[str, ...]] = ()
    inputs: ClassVar[tuple[str, ...]] = ()

    def __init__(self, force: Float[Array, ""] | float):
        self.force = jnp.asarray(force, float)

    def thrust(self, x: Float[Array, " state"], signals: Signals) -> Float[Array, ""]:
        return self.force

    def rates(
        self, x: Float[Array, " state"], lever: Float[Array, " input"], signals: Signals
    ) -> Float[Array, " state"]:
        return jnp.zeros(0)

    def trimmed(self, setting: Float[Array, ""]) -> "ConstantThrust":
        return ConstantThrust(setting)

    def resting(self) -> Float[Array, " state"]:
        return jnp.zeros(0)


class Engine(eqx.Module):
    """One engine in its place: the force and moment that it puts on the aircraft, and its angular momentum.

        F = T d,    M = r x F,    h = H d,    d = (cos e cos t, cos e sin t, -sin e)

    Args:
        source: how its push follows its setting.
        position: r, a point of the line of action from the centre of gravity, body axes [m].
        up, right: e and t, by how much the line of action is tilted up and to the right [rad].
        momentum: H, of the rotors along the line of action [kg m^2/s].
        share: factor on the push, for asymmetric thrust.
    """

    source: AbstractThrust
    position: Float[Array, "3"]
    up: Float[Array, ""]
    right: Float[Array, ""]
    momentum: Float[Array, ""]
    share: Float[Array, ""]

    def __init__(
        self,
        source: AbstractThrust,
        *,
        position: Float[Array, "3"] | Sequence[float] = (0.0, 0.0, 0.0),
        up: Float[Array, ""] | float = 0.0,
        right: Float[Array, ""] | float = 0.0,
        momentum: Float[Array, ""] | float = 0.0,
        share: Float[Array, ""] | float = 1.0,
    ):
        self.source, self.position = source, jnp.asarray(position, float)
        self.up, self.right = jnp.asarray(up, float), jnp.asarray(right, float)
        self.momentum, self.share = jnp.asarray(momentum, float), jnp.asarray(share, float)

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        return {"position": ("position.x", "position.y", "position.z")}

    def direction(self) -> Float[Array, "3"]:
        """The unit vector of the line of action, forward."""
        level = jnp.cos(self.up)
        return jnp.stack([level * jnp.cos(self.right), level * jnp.sin(self.right), -jnp.sin(self.up)])

    def thrust(self, x: Float[Array, " state"], signals: Signals) -> Float[Array, ""]:
        """The push of the engine [N]."""
        return self.share * self.source.thrust(x, signals)


def loads(
    engines: Sequence[Engine], pushes: Sequence[Float[Array, ""]]
) -> tuple[Float[Array, "3"], Float[Array, "3"], Float[Array, "3"]]:
    """Force, moment about the centre of gravity and angular momentum of all engines.

        F = sum T d,    M = sum r x T d,    h = sum H d

    Args:
        engines: in their places.
        pushes: T, one for each engine [N].

    Returns:
        Force [N], moment [N m], momentum [kg m^2/s], body axes.
    """
    force, moment, momentum = jnp.zeros(3), jnp.zeros(3), jnp.zeros(3)
    for engine, push in zip(engines, pushes, strict=True):
        along = push * engine.direction()
        force, moment = force + along, moment + jnp.cross(engine.position, along)
        momentum = momentum + engine.momentum * engine.direction()
    return force, moment, momentum
