"""Operators with memory on an input signal: a rate limiter, and Bouc-Wen hysteresis."""

import abc
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.types import Array, Float

# Chosen: least |z| whose power is taken, so that its derivative by the exponent is finite at zero.
LEAST_STATE = 1e-12
Knots = Float[Array, " knot"]


class AbstractMemoryOperator(eqx.Module):
    """Operator with memory that maps a signal, given at knots, to its output signal.

    The operator starts in equilibrium with the first value.

    Attributes:
        parts: number of sub-intervals per sample interval needed to represent the output by
            straight lines.
    """

    parts: ClassVar[int] = 1

    @abc.abstractmethod
    def on_ramps(
        self, knots: Knots, values: Knots, slopes: Knots | None
    ) -> tuple[Knots, Knots | None]:
        """Return the output and its slopes at the knots of a continuous signal.

        Args:
            knots: times [s].
            values: signal at the knots.
            slopes: its time derivatives there, or None; the output's slopes are then None as well.
        """

    @abc.abstractmethod
    def on_holds(self, knots: Knots, values: Knots) -> Knots:
        """Return the held values of the output for a signal that holds each value until the next
        knot.
        """


class RateLimited(AbstractMemoryOperator):
    """Rate limiter, exact at the knots of a piecewise linear signal.

    Args:
        limit: largest rate of the output [unit of the signal/s].
    """

    limit: Float[Array, ""]

    def on_ramps(self, knots, values, slopes):
        after = self._ends(knots, values[:-1], values[1:])
        output = jnp.append(values[:1], after)
        if slopes is None:
            return output, None
        # The output moves at the limit while it lags, otherwise with the signal.
        error = jnp.append(0.0, values[1:] - after)
        output_slopes = jnp.where(
            error == 0, jnp.clip(slopes, -self.limit, self.limit), jnp.sign(error) * self.limit
        )
        return output, output_slopes

    def on_holds(self, knots, values):
        """Return the mean of the ramp in each interval, which preserves the impulse."""
        after = self._ends(knots, values[:-1], values[:-1])
        before = jnp.append(values[:1], after[:-1])
        error, travel = values[:-1] - before, self.limit * jnp.diff(knots)
        # share of the interval until the output reaches the signal
        share = jnp.clip(jnp.abs(error) / jnp.where(travel > 0, travel, 1.0), 0.0, 1.0)
        mean = after - 0.5 * share * (after - before)
        return jnp.append(mean, mean[-1:])

    def _ends(self, knots: Knots, begin: Float[Array, " interval"], end: Float[Array, " interval"]):
        """Return the output at the end of each interval."""
        limit = self.limit

        def follow(value, interval):
            first, last, length = interval
            slope, direction = (last - first) / length, jnp.sign(first - value)
            closing = limit - direction * slope
            # The output reaches the signal within the interval or not. Afterwards it follows the
            # signal, or lags again if the signal is too fast.
            contact = jnp.where(
                closing > 0, jnp.abs(first - value) / jnp.where(closing > 0, closing, 1.0), length
            )
            lagging = first + slope * contact + jnp.sign(slope) * limit * (length - contact)
            after = jnp.where(jnp.abs(slope) <= limit, last, lagging)
            value = jnp.where(contact < length, after, value + direction * limit * length)
            return value, value

        return jax.lax.scan(follow, begin[0], (begin, end, jnp.diff(knots)))[1]


class BoucWen(AbstractMemoryOperator):
    """Bouc-Wen hysteresis, `signal - z`: it lags by one after a rise and leads by one after a fall.

    z is the state of `bouc_wen`. It depends on the path of the signal, not on its speed, and is
    exact at the knots of a signal that reverses at knots only. Over a change of d widths in one
    direction, `z = tanh(atanh z + d)`; after a reversal, `z` first decreases by d, to zero.

    Args:
        width: change of the signal over which z reverses [unit of the signal].
    """

    width: Float[Array, ""]
    parts: ClassVar[int] = 4

    def on_ramps(self, knots, values, slopes):
        z = self._z(values)
        if slopes is None:
            return values - z, None
        return values - z, slopes - bouc_wen(z, slopes, self.width)

    def on_holds(self, knots, values):
        return values - self._z(values)

    def _z(self, values: Knots) -> Knots:
        def turn(z, step):
            direction, change = jnp.where(step < 0, -1.0, 1.0), jnp.abs(step)
            z = direction * z  # mirrored to a rising signal
            rise = jnp.tanh(change - jnp.maximum(-z, 0.0))
            z = jnp.where(
                change < -z,
                z + change,
                (jnp.maximum(z, 0.0) + rise) / (1.0 + jnp.maximum(z, 0.0) * rise),
            )
            return direction * z, direction * z

        return jnp.append(0.0, jax.lax.scan(turn, jnp.zeros(()), jnp.diff(values) / self.width)[1])


def bouc_wen(
    z: Float[Array, "*n"],
    rate: Float[Array, "*n"],
    width: Float[Array, ""],
    exponent: Float[Array, ""] | float = 2.0,
    reversal: Float[Array, ""] | float = 0.5,
) -> Float[Array, "*n"]:
    """Return the time derivative of the hysteresis state, dz/dt [1/s].

        width dz/dt = ds/dt - |z|^n (b |ds/dt| sign(z) + (1 - b) ds/dt)

    This is the normalised Bouc-Wen model.

    Args:
        z: state, between minus one and one.
        rate: ds/dt, time derivative of the signal [unit of the signal/s].
        width: change of the signal over which z reverses [unit of the signal].
        exponent: n, at least one; the larger, the sharper is the bend [-].
        reversal: b, between zero and one; the larger, the rounder is a reversal [-].

    Source: Wen, J. Eng. Mech. Div. ASCE 102 (1976), pp. 249-263, with A = 1, beta = b, gamma = 1 -
    b.
    """
    power = jnp.maximum(jnp.abs(z), LEAST_STATE) ** exponent
    bend = reversal * jnp.abs(rate) * jnp.sign(z) + (1.0 - reversal) * rate
    return (rate - power * bend) / width
