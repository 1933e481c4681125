"""General effects of an actuator: rate and position limits, dead zone, hysteresis.

The actuator is between the recorded input and the plant.
"""

import abc
from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.location import Location, LocationKind
from .._foundation.types import Array, Float
from .base import Effect, zero
from .card import EffectCard
from .dynamics import UNSET_WIDTH
from .input import CommonInputEffect, InputEffect
from .rate_hysteresis import BoucWen, RateLimited
from .shape_initialisation import centre_of, level_in, max_deviation, rates_in

# chosen above any input rate in SI units: no limiting until `initialise_shape` sets the limit
NO_LIMIT_YET = 1e6


class ActuatorShape(InputEffect):
    """Actuator that maps the value of one input: `u -> u + gain (changed(u) - u)`.

    The full effect has a gain of one.
    """

    @abc.abstractmethod
    def changed(self, u: Float[Array, ""]) -> Float[Array, ""]:
        """Return the output of the actuator for a value of its input."""

    def input(self, u, extra, inputs):
        index = inputs.index(self.channel)
        return u.at[index].add(self.gain * (self.changed(u[index]) - u[index]))


class AbstractRateLimit(Effect):
    """One rate limit of the actuators of one or several inputs.

    Attributes:
        channels: names of the inputs.
        fraction: initial limit, as a fraction of the largest rate in the training records.
        gain: share of the limited path, one for a limit [1].
        limit: largest rate [unit of the inputs/s].
    """

    channels: eqx.AbstractVar[tuple[str, ...]]
    fraction: eqx.AbstractVar[float]
    gain: eqx.AbstractVar[Float[Array, ""]]
    limit: eqx.AbstractVar[Float[Array, ""]]

    def initialise_shape(self, signals, measured, step):
        largest = max(np.max(np.abs(rates_in(signals[n], signals))) for n in self.channels)
        limit = self.fraction * largest if largest > 0 else NO_LIMIT_YET
        return eqx.tree_at(lambda effect: effect.limit, self, jnp.asarray(limit))

    def input_signal(self, path, inputs):
        for channel in self.channels:
            path = path.followed(inputs.index(channel), RateLimited(self.limit), self.gain)
        return path


class InputRateLimit(InputEffect, AbstractRateLimit):
    """Rate limit of an actuator: `u -> u + gain (r - u)`.

        |dr/dt| <= limit,    r as near to u as the limit allows

    The full effect has a gain of one. The limit acts on the input's samples, before the effects
    that act on its values: r is exact at the samples for a piecewise linear input, and between them
    has the input's interpolation. The actuator starts in equilibrium with the record's first input.

    Args:
        channel: name of the input.
        fraction: initial limit, as a fraction of the largest rate in the training records.
        limit: largest rate [unit of the input/s].
    """

    channel: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.2)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    limit: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(NO_LIMIT_YET))

    @property
    def card(self):
        family = f"rate limit of input {self.channel}"
        return EffectCard(
            name=f"{family} (from {self.fraction:.0%})",
            description=f"the actuator of {self.channel} has a rate limit",
            location=Location(LocationKind.INPUT, self.channel),
            family=family,
            complexity=2,
            bounds={"limit": (0.0, float("inf"))},
            unit_gain=True,
        )


class CommonInputRateLimit(CommonInputEffect, AbstractRateLimit):
    """One rate limit of several actuators: `u_i -> u_i + gain (r_i - u_i)`.

        |dr_i/dt| <= limit,    r_i as near to u_i as the limit allows

    Each input is limited as by `InputRateLimit`.

    Args:
        channels: names of the inputs.
        unit: their unit.
        fraction: initial limit, as a fraction of the largest rate of an input in the training
            records.
        gain: share of the limited path, one for a limit [1].
        limit: largest rate [unit of the inputs/s].
    """

    channels: tuple[str, ...] = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.2)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    limit: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(NO_LIMIT_YET))

    @property
    def card(self):
        family = f"rate limit of {self.display_name}"
        return EffectCard(
            name=f"{family} (from {self.fraction:.0%})",
            description=f"a rate limit is the same in {self.display_name}",
            location=Location(LocationKind.MODEL, ""),
            family=family,
            complexity=2,
            bounds={"limit": (0.0, float("inf"))},
            unit_gain=True,
        )


class InputHysteresis(InputEffect):
    """Hysteresis between the recorded input and the plant: `u -> u - gain z`.

        width dz/dt = du/dt - (|du/dt| |z| z + du/dt z^2) / 2

    Examples are cables, gears and piezoelectric drives. A gain equal to the width is play: after a
    reversal the output is constant at first. The effect acts on the input's samples, before the
    effects that act on its values. For a piecewise linear input z is exact at the quarters of each
    sample interval, and linear between them. The effect adds no state. z starts at zero.

    Args:
        channel: name of the input.
        fraction: initial width, as a fraction of the input's largest deviation from its centre.
        gain: half the width of the loop, measured along the input; positive if the output lags
            [unit of the input].
        width: input change over which z reverses [unit of the input].

    Source: Wen, J. Eng. Mech. Div. ASCE 102 (1976), pp. 249-263, in the form of `Hysteresis`.
    """

    channel: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.2)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    width: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(UNSET_WIDTH))

    @property
    def card(self):
        return EffectCard(
            name=f"hysteresis of input {self.channel}",
            description=f"the actuator of {self.channel} has hysteresis",
            location=Location(LocationKind.INPUT, self.channel),
            complexity=2,
            bounds={"width": (1e-9, float("inf"))},
        )

    def initialise_shape(self, signals, measured, step):
        width = self.fraction * max_deviation(signals[self.channel])
        return eqx.tree_at(lambda effect: effect.width, self, jnp.asarray(width))

    def input_signal(self, path, inputs):
        return path.followed(inputs.index(self.channel), BoucWen(self.width), self.gain)


class InputPositionLimit(ActuatorShape):
    """Position limit of an actuator.

        changed = min(u, level)    at the upper end
        changed = max(u, level)    at the lower end

    Args:
        channel: name of the input.
        end: which end of the range.
        fraction: initial level, as a fraction of the distance from the middle of the input's range
            to its end.
        level: the limit [unit of the input].
    """

    channel: str = eqx.field(static=True)
    end: Literal["upper", "lower"] = eqx.field(static=True, default="upper")
    fraction: float = eqx.field(static=True, default=0.6)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    level: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        end = "an upper" if self.end == "upper" else "a lower"
        return EffectCard(
            name=f"{self.end} limit of input {self.channel}",
            description=f"the actuator of {self.channel} stops at {end} level",
            location=Location(LocationKind.INPUT, self.channel),
            complexity=2,
            unit_gain=True,
        )

    def initialise_shape(self, signals, measured, step):
        away = 0.5 * self.fraction if self.end == "upper" else -0.5 * self.fraction
        return eqx.tree_at(
            lambda effect: effect.level, self, level_in(signals[self.channel], 0.5 + away)
        )

    def changed(self, u):
        return jnp.minimum(u, self.level) if self.end == "upper" else jnp.maximum(u, self.level)


class InputDeadZone(ActuatorShape):
    """Dead zone of an actuator about its centre: small inputs have no effect.

        changed = u - clip(u - centre, -width, width)

    The centre is not estimated: zero if zero lies between the input's quartiles, else its median.

    Args:
        channel: name of the input.
        fraction: initial width, as a fraction of the input's largest deviation from its centre.
        width: half the width of the zone [unit of the input].
        centre: its middle [unit of the input].
    """

    channel: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.2)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    width: Float[Array, ""] = eqx.field(default_factory=zero)
    centre: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        return EffectCard(
            name=f"dead zone of input {self.channel}",
            description=f"the actuator of {self.channel} has a dead zone",
            location=Location(LocationKind.INPUT, self.channel),
            complexity=2,
            bounds={"width": (0.0, float("inf"))},
            unit_gain=True,
            fixed=("centre",),
        )

    def initialise_shape(self, signals, measured, step):
        signal = signals[self.channel]
        shape = jnp.asarray(self.fraction * max_deviation(signal)), centre_of(signal)
        return eqx.tree_at(lambda effect: (effect.width, effect.centre), self, shape)

    def changed(self, u):
        return u - jnp.clip(u - self.centre, -self.width, self.width)
