"""Engines: thrust, line of action and angular momentum of the rotors."""

import abc
from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.types import Array, Float

Signals = Mapping[str, Float[Array, ""]]


class AbstractThrust(eqx.Module):
    """Thrust of one engine as a function of its setting.

    Attributes:
        states: names of its states.
        inputs: names of the pilot's inputs.
    """

    states: eqx.AbstractClassVar[tuple[str, ...]]
    inputs: eqx.AbstractClassVar[tuple[str, ...]]

    @abc.abstractmethod
    def thrust(self, x: Float[Array, " state"], signals: Signals) -> Float[Array, ""]:
        """Return the thrust [N], from the states and the signals `altitude` and `mach`."""

    @abc.abstractmethod
    def rates(
        self, x: Float[Array, " state"], lever: Float[Array, " input"], signals: Signals
    ) -> Float[Array, " state"]:
        """Return the rates of the states; the lever is added to the trim setting."""

    @abc.abstractmethod
    def trimmed(self, setting: Float[Array, ""]) -> "AbstractThrust":
        """Return the same engine with another setting in trim."""

    @abc.abstractmethod
    def resting(self) -> Float[Array, " state"]:
        """Return the steady states at the trim setting."""


class ConstantThrust(AbstractThrust):
    """A constant thrust, as in the report's test cases; its setting is the thrust itself.

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
    """One engine: its force and moment on the aircraft, and its angular momentum.

        F = T d,    M = r x F,    h = H d,    d = (cos e cos t, cos e sin t, -sin e)

    Args:
        source: thrust as a function of the setting.
        position: r, a point of the line of action from the centre of gravity, body axes [m].
        up, right: e and t, tilt of the line of action upwards and to the right [rad].
        momentum: H, of the rotors along the line of action [kg m^2/s].
        share: factor on the thrust, for asymmetric thrust.
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
        """Return the unit vector of the line of action, forward."""
        level = jnp.cos(self.up)
        return jnp.stack(
            [level * jnp.cos(self.right), level * jnp.sin(self.right), -jnp.sin(self.up)]
        )

    def thrust(self, x: Float[Array, " state"], signals: Signals) -> Float[Array, ""]:
        """Return the thrust of the engine [N]."""
        return self.share * self.source.thrust(x, signals)


class EngineLoads(NamedTuple):
    """Sum of the loads of all engines, body axes.

    Attributes:
        force: [N].
        moment: about the centre of gravity [N m].
        momentum: angular momentum of the rotors [kg m^2/s].
    """

    force: Float[Array, "3"]
    moment: Float[Array, "3"]
    momentum: Float[Array, "3"]


def loads(engines: Sequence[Engine], pushes: Sequence[Float[Array, ""]]) -> EngineLoads:
    """Return force, moment about the centre of gravity and angular momentum of all engines.

        F = sum T d,    M = sum r x T d,    h = sum H d

    Args:
        engines: the engines.
        pushes: thrust T, one for each engine [N].

    Returns:
        Force [N], moment [N m], momentum [kg m^2/s], body axes.
    """
    force, moment, momentum = jnp.zeros(3), jnp.zeros(3), jnp.zeros(3)
    for engine, push in zip(engines, pushes, strict=True):
        along = push * engine.direction()
        force, moment = force + along, moment + jnp.cross(engine.position, along)
        momentum = momentum + engine.momentum * engine.direction()
    return EngineLoads(force, moment, momentum)
