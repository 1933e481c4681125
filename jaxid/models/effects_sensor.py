"""General effects in the instruments: bias, scale, delay, lag, saturation."""

from typing import Literal

import equinox as eqx
import interpax
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.grid import strictly_increasing
from .._foundation.types import Array, Float
from .effects import Effect, zero

PILE = 3  # samples at exactly one extreme value: noise alone does not repeat itself


class SensorBias(Effect):
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
    def place(self):
        return f"sensor {self.channel}"

    @property
    def sentence(self):
        return f"the sensor of {self.channel} has an offset"

    def observe(self, t, y, outputs):
        return y.at[:, outputs.index(self.channel)].add(self.gain)


class SensorScale(Effect):
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
    def place(self):
        return f"sensor {self.channel}"

    @property
    def sentence(self):
        return f"the sensor of {self.channel} has an error of scale"

    def observe(self, t, y, outputs):
        return y.at[:, outputs.index(self.channel)].multiply(1.0 + self.gain)


class SensorDelay(Effect):
    """An output is recorded late: `y(t) -> y(t - gain)`, with gain in seconds, by cubics through the samples.

    Args:
        channel: name of the output.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"delay of {self.channel}"

    @property
    def place(self):
        return f"sensor {self.channel}"

    @property
    def sentence(self):
        return f"the sensor of {self.channel} is late"

    def observe(self, t, y, outputs):
        column = outputs.index(self.channel)
        return y.at[:, column].set(late(t, y[:, column], self.gain))


class SensorLag(Effect):
    """A first-order lag of an output, exact for straight lines between the samples.

        lag dw/dt = y - w,    y -> w,    lag = gain in seconds

    Below zero, where a search may pass, the effect goes on as it begins: `y -> y - gain dy/dt`.

    Args:
        channel: name of the output.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"lag of {self.channel}"

    @property
    def place(self):
        return f"sensor {self.channel}"

    @property
    def sentence(self):
        return f"the sensor of {self.channel} lags behind"

    def observe(self, t, y, outputs):
        column = outputs.index(self.channel)
        return y.at[:, column].set(lagging(t, y[:, column], self.gain))


class SensorSaturation(Effect):
    """An output stops at a level: what lies beyond it is taken away, all of it at a gain of one.

        y -> y - gain max(y - level, 0)     at the upper end, and its mirror image at the lower

    The level starts at the extreme of the measured signal. Several samples at exactly that value are what a stop looks like,
    and are reason enough to try it.

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
    def place(self):
        return f"sensor {self.channel}"

    @property
    def sentence(self):
        return f"the sensor of {self.channel} stops at {'an upper' if self.end == 'upper' else 'a lower'} level"

    @property
    def complexity(self):
        return 2

    @property
    def begin(self):
        return 1.0

    def worth_trying(self, measured):
        signal = measured[self.channel]
        return int(np.sum(signal == self._extreme(signal))) >= PILE

    def start(self, signals, measured, step):
        return eqx.tree_at(lambda effect: effect.level, self, jnp.asarray(self._extreme(measured[self.channel])))

    def observe(self, t, y, outputs):
        column = outputs.index(self.channel)
        sign = 1.0 if self.end == "upper" else -1.0
        beyond = sign * jnp.maximum(sign * (y[:, column] - self.level), 0.0)
        return y.at[:, column].add(-self.gain * beyond)

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
