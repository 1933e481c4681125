"""Random signals of a given spectrum as sums of sinusoids with random frequencies and amplitudes."""

import jax
import jax.numpy as jnp

from .._foundation.types import Array, Float


def random_lines(
    key: Array, low: Float[Array, ""], high: Float[Array, ""], count: int, *, logarithmic: bool
) -> tuple[Float[Array, " line"], Float[Array, " line"], Float[Array, "line 2"]]:
    """A frequency drawn at random from each of the bands that divide a range, and two normal amplitudes for it.

    A line of the power `S(f) width` makes the mean spectrum of the sum exactly S at every frequency of the range, since
    `width` is one over the density with which f is drawn. No period is shared, so that the signal never repeats.

    Args:
        key: a JAX random key.
        low: lower end of the range, positive where it is logarithmic [Hz].
        high: upper end [Hz].
        count: number of lines.
        logarithmic: whether the bands are of one ratio, else of one width.

    Returns:
        Frequencies [Hz], widths [Hz], and independent standard normal numbers, shape (line, 2).
    """
    place, strength = jax.random.split(key)
    share = (jnp.arange(count) + jax.random.uniform(place, (count,), float)) / count
    if logarithmic:
        ratio = jnp.log(high / low)
        frequency = low * jnp.exp(ratio * share)
        width = frequency * ratio / count
    else:
        frequency = low + (high - low) * share
        width = jnp.full_like(frequency, 1.0) * (high - low) / count
    return frequency, width, jax.random.normal(strength, (count, 2), float)


def sum_of_lines(
    t: Float[Array, " time"],
    frequency: Float[Array, " line"],
    cosines: Float[Array, "line signal"],
    sines: Float[Array, "line signal"],
) -> Float[Array, "time signal"]:
    """`sum_k c_k cos(2 pi f_k t) + s_k sin(2 pi f_k t)`, one line after the other, so that memory stays small in a batch.

    Args:
        t: sample times, in any spacing [s].
        frequency: f [Hz].
        cosines: c, a column for each signal [any unit].
        sines: s, likewise.

    Returns:
        The signals, shape (time, signal).
    """

    def add(total, line):
        f, c, s = line
        angle = 2.0 * jnp.pi * f * t
        return total + jnp.cos(angle)[:, None] * c[None] + jnp.sin(angle)[:, None] * s[None], None

    total, _ = jax.lax.scan(add, jnp.zeros((t.size, cosines.shape[1])), (frequency, cosines, sines))
    return total
