"""Random signals of a given spectrum as sums of sinusoids with random frequencies and
amplitudes.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..._foundation.types import Array, Float


class RandomLines(NamedTuple):
    """Sinusoids of random frequencies and amplitudes.

    Attributes:
        frequency: [Hz].
        width: width of the band from which each frequency is drawn [Hz].
        amplitude: independent standard normal numbers, for the cosine and the sine.
    """

    frequency: Float[Array, " line"]
    width: Float[Array, " line"]
    amplitude: Float[Array, "line 2"]


def random_lines(
    key: Array, low: Float[Array, ""], high: Float[Array, ""], count: int, *, logarithmic: bool
) -> RandomLines:
    """Draw one random frequency from each of the bands that divide a range, with two normal
    amplitudes.

    If each line has the power `S(f) width`, the mean spectrum of the sum is exactly S at every
    frequency of the range, since `width` is one over the probability density of f. The frequencies
    have no common period, so the signal never repeats.

    Args:
        key: a JAX random key.
        low: lower end of the range; positive if `logarithmic` [Hz].
        high: upper end [Hz].
        count: number of lines.
        logarithmic: True for bands of equal ratio, False for bands of equal width.

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
    return RandomLines(frequency, width, jax.random.normal(strength, (count, 2), float))


def sum_of_lines(
    t: Float[Array, " time"],
    frequency: Float[Array, " line"],
    cosines: Float[Array, "line signal"],
    sines: Float[Array, "line signal"],
) -> Float[Array, "time signal"]:
    """Return `sum_k c_k cos(2 pi f_k t) + s_k sin(2 pi f_k t)`.

    The lines are added in a scan, which needs little memory in a batch.

    Args:
        t: sample times, in any spacing [s].
        frequency: f [Hz].
        cosines: c, a column for each signal [any unit].
        sines: s, a column for each signal [any unit].

    Returns:
        The signals, shape (time, signal).
    """

    def add(total, line):
        f, c, s = line
        angle = 2.0 * jnp.pi * f * t
        return total + jnp.cos(angle)[:, None] * c[None] + jnp.sin(angle)[:, None] * s[None], None

    total, _ = jax.lax.scan(add, jnp.zeros((t.size, cosines.shape[1])), (frequency, cosines, sines))
    return total
