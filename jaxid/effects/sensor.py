"""General effects in the sensors: bias, scale, drift, delay, lag, saturation, cross-talk."""

import abc
import dataclasses
from typing import Literal

import equinox as eqx
import interpax
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.grid import strictly_increasing
from .._foundation.location import Location, LocationKind
from .._foundation.types import Array, Float
from ..models.base import canonical
from .base import Effect, is_negative, zero
from .card import PRESENT, EffectCard

# samples at exactly the extreme value (chosen): noise alone does not repeat a value
MIN_EXTREME_SAMPLES = 3
# samples at the extreme value per sample at the most frequent other value (chosen): coarse
# quantisation does not exceed it; a long rest at the extreme amid a record does
EXTREME_TO_MODE_RATIO = 5


class SensorEffect(Effect):
    """An effect in the sensor of one output; a subclass implements `reading`.

    Attributes:
        channel: name of the output.
    """

    channel: eqx.AbstractVar[str]

    @abc.abstractmethod
    def reading(
        self, t: Float[Array, " time"], signal: Float[Array, " time"]
    ) -> Float[Array, " time"]:
        """Return the recorded signal for the samples of the true signal."""

    def observe(self, t, y, outputs):
        return apply_together((self,), t, y, outputs)


def apply_together(
    effects: tuple[SensorEffect, ...],
    t: Float[Array, " time"],
    y: Float[Array, "time output"],
    outputs: tuple[str, ...],
) -> Float[Array, "time output"]:
    """Return the outputs under effects of one kind on different channels, vectorised.

    Args:
        effects: effects with one `vectorisation_key` and different channels.
        t: time [s].
        y: outputs.
        outputs: names of the outputs.
    """
    columns = np.array([outputs.index(effect.channel) for effect in effects])
    arrays, static = zip(
        *(eqx.partition(effect, eqx.is_inexact_array) for effect in canonical(effects)), strict=True
    )
    stacked = jax.tree.unflatten(
        jax.tree.structure(arrays[0]),
        [jnp.stack(leaves) for leaves in zip(*map(jax.tree.leaves, arrays), strict=True)],
    )
    read = jax.vmap(
        lambda leaves, signal: eqx.combine(leaves, static[0]).reading(t, signal),
        in_axes=(0, 1),
        out_axes=1,
    )
    return y.at[:, columns].set(read(stacked, y[:, columns]))


def vectorisation_key(effect: Effect):
    """Return the key shared by sensor effects that can be vectorised; None for other effects."""
    if not isinstance(effect, SensorEffect):
        return None
    static = [
        field.name
        for field in dataclasses.fields(effect)
        if field.metadata.get("static") and field.name != "channel"
    ]
    return (type(effect), *(getattr(effect, name) for name in static))


class SensorBias(SensorEffect):
    """Constant offset of an output: `y -> y + gain`, gain [unit of y].

    Args:
        channel: name of the output.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        return EffectCard(
            name=f"bias of {self.channel}",
            description=f"the sensor of {self.channel} has an offset",
            location=Location(LocationKind.SENSOR, self.channel),
            each_sample=True,
        )

    def reading(self, t, signal):
        return signal + self.gain


class SensorScale(SensorEffect):
    """Scale error of an output: `y -> (1 + gain) y`.

    Args:
        channel: name of the output.
        gain: relative error of the scale [1].
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        return EffectCard(
            name=f"scale of {self.channel}",
            description=f"the sensor of {self.channel} has a scale error",
            location=Location(LocationKind.SENSOR, self.channel),
            each_sample=True,
        )

    def reading(self, t, signal):
        return (1.0 + self.gain) * signal


class SensorDrift(SensorEffect):
    """Linear drift of an output: `y -> y + gain (t - t_0)`, gain [unit of y/s].

    `t_0` is the first time of each record.

    Args:
        channel: name of the output.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        return EffectCard(
            name=f"drift of {self.channel}",
            description=f"the sensor of {self.channel} drifts",
            location=Location(LocationKind.SENSOR, self.channel),
        )

    def reading(self, t, signal):
        return signal + self.gain * (t - t[0])


class SensorDelay(SensorEffect):
    """Delay of an output: `y(t) -> y(t - gain)`, gain [s], by cubic interpolation of the samples.

    A negative gain means that the output is recorded early.

    Args:
        channel: name of the output.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        when = "early" if is_negative(self.gain) else "late"
        return EffectCard(
            name=f"delay of {self.channel}",
            description=f"the sensor of {self.channel} is {when}",
            location=Location(LocationKind.SENSOR, self.channel),
            signals=(self.channel,),
            delay="gain",
        )

    def reading(self, t, signal):
        return delayed_signal(t, signal, self.gain)


class SensorLag(SensorEffect):
    """A first-order lag of an output, exact for straight lines between the samples.

        lag dw/dt = y - w,    y -> w,    lag = gain in seconds

    A lag cannot be negative. For a negative gain the effect is continued by its linearisation, `y
    -> y - gain dy/dt`, so that it is differentiable at zero.

    Args:
        channel: name of the output.
        gain: time constant of the lag [s].
        start: `y - w` at the first sample [unit of the output]; zero in equilibrium. A record that
            begins in motion has a value of its own.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    start: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        return EffectCard(
            name=f"lag of {self.channel}",
            description=f"the sensor of {self.channel} lags behind",
            location=Location(LocationKind.SENSOR, self.channel),
            signals=(self.channel,),
            bounds=PRESENT,
            delay="gain",
            by_record=("start",),
        )

    def reading(self, t, signal):
        return lagged_signal(t, signal, self.gain, self.start)


class SensorSaturation(SensorEffect):
    """Saturation of a sensor at a level.

        y -> y - gain max(y - level, 0)    at the upper end
        y -> y - gain min(y - level, 0)    at the lower end

    The full effect has a gain of one. The initial level is the extreme of the measured signal. The
    effect is tried if several samples have exactly that value, regardless of its score
    (`score_blind`). It is evident in the data if many more samples have that value than any other;
    a record may begin and end at rest there, so that its first and last samples do not count.

    Args:
        channel: name of the output.
        end: which end of the range.
        level: level of saturation [unit of the output].
    """

    channel: str = eqx.field(static=True)
    end: Literal["upper", "lower"] = eqx.field(static=True, default="upper")
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    level: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        end = "an upper" if self.end == "upper" else "a lower"
        return EffectCard(
            name=f"{self.end} saturation of {self.channel}",
            description=f"the sensor of {self.channel} stops at {end} level",
            location=Location(LocationKind.SENSOR, self.channel),
            each_sample=True,
            complexity=2,
            unit_gain=True,
            stage=1,  # the recorded value saturates, after bias and scale
            initial_gain=1.0,
        )

    def score_blind(self, measured):
        signal = measured[self.channel]
        return int(np.sum(signal == self._extreme(signal))) >= MIN_EXTREME_SAMPLES

    def evident_in_data(self, measured):
        signal = np.concatenate(measured[self.channel])
        inside = [own != self._extreme(signal) for own in measured[self.channel]]
        _, elsewhere = np.unique(signal[np.concatenate(inside)], return_counts=True)
        # between the first and the last sample of each record inside of the range
        stopped = sum(int(np.sum(~np.trim_zeros(own))) for own in inside)
        return stopped > EXTREME_TO_MODE_RATIO * int(np.max(elsewhere, initial=1))

    def initialise_shape(self, signals, measured, step):
        return eqx.tree_at(
            lambda effect: effect.level, self, jnp.asarray(self._extreme(measured[self.channel]))
        )

    def reading(self, t, signal):
        sign = 1.0 if self.end == "upper" else -1.0
        return signal - self.gain * sign * jnp.maximum(sign * (signal - self.level), 0.0)

    def _extreme(self, signal):
        return np.max(signal) if self.end == "upper" else np.min(signal)


class SensorCrossTalk(Effect):
    """Cross-talk from one output into another: `channel -> channel + gain source`.

    A typical cause is gyros or accelerometers with non-orthogonal axes.

    Args:
        channel: name of the affected output.
        source: name of the output that leaks into it.
        gain: part of the source in the affected output [unit of the output/unit of the source].
    """

    channel: str = eqx.field(static=True)
    source: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        return EffectCard(
            name=f"cross-talk of {self.source} into {self.channel}",
            description=f"the sensor of {self.channel} also measures {self.source}",
            location=Location(LocationKind.SENSOR, self.channel),
            each_sample=True,
        )

    def observe(self, t, y, outputs):
        return y.at[:, outputs.index(self.channel)].add(
            self.gain * y[:, outputs.index(self.source)]
        )


def delayed_signal(
    t: Float[Array, " time"], signal: Float[Array, " time"], delay: Float[Array, ""]
) -> Float[Array, " time"]:
    """Return a delayed signal, `y(t - delay)`, by cubic interpolation of the samples.

    Before its first sample and after its last one the signal is a straight line.

    Args:
        t: time [s]; constant in the padding, which does not change the result.
        signal: samples of y [any].
        delay: delay, negative for an early signal [s].
    """
    knots, last = strictly_increasing(t), jnp.sum(jnp.diff(t) > 0)
    # The last real line continues through the padding, so that padding does not change the slopes.
    line = (jnp.diff(signal) / jnp.diff(knots))[jnp.minimum(jnp.arange(t.size - 1), last - 1)]
    slopes = 0.5 * (jnp.concatenate([line[:1], line]) + jnp.concatenate([line, line[-1:]]))
    earlier = knots - delay
    inside = jnp.clip(earlier, knots[0], knots[last])
    outside = (earlier - inside) * jnp.where(earlier < knots[0], slopes[0], slopes[last])
    with jax.numpy_rank_promotion("allow"):  # interpax promotes ranks inside
        return outside + interpax.interp1d(inside, knots, signal, method="cubic", fx=slopes)


def lagged_signal(
    t: Float[Array, " time"],
    signal: Float[Array, " time"],
    lag: Float[Array, ""],
    start: Float[Array, ""] | float = 0.0,
) -> Float[Array, " time"]:
    """Return a signal after a first-order lag, `lag dw/dt = y - w`.

    The result is exact for a signal that is linear between its samples.

    Args:
        t: time [s].
        signal: samples of y [any].
        lag: time constant [s]; for negative values the linearisation `y - lag dy/dt` is used.
        start: `y - w` at the first sample [unit of y]; without a lag it has no influence.
    """

    def follow(error, now):
        # The lagging part e = y - w obeys lag de/dt = lag dy/dt - e, and for a slope s tends to lag
        # * s.
        rise, h = now
        ratio = h / jnp.where(lag > 0, lag, 1.0)
        keep = jnp.where(lag > 0, jnp.exp(-ratio), 0.0)
        error = error * keep + lag * rise / jnp.where(h > 0, h, 1.0) * (1.0 - keep)
        return error, error

    start = jnp.where(lag > 0, start, 0.0)
    _, error = jax.lax.scan(follow, start, (jnp.diff(signal), jnp.diff(t)))
    return signal - jnp.concatenate([start[None], error])
