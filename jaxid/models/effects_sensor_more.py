"""More effects in the instruments: drift, quantisation, cross-talk from another channel."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Float
from .effects import Effect, zero
from .effects_sensor import SensorEffect

COARSE = 1e-5  # of a signal's range: a finer grid is that of the numbers, not of an instrument
ON_GRID = 0.01  # of the grid's step: how far a reading may lie off it, for numbers that were rounded when written
STAIRS = 0.2  # share of neighbouring samples that are equal, from which on a signal looks like stairs


class SensorDrift(SensorEffect):
    """An output drifts in time: `y -> y + gain (t - t_0)`, with gain in its unit per second, from zero in every record.

    Args:
        channel: name of the output.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"drift of {self.channel}"

    @property
    def sentence(self):
        return f"the sensor of {self.channel} drifts"

    def reading(self, t, signal):
        return signal + self.gain * (t - t[0])


class SensorQuantisation(SensorEffect):
    """An output is recorded in steps: `y -> y + gain (Q(y) - y)`, with Q(y) the nearest value on the grid of the measured ones.

    To a derivative in anything but the gain the steps are the straight line on average that they are. A signal that does not lie
    on a grid is left as it is.

    Args:
        channel: name of the output.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    grid: Float[Array, ""] = eqx.field(default_factory=zero)
    origin: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"quantisation of {self.channel}"

    @property
    def sentence(self):
        return f"{self.channel} is recorded in steps"

    @property
    def stage(self):
        return 2  # the last thing that happens to a signal

    @property
    def fixed(self):
        return ("grid", "origin")

    @property
    def complexity(self):
        return 2

    @property
    def begin(self):
        return 1.0

    def worth_trying(self, measured):
        signal = measured[self.channel]
        return grid_of(signal) > 0 and float(np.mean(np.diff(signal) == 0)) > STAIRS

    @property
    def whole(self):
        return True

    def start(self, signals, measured, step):
        signal = measured[self.channel]
        shape = jnp.asarray(grid_of(signal)), jnp.asarray(float(np.min(signal)))
        return eqx.tree_at(lambda effect: (effect.grid, effect.origin), self, shape)

    def reading(self, t, signal):
        step = jnp.where(self.grid > 0, self.grid, 1.0)
        nearest = self.origin + step * jnp.round((signal - self.origin) / step)
        error = jnp.where(self.grid > 0, nearest - signal, 0.0)
        return signal + self.gain * jax.lax.stop_gradient(error)


class SensorCrossTalk(Effect):
    """One output leaks into another: `y_channel -> y_channel + gain y_source`.

    Gyros and accelerometers whose axes are not at right angles are the pattern.

    Args:
        channel: name of the output that shows it.
        source: name of the output that leaks.
    """

    channel: str = eqx.field(static=True)
    source: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"cross-talk of {self.source} into {self.channel}"

    @property
    def place(self):
        return f"sensor {self.channel}"

    @property
    def sentence(self):
        return f"the sensor of {self.channel} also feels {self.source}"

    def observe(self, t, y, outputs):
        return y.at[:, outputs.index(self.channel)].add(self.gain * y[:, outputs.index(self.source)])


def grid_of(signal: Float[np.ndarray, " _"]) -> float:
    """The step of the grid on which all values of a signal lie; zero where they lie on none, or on one as fine as numbers are."""
    values = np.unique(signal)
    reach = values[-1] - values[0] if values.size else 0.0
    apart = np.diff(values)
    apart = apart[apart > COARSE * reach]
    if apart.size == 0:
        return 0.0
    step = reach / np.round(reach / np.min(apart))
    steps = (values - values[0]) / step
    return float(step) if np.max(np.abs(steps - np.round(steps))) < ON_GRID else 0.0
