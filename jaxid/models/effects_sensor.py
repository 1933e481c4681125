"""General effects in the instruments: bias, scale, delay, lag, saturation."""

import abc
import dataclasses
from typing import Literal

import equinox as eqx
import interpax
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.grid import strictly_increasing
from .._foundation.types import Array, Float
from .effects import PRESENT, Effect, zero

PILE = 3  # samples at exactly one extreme value: noise alone does not repeat itself
CROWD = 5  # times as many there as at any other value: neither a coarse scale nor rest makes such a pile at an end


class SensorEffect(Effect):
    """What happens in the sensor of one output; a subclass says what becomes of its signal.

    Attributes:
        channel: name of the output.
    """

    channel: eqx.AbstractVar[str]

    @abc.abstractmethod
    def reading(self, t: Float[Array, " time"], signal: Float[Array, " time"]) -> Float[Array, " time"]:
        """What the sensor makes of its sampled signal."""

    @property
    def place(self):
        return f"sensor {self.channel}"

    def observe(self, t, y, outputs):
        return read_together((self,), t, y, outputs)


def read_together(
    effects: tuple[SensorEffect, ...],
    t: Float[Array, " time"],
    y: Float[Array, "time output"],
    outputs: tuple[str, ...],
) -> Float[Array, "time output"]:
    """The outputs under effects that are alike but for their channels, of which no two are the same: computed as one."""
    columns = np.array([outputs.index(effect.channel) for effect in effects])
    arrays, rest = zip(*(eqx.partition(effect, eqx.is_inexact_array) for effect in effects), strict=True)
    stacked = jax.tree.unflatten(
        jax.tree.structure(arrays[0]), [jnp.stack(leaves) for leaves in zip(*map(jax.tree.leaves, arrays), strict=True)]
    )
    read = jax.vmap(lambda own, signal: eqx.combine(own, rest[0]).reading(t, signal), in_axes=(0, 1), out_axes=1)
    return y.at[:, columns].set(read(stacked, y[:, columns]))


def alike(effect: Effect):
    """Sensor effects with the same key can be read together; None for any other effect."""
    if not isinstance(effect, SensorEffect):
        return None
    static = [
        field.name for field in dataclasses.fields(effect) if field.metadata.get("static") and field.name != "channel"
    ]
    return (type(effect), *(getattr(effect, name) for name in static))


class SensorBias(SensorEffect):
    """A constant offset of an output, in its unit: `y -> y + gain`.

    Args:
        channel: name of the output.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"bias of {self.channel}"

    @property
    def sentence(self):
        return f"the sensor of {self.channel} has an offset"

    def reading(self, t, signal):
        return signal + self.gain


class SensorScale(SensorEffect):
    """An error of scale of an output: `y -> (1 + gain) y`.

    Args:
        channel: name of the output.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"scale of {self.channel}"

    @property
    def sentence(self):
        return f"the sensor of {self.channel} has an error of scale"

    def reading(self, t, signal):
        return (1.0 + self.gain) * signal


class SensorDelay(SensorEffect):
    """An output is recorded late, or early: `y(t) -> y(t - gain)`, with gain in seconds, by cubics through the samples.

    Args:
        channel: name of the output.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"delay of {self.channel}"

    @property
    def signals_used(self):
        return (self.channel,)

    @property
    def sentence(self):
        return f"the sensor of {self.channel} is {'early' if self.gain < 0 else 'late'}"

    def reading(self, t, signal):
        return late(t, signal, self.gain)


class SensorLag(SensorEffect):
    """A first-order lag of an output, exact for straight lines between the samples.

        lag dw/dt = y - w,    y -> w,    lag = gain in seconds

    Below zero no lag is; there the effect goes on as it begins, `y -> y - gain dy/dt`, so that it has a slope at zero.

    Args:
        channel: name of the output.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"lag of {self.channel}"

    @property
    def signals_used(self):
        return (self.channel,)

    @property
    def sentence(self):
        return f"the sensor of {self.channel} lags behind"

    @property
    def bounds(self):
        return PRESENT

    def reading(self, t, signal):
        return lagging(t, signal, self.gain)


class SensorSaturation(SensorEffect):
    """An output stops at a level: what lies beyond it is taken away, all of it at a gain of one.

        y -> y - gain max(y - level, 0)     at the upper end, and its mirror image at the lower

    The level starts at the extreme of the measured signal. Several samples at exactly that value are what a stop looks like,
    and are reason enough to try it; many more than at any other value show it, whatever the model.

    Args:
        channel: name of the output.
        end: which end of the range.
    """

    channel: str = eqx.field(static=True)
    end: Literal["upper", "lower"] = eqx.field(static=True, default="upper")
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    level: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"{self.end} saturation of {self.channel}"

    @property
    def sentence(self):
        return f"the sensor of {self.channel} stops at {'an upper' if self.end == 'upper' else 'a lower'} level"

    @property
    def stage(self):
        return 1  # what it shows stops, offset and scale in it

    @property
    def complexity(self):
        return 2

    @property
    def whole(self):
        return True

    @property
    def begin(self):
        return 1.0

    def worth_trying(self, measured):
        signal = measured[self.channel]
        return int(np.sum(signal == self._extreme(signal))) >= PILE

    def shown(self, measured):
        signal = measured[self.channel]
        at_end = signal == self._extreme(signal)
        _, elsewhere = np.unique(signal[~at_end], return_counts=True)
        return int(np.sum(at_end)) > CROWD * int(np.max(elsewhere, initial=1))

    def start(self, signals, measured, step):
        return eqx.tree_at(lambda effect: effect.level, self, jnp.asarray(self._extreme(measured[self.channel])))

    def reading(self, t, signal):
        sign = 1.0 if self.end == "upper" else -1.0
        return signal - self.gain * sign * jnp.maximum(sign * (signal - self.level), 0.0)

    def _extreme(self, signal):
        return np.max(signal) if self.end == "upper" else np.min(signal)


def late(t: Float[Array, " time"], signal: Float[Array, " time"], delay: Float[Array, ""]) -> Float[Array, " time"]:
    """A signal that is recorded late, `y(t - delay)`, by cubics through the samples; before its first sample it stands still.

    Args:
        t: time [s]; padding, where it stands still, changes nothing.
        signal: samples of y [any].
        delay: time by which it is late, negative for early [s].
    """
    knots, last = strictly_increasing(t), jnp.sum(jnp.diff(t) > 0)
    # The last real straight line goes on through the padding, so that padding changes nothing.
    line = (jnp.diff(signal) / jnp.diff(knots))[jnp.minimum(jnp.arange(t.size - 1), last - 1)]
    slopes = 0.5 * (jnp.concatenate([line[:1], line]) + jnp.concatenate([line, line[-1:]]))
    earlier = jnp.clip(knots - delay, knots[0], knots[last])
    with jax.numpy_rank_promotion("allow"):  # interpax promotes ranks inside
        return interpax.interp1d(earlier, knots, signal, method="cubic", fx=slopes)


def lagging(t: Float[Array, " time"], signal: Float[Array, " time"], lag: Float[Array, ""]) -> Float[Array, " time"]:
    """A signal behind a first-order lag, `lag dw/dt = y - w` from rest, exact for straight lines between the samples.

    Args:
        t: time [s].
        signal: samples of y [any].
        lag: time constant [s]; below zero the effect goes on as it begins, `y - lag dy/dt`.
    """

    def follow(error, now):
        # The lagging part e = y - w obeys lag de/dt = lag dy/dt - e, and for a slope s tends to lag * s.
        rise, h = now
        ratio = h / jnp.where(lag > 0, lag, 1.0)
        keep = jnp.where(lag > 0, jnp.exp(-ratio), 0.0)
        error = error * keep + lag * rise / jnp.where(h > 0, h, 1.0) * (1.0 - keep)
        return error, error

    _, error = jax.lax.scan(follow, jnp.zeros(()), (jnp.diff(signal), jnp.diff(t)))
    return signal.at[1:].add(-error)
