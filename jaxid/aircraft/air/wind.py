"""The steady motion of the air over ground, and single gusts of the certification rules."""

import abc

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.traced_checks import require_value
from ..._foundation.types import Array, Float
from ..physics.imperial import FOOT

Times = Float[Array, "*time"]
Value = Array | float | int

# Roughness lengths of MIL-F-8785C, 3.7.3.2 [m].
ROUGHNESS_LANDING = 0.15 * FOOT  # flight phases of category C
ROUGHNESS_OTHER = 2.0 * FOOT  # all others


class AbstractWind(eqx.Module):
    """The velocity of the air over ground as a function of altitude alone."""

    @abc.abstractmethod
    def velocity(self, altitude: Float[Array, ""]) -> Float[Array, "3"]:
        """Return the velocity of the air in earth axes; a wind from the north has a negative first
        component.

        Args:
            altitude: [m].

        Returns:
            North, east and down component, shape (3,) [m/s].
        """


class Wind(AbstractWind):
    """A steady wind with a constant shear, `W(h) = W0 + (h - h0) dW/dh` in each component; calm by
    default.

    Args:
        north, east, down: velocity of the air W0 at the reference altitude [m/s].
        north_shear, east_shear, down_shear: its rise with altitude dW/dh [1/s].
        reference: altitude h0 [m].

    Raises:
        InputError: when a number is not finite.
    """

    north: Float[Array, ""]
    east: Float[Array, ""]
    down: Float[Array, ""]
    north_shear: Float[Array, ""]
    east_shear: Float[Array, ""]
    down_shear: Float[Array, ""]
    reference: Float[Array, ""]

    def __init__(
        self,
        north: Value = 0.0,
        east: Value = 0.0,
        down: Value = 0.0,
        *,
        north_shear: Value = 0.0,
        east_shear: Value = 0.0,
        down_shear: Value = 0.0,
        reference: Value = 0.0,
    ):
        values = (north, east, down, north_shear, east_shear, down_shear, reference)
        require_value(
            values, lambda s: True, "Wind: {} is not a finite number. Give m/s, 1/s and m."
        )
        self.north, self.east, self.down, *shear, self.reference = (
            jnp.asarray(value, float) for value in values
        )
        self.north_shear, self.east_shear, self.down_shear = shear

    def velocity(self, altitude):
        steady = jnp.stack([self.north, self.east, self.down])
        return steady + (altitude - self.reference) * jnp.stack(
            [self.north_shear, self.east_shear, self.down_shear]
        )


class BoundaryLayerWind(AbstractWind):
    """A horizontal wind that grows with the logarithm of the height, `W(h) = W20 ln(h/z0)/ln(20
    ft/z0)`.

    Below 3 ft and above 1000 ft, the ends of the specification, the wind is constant.

    Source: MIL-F-8785C, Flying qualities of piloted airplanes, 1980, 3.7.3.2.

    Args:
        north, east: velocity of the air 20 ft above the ground [m/s].
        roughness: z0, `ROUGHNESS_LANDING` in approach and landing, else `ROUGHNESS_OTHER` [m].
        ground: altitude of the ground [m].

    Raises:
        InputError: when the roughness is not between 0 and 3 ft.
    """

    north: Float[Array, ""]
    east: Float[Array, ""]
    roughness: Float[Array, ""]
    ground: Float[Array, ""]

    def __init__(
        self, north: Value, east: Value, *, roughness: Value = ROUGHNESS_OTHER, ground: Value = 0.0
    ):
        require_value(
            (north, east, ground),
            lambda s: True,
            "Wind: {} is not a finite number. Give m/s and m.",
        )
        require_value(
            roughness,
            lambda s: (s > 0) & (s < 3.0 * FOOT),
            "Wind: the roughness length is {} m. Give one between 0 and 0.9 m, such as "
            "ROUGHNESS_OTHER.",
        )
        self.north, self.east = jnp.asarray(north, float), jnp.asarray(east, float)
        self.roughness, self.ground = jnp.asarray(roughness, float), jnp.asarray(ground, float)

    def velocity(self, altitude):
        height = jnp.clip(altitude - self.ground, 3.0 * FOOT, 1000.0 * FOOT)
        profile = jnp.log(height / self.roughness) / jnp.log(20.0 * FOOT / self.roughness)
        return profile * jnp.stack([self.north, self.east, jnp.zeros_like(self.north)])


def one_minus_cosine(t: Times, start: Value, length: Value, V: Value, amplitude: Value) -> Times:
    """Return a discrete gust that rises and falls, `a/2 (1 - cos(pi x/H))` for `0 <= x <= 2H`, else
    0; `x = V (t - start)`.

    Source: FAR/CS 25.341(a), the discrete design gust, in which H is the gradient distance, 30 to
    350 ft.

    Args:
        t: times, of any shape [s].
        start: time at which the aircraft meets it [s].
        length: H, from the edge to the peak [m].
        V: speed relative to the air [m/s].
        amplitude: peak a [m/s for a velocity].

    Returns:
        The gust at each time [the amplitude's unit], for one column of the gust signals.

    Raises:
        InputError: when length or speed is not positive.
    """
    return 0.5 * amplitude * (1.0 - jnp.cos(jnp.pi * _gust_phase(t, start, length, V, 2.0)))


def one_minus_cosine_rise(
    t: Times, start: Value, length: Value, V: Value, amplitude: Value
) -> Times:
    """Return a discrete gust that rises and stays, `a/2 (1 - cos(pi x/d))` for `0 <= x <= d`, 0
    before and `a` after; `x = V (t - start)`.

    Two of them, the second with the negative amplitude, make a gust that ends.

    Source: MIL-F-8785C, Flying qualities of piloted airplanes, 1980, 3.7.1.3.

    Args:
        t: times, of any shape [s].
        start: time at which the aircraft meets it [s].
        length: d, from the edge to the full gust [m].
        V: speed relative to the air [m/s].
        amplitude: height a [m/s for a velocity].

    Returns:
        The gust at each time [the amplitude's unit], for one column of the gust signals.

    Raises:
        InputError: when length or speed is not positive.
    """
    return 0.5 * amplitude * (1.0 - jnp.cos(jnp.pi * _gust_phase(t, start, length, V, 1.0)))


def _gust_phase(t: Times, start: Value, length: Value, V: Value, end: float) -> Times:
    """Return the distance flown inside the gust, in gust lengths, clipped to 0 and `end`."""
    require_value(
        length, lambda s: s > 0, "Discrete gust: the length is {} m. Give a positive number."
    )
    require_value(
        V, lambda s: s > 0, "Discrete gust: the speed V is {} m/s. Give a positive number."
    )
    return jnp.clip(V * (t - start) / length, 0.0, end)
