"""General effects in the input: bias, scale, delay, intersample behaviour, actuator lag.

Inputs of one unit, such as the surfaces of an aircraft, may have the same actuator.
"""

import equinox as eqx
import jax.numpy as jnp

from .._foundation.checks import require
from .._foundation.grid import is_uniform_by_record
from .._foundation.location import Location, LocationKind
from .._foundation.types import Array, Float
from .base import Effect, is_negative, zero
from .card import EffectCard

# bounds of a blend gain, 1 +- 2 (chosen): a larger gain models the input's curvature instead
BLEND_BOUNDS = (-1.0, 3.0)
# [s], chosen longer than any record: the state is constant until `initialise_shape` sets its time
UNSET_TIME = 1e6
# stage of errors of the record: a lag commutes with them, and starts in equilibrium with the
# recorded input; levels and centres of other effects are in its unit
AFTER_RECORDED = 1


class InputEffect(Effect):
    """An effect on one input.

    Attributes:
        channel: name of the input.
    """

    channel: eqx.AbstractVar[str]

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the inputs on which it acts."""
        return (self.channel,)


class CommonInputEffect(Effect):
    """An effect that is the same on several inputs.

    Attributes:
        channels: names of the inputs.
        unit: their unit.
    """

    channels: eqx.AbstractVar[tuple[str, ...]]
    unit: eqx.AbstractVar[str]

    @property
    def display_name(self) -> str:
        """The inputs in words."""
        return f"all inputs in {self.unit}"


class InputBias(InputEffect):
    """Constant offset of the recorded input: `u -> u + gain`, gain [unit of u].

    It acts after lags, limits and dead zones, whose levels are levels of the recorded input.

    Args:
        channel: name of the input.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        return EffectCard(
            name=f"bias of input {self.channel}",
            description=f"the input {self.channel} is recorded with an offset",
            location=Location(LocationKind.INPUT, self.channel),
            signals=(self.channel,),
            stage=AFTER_RECORDED,
        )

    def input(self, u, extra, inputs):
        return u.at[inputs.index(self.channel)].add(self.gain)


class InputScale(InputEffect):
    """Scale error of the recorded input: `u -> (1 + gain) u`.

    It acts after lags, limits, dead zones and the bias, whose sizes are sizes of the recorded
    input.

    Args:
        channel: name of the input.
        gain: relative error of the scale [1].
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        return EffectCard(
            name=f"scale of input {self.channel}",
            description=f"the input {self.channel} is recorded with a scale error",
            location=Location(LocationKind.INPUT, self.channel),
            signals=(self.channel,),
            stage=AFTER_RECORDED,
        )

    def input(self, u, extra, inputs):
        return u.at[inputs.index(self.channel)].multiply(1.0 + self.gain)


class InputDelay(InputEffect):
    """Delay of the input relative to its record: `u(t) -> u(t - gain)`, gain [s].

    A negative gain means that the input acts earlier than recorded.

    Args:
        channel: name of the input.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        when = "earlier" if is_negative(self.gain) else "later"
        return EffectCard(
            name=f"delay of input {self.channel}",
            description=f"the input {self.channel} acts {when} than it is recorded",
            location=Location(LocationKind.INPUT, self.channel),
            signals=(self.channel,),
            delay="gain",
        )

    def input_signal(self, path, inputs):
        return path.delayed(inputs.index(self.channel), self.gain)


class InputBetweenSamples(InputEffect):
    """Band-limited intersample behaviour of the input, in place of the assumed hold.

        u(t) -> (1 - gain) u_assumed(t) + gain u_band-limited(t)

    The input is band-limited at a gain of one.

    Args:
        channel: name of the input.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        return EffectCard(
            name=f"{self.channel} between samples",
            description=f"the input {self.channel} is band-limited between its samples",
            location=Location(LocationKind.INPUT, self.channel),
            signals=(self.channel,),
            bounds={"gain": BLEND_BOUNDS},
            unit_gain=True,
        )

    def check(self, t):
        require(
            is_uniform_by_record(t),
            f"The effect {self.name!r} makes the input band-limited, which needs uniform sampling, "
            "and the sample times of a record are uneven. Leave the effect out.",
        )

    def input_signal(self, path, inputs):
        return path.blend_band_limited(inputs.index(self.channel), self.gain)


class AbstractLag(Effect):
    """First-order actuators with one time constant in one or several inputs.

    Attributes:
        channels: names of the inputs.
        gain: share of the lagged path, one for a lag [1].
        time: time constant [s].
    """

    channels: eqx.AbstractVar[tuple[str, ...]]
    gain: eqx.AbstractVar[Float[Array, ""]]
    time: eqx.AbstractVar[Float[Array, ""]]

    def initialise_shape(self, signals, measured, step):
        return eqx.tree_at(lambda effect: effect.time, self, 2.0 * jnp.asarray(step))

    @property
    def _pairs(self) -> tuple[tuple[str, str], ...]:
        """Pairs of the state of an actuator and its input."""
        return tuple(zip(self.extra_states, self.channels, strict=True))

    def input(self, u, extra, inputs):
        for lagged, channel in self._pairs:
            index = inputs.index(channel)
            u = u.at[index].add(self.gain * (extra[lagged] - u[index]))
        return u

    def initial_extra_states(self, record):
        return {lagged: record.channel(channel)[0] for lagged, channel in self._pairs}

    def extra_rates(self, extra, u, signals, rates):
        return {lagged: (u[channel] - extra[lagged]) / self.time for lagged, channel in self._pairs}


class InputLag(InputEffect, AbstractLag):
    """First-order actuator between the recorded input and the plant.

        d(lagged)/dt = (u - lagged) / time,    u -> u + gain (lagged - u)

    The full lag has a gain of one. The actuator starts in equilibrium with the record's first
    input.

    Args:
        channel: name of the input.
        time: time constant of the actuator [s].
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    time: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(UNSET_TIME))

    @property
    def card(self):
        return EffectCard(
            name=f"lag of input {self.channel}",
            description=f"an actuator lags behind the input {self.channel}",
            location=Location(LocationKind.INPUT, self.channel),
            signals=(self.channel,),
            complexity=2,
            bounds={"time": (1e-6, float("inf"))},
            unit_gain=True,
            delay="time",
        )

    @property
    def extra_states(self):
        return (f"lagged {self.channel}",)


class CommonInputLag(CommonInputEffect, AbstractLag):
    """First-order actuators with one time constant between several recorded inputs and the plant.

        d(lagged_i)/dt = (u_i - lagged_i) / time,    u_i -> u_i + gain (lagged_i - u_i)

    The full lag has a gain of one. Each actuator starts in equilibrium with the record's first
    input.

    Args:
        channels: names of the inputs.
        unit: their unit.
        gain: share of the lagged path, one for a lag [1].
        time: time constant [s].
    """

    channels: tuple[str, ...] = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    time: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(UNSET_TIME))

    @property
    def card(self):
        return EffectCard(
            name=f"lag of {self.display_name}",
            description=f"an actuator lag is the same in {self.display_name}",
            location=Location(LocationKind.MODEL, ""),
            signals=self.channels,
            complexity=2,
            bounds={"time": (1e-6, float("inf"))},
            unit_gain=True,
        )

    @property
    def extra_states(self):
        return tuple(f"commonly lagged {channel}" for channel in self.channels)
