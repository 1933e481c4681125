"""Actuators: from a commanded to an actual surface position, with lag, rate limit and stops."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.types import Array, Float

Scalar = Float[Array, ""] | float


class AbstractActuator(eqx.Module):
    """An actuator; its first state is the position.

    Attributes:
        lower, upper: stops of the position [rad].
    """

    lower: eqx.AbstractVar[Float[Array, ""]]
    upper: eqx.AbstractVar[Float[Array, ""]]
    suffixes: eqx.AbstractClassVar[tuple[str, ...]]

    @abc.abstractmethod
    def rates(self, x: Float[Array, " state"], command: Float[Array, ""]) -> Float[Array, " state"]:
        """Return the rates of the states at a command [rad]."""

    def limited(self, command: Float[Array, ""]) -> Float[Array, ""]:
        """Return the command clipped to the stops, `lower <= delta <= upper` (D.1.5) [rad]."""
        return jnp.clip(command, self.lower, self.upper)

    def resting(self, position: Float[Array, ""]) -> Float[Array, " state"]:
        """Return the states of an actuator at rest at a position [rad]."""
        return jnp.zeros(len(self.suffixes)).at[0].set(self.limited(position))


class FirstOrder(AbstractActuator):
    """A first-order lag with a rate limit and stops.

        deltadot = clip((clip(command, lower, upper) - delta) / lag, -rate, rate)

    Args:
        lag: time constant [s].
        rate: greatest rate [rad/s].
        lower, upper: stops [rad].
    """

    lag: Float[Array, ""]
    rate: Float[Array, ""]
    lower: Float[Array, ""]
    upper: Float[Array, ""]

    suffixes: ClassVar[tuple[str, ...]] = ("",)

    def __init__(self, lag: Scalar, rate: Scalar, lower: Scalar, upper: Scalar):
        self.lag, self.rate = jnp.asarray(lag, float), jnp.asarray(rate, float)
        self.lower, self.upper = jnp.asarray(lower, float), jnp.asarray(upper, float)

    def rates(self, x: Float[Array, " state"], command: Float[Array, ""]) -> Float[Array, " state"]:
        return jnp.clip((self.limited(command) - x) / self.lag, -self.rate, self.rate)


class SecondOrder(AbstractActuator):
    """A second-order actuator with a rate limit and stops on its command.

        deltadot = clip(s, -rate, rate)
        sdot = w^2 (clip(command, lower, upper) - delta) - 2 z w s

    Args:
        frequency: w [rad/s].
        damping: z.
        rate: greatest rate [rad/s].
        lower, upper: stops [rad].
    """

    frequency: Float[Array, ""]
    damping: Float[Array, ""]
    rate: Float[Array, ""]
    lower: Float[Array, ""]
    upper: Float[Array, ""]

    suffixes: ClassVar[tuple[str, ...]] = ("", "_rate")

    def __init__(
        self, frequency: Scalar, damping: Scalar, rate: Scalar, lower: Scalar, upper: Scalar
    ):
        self.frequency, self.damping = jnp.asarray(frequency, float), jnp.asarray(damping, float)
        self.rate = jnp.asarray(rate, float)
        self.lower, self.upper = jnp.asarray(lower, float), jnp.asarray(upper, float)

    def rates(self, x: Float[Array, " state"], command: Float[Array, ""]) -> Float[Array, " state"]:
        position, speed = x
        pull = self.frequency**2 * (self.limited(command) - position)
        return jnp.stack(
            [
                jnp.clip(speed, -self.rate, self.rate),
                pull - 2 * self.damping * self.frequency * speed,
            ]
        )
