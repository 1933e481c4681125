"""Quantisation of a sensor, and the grid on which recorded values lie."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.location import Location, LocationKind
from .._foundation.types import Array, Float
from .base import zero
from .card import EffectCard
from .sensor import SensorEffect

# least grid step as a share of the signal's range (chosen): a finer grid is the precision of the
# written numbers, not of an instrument
MIN_GRID_TO_RANGE = 1e-5
# largest distance of a value from the grid, in grid steps (chosen): files hold rounded numbers
GRID_TOLERANCE = 0.01
# least share of equal neighbouring samples in a visibly stepped signal (chosen)
MIN_REPEATED_SHARE = 0.2


class SensorQuantisation(SensorEffect):
    """Quantisation of an output: `y -> y + gain (Q(y) - y)`.

    Q(y) is the nearest value on the grid of the measured values. Derivatives with respect to
    anything but the gain ignore the steps (straight-through estimate), as Q(y) equals y on average.
    A signal whose measured values lie on no grid is not changed.

    Args:
        channel: name of the output.
        grid: step of the grid, zero if there is none [unit of the output].
        origin: a value on the grid [unit of the output].
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    grid: Float[Array, ""] = eqx.field(default_factory=zero)
    origin: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        return EffectCard(
            name=f"quantisation of {self.channel}",
            description=f"{self.channel} is recorded in steps",
            location=Location(LocationKind.SENSOR, self.channel),
            complexity=2,
            unit_gain=True,
            stage=2,  # the last effect in a sensor
            fixed=("grid", "origin"),
            initial_gain=1.0,
        )

    def score_blind(self, measured):
        signal = measured[self.channel]
        return grid_of(signal) > 0 and float(np.mean(np.diff(signal) == 0)) > MIN_REPEATED_SHARE

    def initialise_shape(self, signals, measured, step):
        signal = measured[self.channel]
        shape = jnp.asarray(grid_of(signal)), jnp.asarray(float(np.min(signal)))
        return eqx.tree_at(lambda effect: (effect.grid, effect.origin), self, shape)

    def reading(self, t, signal):
        step = jnp.where(self.grid > 0, self.grid, 1.0)
        nearest = self.origin + step * jnp.round((signal - self.origin) / step)
        error = jnp.where(self.grid > 0, nearest - signal, 0.0)
        return signal + self.gain * jax.lax.stop_gradient(error)


def grid_of(signal: Float[np.ndarray, " _"]) -> float:
    """Return the step of the grid on which all values of a signal lie.

    The step is zero if there is no such grid, or if it is no coarser than the written numbers.
    """
    values = np.unique(signal)
    extent = values[-1] - values[0] if values.size else 0.0
    gaps = np.diff(values)
    gaps = gaps[gaps > MIN_GRID_TO_RANGE * extent]
    if gaps.size == 0:
        return 0.0
    step = extent / np.round(extent / np.min(gaps))
    steps = (values - values[0]) / step
    return float(step) if np.max(np.abs(steps - np.round(steps))) < GRID_TOLERANCE else 0.0
