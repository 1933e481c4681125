"""What follows a signal with a memory of where it was: no faster than a limit, or with hysteresis."""

import abc
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.types import Array, Float

Knots = Float[Array, " knot"]


class AbstractFollower(eqx.Module):
    """What follows a signal that is known at its knots; it begins at rest.

    Attributes:
        parts: in how many lines a straight one is cut before, so that lines from knot to knot say what it does between samples.
    """

    parts: ClassVar[int] = 1

    @abc.abstractmethod
    def of_lines(self, knots: Knots, values: Knots, slopes: Knots | None) -> tuple[Knots, Knots | None]:
        """Where it stands at the knots of a continuous signal, and how fast it moves there, where that is known of the signal."""

    @abc.abstractmethod
    def of_steps(self, knots: Knots, values: Knots) -> Knots:
        """What it shows of a signal that holds each value until the next knot, as values that are held in the same way."""


class Slow(AbstractFollower):
    """It follows no faster than a limit; exact at the knots of a signal that is a straight line in each interval.

    Args:
        limit: of its rate [unit of the signal/s].
    """

    limit: Float[Array, ""]

    def of_lines(self, knots, values, slopes):
        after = self._ends(knots, values[:-1], values[1:])
        found = jnp.append(values[:1], after)
        if slopes is None:
            return found, None
        # Where it is behind it runs at the limit, elsewhere as the signal does.
        behind = jnp.append(0.0, values[1:] - after)
        running = jnp.where(behind == 0, jnp.clip(slopes, -self.limit, self.limit), jnp.sign(behind) * self.limit)
        return found, running

    def of_steps(self, knots, values):
        """Each knot holds the mean of the ramp, which keeps the impulse."""
        after = self._ends(knots, values[:-1], values[:-1])
        before = jnp.append(values[:1], after[:-1])
        away, reach = values[:-1] - before, self.limit * jnp.diff(knots)
        share = jnp.clip(
            jnp.abs(away) / jnp.where(reach > 0, reach, 1.0), 0.0, 1.0
        )  # of the interval, until it arrives
        mean = after - 0.5 * share * (after - before)
        return jnp.append(mean, mean[-1:])

    def _ends(self, knots: Knots, begin: Float[Array, " interval"], end: Float[Array, " interval"]):
        """Where it stands at the end of each interval."""
        limit = self.limit

        def follow(value, now):
            first, last, length = now
            slope, way = (last - first) / length, jnp.sign(first - value)
            closing = limit - way * slope
            # It meets the signal at a part of the interval, or not within it, and then stays with it or falls behind again.
            meets = jnp.where(closing > 0, jnp.abs(first - value) / jnp.where(closing > 0, closing, 1.0), length)
            behind = first + slope * meets + jnp.sign(slope) * limit * (length - meets)
            after = jnp.where(jnp.abs(slope) <= limit, last, behind)
            value = jnp.where(meets < length, after, value + way * limit * length)
            return value, value

        return jax.lax.scan(follow, begin[0], (begin, end, jnp.diff(knots)))[1]


class Hysteretic(AbstractFollower):
    """It is behind by one where the signal has risen, ahead by one where it has fallen, and turns over a width: `signal - z`.

    z is that of `bouc_wen`, depends on the way of the signal and not on its speed, and is exact at the knots of a signal that
    turns at knots only: where the signal moves on, `z = tanh(atanh z + d)` over a way of d widths; where it has turned, `z` first
    falls by d, to zero.

    Args:
        width: over which it turns [unit of the signal].
    """

    width: Float[Array, ""]
    parts: ClassVar[int] = 4

    def of_lines(self, knots, values, slopes):
        z = self._z(values)
        if slopes is None:
            return values - z, None
        return values - z, slopes - bouc_wen(z, slopes, self.width)

    def of_steps(self, knots, values):
        return values - self._z(values)

    def _z(self, values: Knots) -> Knots:
        def turn(z, step):
            way, far = jnp.where(step < 0, -1.0, 1.0), jnp.abs(step)
            z = way * z  # as of a signal that rises
            on = jnp.tanh(far - jnp.maximum(-z, 0.0))
            z = jnp.where(far < -z, z + far, (jnp.maximum(z, 0.0) + on) / (1.0 + jnp.maximum(z, 0.0) * on))
            return way * z, way * z

        return jnp.append(0.0, jax.lax.scan(turn, jnp.zeros(()), jnp.diff(values) / self.width)[1])


def bouc_wen(z: Float[Array, "*n"], rate: Float[Array, "*n"], width: Float[Array, ""]) -> Float[Array, "*n"]:
    """How fast the state of hysteresis turns with a signal, after Bouc and Wen with exponent two, in normalised form.

        width dz/dt = ds/dt - (|ds/dt| |z| z + ds/dt z^2) / 2

    Args:
        z: between minus one and one.
        rate: of the signal [its unit/s].
        width: over which it turns [unit of the signal].

    Source: Wen, J. Eng. Mech. Div. ASCE 102 (1976), pp. 249-263, with A = 1, beta = gamma = 1/2, n = 2.
    """
    return (rate - 0.5 * (jnp.abs(rate) * jnp.abs(z) * z + rate * z**2)) / width
