"""What the colour of a residual does to the variance of a sum over it: the Cramer-Rao bound assumes it white.

With whitened residuals `v` of autocovariance `c(k)`, estimated from themselves up to a fraction of the record and tapered by a
Parzen window, whose spectrum is positive,

    var( sum_i s_i v_i ) = sum_k c(k) sum_i s_i s_(i+k)

(Morelli & Klein, Journal of Aircraft 34(6), 1997; the window: Jenkins & Watts, Spectral Analysis, 1968, section 6.3.)
"""

import jax.numpy as jnp

from .._foundation.types import Array, Float

LONGEST_LAG = 0.2  # of the record, as Morelli & Klein use


def score_covariance(
    S: Float[Array, "case time output parameter"], v: Float[Array, "case time output"]
) -> Float[Array, "parameter parameter"]:
    """Covariance of the score `sum_i S_i' v_i` for residuals with the autocorrelation that they show.

    With white residuals of unit variance it is the information matrix.

    Args:
        S: whitened sensitivities, zero at missing samples.
        v: whitened residuals, zero at missing samples.
    """
    count = v.shape[1]
    spectrum = jnp.fft.rfft(tapered_covariance(v), axis=0).real
    frequency = jnp.arange(count + 1)
    # One-sided transform: all frequencies but the first and the last stand for two.
    twice = jnp.where((frequency == 0) | (frequency == count), 1.0, 2.0) / (2 * count)
    transformed = jnp.fft.rfft(S, 2 * count, axis=1)
    weighted = transformed * (spectrum * twice[:, None])[None, :, :, None]
    return jnp.einsum("cfjp,cfjq->pq", weighted, jnp.conj(transformed)).real


def colour_inflation(column: Float[Array, "case time output"], v: Float[Array, "case time output"]) -> Float[Array, ""]:
    """Variance of `sum column * v` relative to what white `v` of unit variance would give.

    Args:
        column: a whitened sensitivity, zero at missing samples.
        v: a whitened residual, zero at missing samples.
    """
    variance = jnp.sum(tapered_covariance(v) * _sums_of_products(column))
    length = jnp.sum(column**2)
    return jnp.where(length > 0, variance / jnp.where(length > 0, length, 1.0), 1.0)


def tapered_covariance(v: Float[Array, "case time output"]) -> Float[Array, "lag output"]:
    """Autocovariance of each channel, pooled over records, under a Parzen window; lags 0, 1, ..., -2, -1."""
    count = v.shape[1]
    valid = jnp.maximum(jnp.sum(v != 0, axis=(0, 1)), 1)
    lag = jnp.minimum(jnp.arange(2 * count), 2 * count - jnp.arange(2 * count)) / max(int(LONGEST_LAG * count), 1)
    window = jnp.where(lag <= 0.5, 1 - 6 * lag**2 * (1 - lag), 2 * jnp.clip(1 - lag, 0) ** 3)
    return _sums_of_products(v) / valid[None] * window[:, None]


def _sums_of_products(x: Float[Array, "case time output"]) -> Float[Array, "lag output"]:
    """`sum_i x_i x_(i+k)` of each channel, added up over records, by a transform that does not wrap."""
    size = 2 * x.shape[1]
    power = jnp.abs(jnp.fft.rfft(x, size, axis=1)) ** 2
    return jnp.sum(jnp.fft.irfft(power, size, axis=1), axis=0)
