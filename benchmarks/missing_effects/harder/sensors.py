"""Planted effects in sensors, for all systems."""

import numpy as np

from benchmarks.missing_effects.harder.draw import one_of, sized, two_delays, two_of
from benchmarks.missing_effects.scenarios import Planted, planted
from benchmarks.missing_effects.truth_only import SensorAbsolute, SensorSquare
from jaxid.effects import Location, LocationKind, SensorDelay, SensorSaturation


def at_sensor(channel: str) -> tuple[Location, ...]:
    """Return the place of an effect in the sensor of a channel."""
    return (Location(LocationKind.SENSOR, channel),)


def curve(
    kind: type[SensorSquare] | type[SensorAbsolute],
    generator: np.random.Generator,
    gains: dict[str, float],
) -> tuple[Planted, ...]:
    """Return a square or an absolute value in the sensor of a random channel.

    Args:
        kind: class of the effect.
        generator: generator of the draw.
        gains: gain by channel.
    """
    channel = one_of(generator, tuple(gains))
    effect = kind(channel, sized(generator, gains[channel]))
    return (Planted(effect, at_sensor(channel), guesses(effect.name)),)


def guesses(name: str) -> tuple[str, ...]:
    """Return patterns of names that the library may give an effect of this name."""
    return f"{name} (*", f"{name} in *", f"sensor's {name}"


def saturation(
    generator: np.random.Generator, levels: dict[str, tuple[float, float]]
) -> tuple[Planted, ...]:
    """Return an upper saturation of a random sensor.

    Args:
        generator: generator of the draw.
        levels: range of the level by channel [unit of the channel].
    """
    channel = one_of(generator, tuple(levels))
    level = float(generator.uniform(*levels[channel]))
    return (planted(SensorSaturation, channel, gain=1.0, level=level, places=at_sensor(channel)),)


def late(channel: str, delay: float, also: tuple[str, ...] = ()) -> Planted:
    """Return a delay of a sensor [s]."""
    return planted(SensorDelay, channel, gain=delay, places=at_sensor(channel), also=also)


def two_late(
    generator: np.random.Generator, channels: tuple[str, ...], delay: float
) -> tuple[Planted, ...]:
    """Return delays of two random sensors, the second one shorter.

    Args:
        generator: generator of the draw.
        channels: sensors among which are drawn.
        delay: size of the first delay before its random factor [s].
    """
    first, second = two_of(generator, channels)
    long, short = two_delays(generator, delay)
    return late(first, long), late(second, short)
