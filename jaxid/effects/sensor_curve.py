"""Static curves of a sensor: curvature, and different slopes for positive and negative readings."""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp

from .._foundation.location import Location, LocationKind
from .._foundation.types import Array, Float
from .base import zero
from .card import EffectCard
from .sensor import SensorEffect
from .shape_initialisation import centre_of, max_deviation

NAMES = {"square": "curvature", "absolute": "asymmetry"}
CURVES = {
    "square": "a curved characteristic",
    "absolute": "another slope above its centre than below",
}


class SensorCurve(SensorEffect):
    """Static curve of an output, with `d = y - centre`.

        y -> y + gain d^2 / range      square: a curved characteristic
        y -> y + gain |d|              absolute: the slope is 1 + gain above, 1 - gain below

    The gain has no unit: it is the relative error at the end of the range. Centre and range are set
    from the measured output and not estimated. The centre is zero if zero lies between the
    quartiles, else the median, so that the curve differs from a scale error and an offset. The
    range is the largest deviation from it.

    Args:
        channel: name of the output.
        curve: which curve.
        gain: relative error at the end of the range [1].
        centre: reading at which the curve begins [unit of the output].
        range: largest deviation from the centre [unit of the output].
    """

    channel: str = eqx.field(static=True)
    curve: Literal["square", "absolute"] = eqx.field(static=True, default="square")
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    centre: Float[Array, ""] = eqx.field(default_factory=zero)
    range: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.ones(()))

    @property
    def card(self):
        return EffectCard(
            name=f"{NAMES[self.curve]} of {self.channel}",
            description=f"the sensor of {self.channel} has {CURVES[self.curve]}",
            location=Location(LocationKind.SENSOR, self.channel),
            each_sample=True,
            complexity=2,
            fixed=("centre", "range"),
        )

    def initialise_shape(self, signals, measured, step):
        signal = measured[self.channel]
        shape = centre_of(signal), jnp.asarray(max_deviation(signal))
        return eqx.tree_at(lambda effect: (effect.centre, effect.range), self, shape)

    def reading(self, t, signal):
        deviation = signal - self.centre
        if self.curve == "square":
            return signal + self.gain * deviation**2 / self.range
        return signal + self.gain * jnp.abs(deviation)
