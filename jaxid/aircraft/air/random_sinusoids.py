"""Random signals of a given spectrum as sums of sinusoids with random frequencies and
amplitudes.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..._foundation.types import Array, Float


class RandomSinusoids(NamedTuple):
    """Sinusoids of random frequencies and amplitudes.

    Attributes:
        frequency: [Hz].
        width: width of the band from which each frequency is drawn [Hz].
        amplitude: independent standard normal numbers, for the cosine and the sine.
    """

    frequency: Float[Array, " sinusoid"]
    width: Float[Array, " sinusoid"]
    amplitude: Float[Array, "sinusoid 2"]


def random_sinusoids(
    key: Array, low: Float[Array, ""], high: Float[Array, ""], count: int, *, logarithmic: bool
) -> RandomSinusoids:
    """Draw one random frequency from each of the bands that divide a range, with two normal
    amplitudes.

    If each sinusoid has the power `S(f) width`, the mean spectrum of the sum is exactly S at every
    frequency of the range, since `width` is one over the probability density of f. The frequencies
    have no common period, so the signal never repeats.

    Args:
        key: a JAX random key.
        low: lower end of the range; positive if `logarithmic` [Hz].
        high: upper end [Hz].
        count: number of sinusoids.
        logarithmic: True for bands of equal ratio, False for bands of equal width.

    Returns:
        Frequencies [Hz], widths [Hz], and independent standard normal numbers, shape (sinusoid, 2).
    """
    band_key, amplitude_key = jax.random.split(key)
    share = (jnp.arange(count) + jax.random.uniform(band_key, (count,), float)) / count
    if logarithmic:
        ratio = jnp.log(high / low)
        frequency = low * jnp.exp(ratio * share)
        width = frequency * ratio / count
    else:
        frequency = low + (high - low) * share
        width = jnp.full_like(frequency, 1.0) * (high - low) / count
    return RandomSinusoids(frequency, width, jax.random.normal(amplitude_key, (count, 2), float))


def sum_of_sinusoids(
    t: Float[Array, " time"],
    frequency: Float[Array, " sinusoid"],
    cosines: Float[Array, "sinusoid signal"],
    sines: Float[Array, "sinusoid signal"],
) -> Float[Array, "time signal"]:
    """Return `sum_k c_k cos(2 pi f_k t) + s_k sin(2 pi f_k t)`.

    The sinusoids are added in a scan, which needs little memory in a batch.

    Args:
        t: sample times, in any spacing [s].
        frequency: f [Hz].
        cosines: c, a column for each signal [any unit].
        sines: s, a column for each signal [any unit].

    Returns:
        The signals, shape (time, signal).
    """

    def add(total, sinusoid):
        f, c, s = sinusoid
        angle = 2.0 * jnp.pi * f * t
        return total + jnp.cos(angle)[:, None] * c[None] + jnp.sin(angle)[:, None] * s[None], None

    total, _ = jax.lax.scan(add, jnp.zeros((t.size, cosines.shape[1])), (frequency, cosines, sines))
    return total
