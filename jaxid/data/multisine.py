"""Multisines: orthogonal inputs for one manoeuvre. Each harmonic belongs to one input."""

import math

import jax.numpy as jnp

from .._foundation.checks import require
from .._foundation.types import Array, Float


def multisine(
    t: Float[Array, "*time"],
    period: float | int,
    low: float | int,
    high: float | int,
    *,
    count: int = 1,
    amplitude: Array | float | int = 1.0,
) -> Float[Array, "*time {count}"]:
    """Sums of sines of equal power on the harmonics of one period, one sum per input.

    Input `j` has every `count`-th harmonic `k` of the band, the amplitudes `A_i = a / sqrt(K)` and
    Schroeder's phases, which give a low peak factor for a flat spectrum:

        `u_j(t) = sum_i A_i cos(2 pi k_i t / T + phi_i)`,  `phi_i = -pi i (i - 1) / K`,  `i = 1..K`

    Over a whole number of periods the inputs are orthogonal, so that one manoeuvre excites all of
    them at once.

    Source: M. R. Schroeder, Synthesis of low-peak-factor signals and binary sequences with low
    autocorrelation, IEEE Trans. Information Theory 16(1), 1970, for the phases; V. Klein, E. A.
    Morelli, Aircraft System Identification, AIAA, 2006, chapter 9, for the use on several surfaces
    at once.

    Args:
        t: times, of any shape [s].
        period: the period `T` [s].
        low: lowest frequency [Hz].
        high: highest frequency, below half the sample rate [Hz].
        count: number of inputs.
        amplitude: `a`; the root mean square of each input over a period is `a / sqrt(2)` [any
            unit].

    Returns:
        The inputs, shape (*time, count) [the amplitude's unit].

    Raises:
        InputError: when the band has fewer harmonics of the period than inputs.
    """
    require(
        period > 0 and count >= 1,
        f"Period {period} s, {count} inputs: give a positive period and at least one input.",
    )
    harmonics = _harmonics(period, low, high)
    require(
        len(harmonics) >= count,
        f"From {low} to {high} Hz a period of {period} s has {len(harmonics)} harmonics for "
        f"{count} inputs. Lengthen the period or widen the band.",
    )
    return jnp.stack(
        [_sum(t, period, harmonics[j::count], amplitude) for j in range(count)], axis=-1
    )


def _harmonics(period: float | int, low: float | int, high: float | int) -> list[int]:
    """Multiples of the fundamental frequency in the band, without zero."""
    # The tolerance of 1e-6 (chosen) keeps a harmonic at an end of the band in spite of rounding.
    first, last = math.ceil(low * period - 1e-6), math.floor(high * period + 1e-6)
    return list(range(max(first, 1), last + 1))


def _sum(
    t: Array, period: float | int, harmonics: list[int], amplitude: Array | float | int
) -> Array:
    """One input: the sum of its cosines with Schroeder's phases."""
    total = len(harmonics)
    shape = (1,) * t.ndim + (total,)
    i = jnp.arange(1.0, total + 1).reshape(shape)
    k = jnp.array(harmonics, float).reshape(shape)
    angles = 2 * jnp.pi * k * t[..., None] / period - jnp.pi * i * (i - 1) / total
    return amplitude / total**0.5 * jnp.cos(angles).sum(axis=-1)
