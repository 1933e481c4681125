"""Variance of a weighted sum of a coloured residual; the Cramer-Rao bound assumes a white one.

The autocovariance `c(k)` of the whitened residuals `v` is estimated from the residuals themselves,
with `m` one where a sample is valid and zero elsewhere:

    c(k) = w(k) sum_i m_i v_i m_(i+k) v_(i+k) / sum_i m_i m_(i+k),
    var( sum_i s_i v_i ) = sum_k c(k) sum_i s_i s_(i+k)

Each lag is divided by its number of pairs of valid samples, so that gaps do not make it smaller.
The Parzen window `w` ends at a fifth of the record. Division by pairs does not keep the spectrum
positive, so negative parts of the spectrum are set to zero: no variance is negative. (Morelli &
Klein, Journal of Aircraft 34(6), 1997; the window: Jenkins & Watts, Spectral Analysis, 1968,
section 6.3; pairs in place of samples where there are gaps: Parzen, Sankhya A 25, 1963.)
"""

import jax.numpy as jnp

from .._foundation.types import Array, Bool, Float

LONGEST_LAG = 0.2  # of the span of a channel's valid samples (Morelli & Klein)


def score_covariance(
    S: Float[Array, "case time output parameter"],
    v: Float[Array, "case time output"],
    mask: Bool[Array, "case time output"],
) -> Float[Array, "parameter parameter"]:
    """Return the covariance of the score `sum_i S_i' v_i` under the residuals' autocorrelation.

    For white residuals of unit variance it equals the information matrix. It is positive
    semidefinite.

    Args:
        S: whitened sensitivities, zero at missing samples.
        v: whitened residuals, zero at missing samples.
        mask: valid samples.
    """
    return score_covariance_under(S, tapered_covariance(v, mask))


def score_covariance_under(
    S: Float[Array, "case time output parameter"], covariance: Float[Array, "lag output"]
) -> Float[Array, "parameter parameter"]:
    """Return the covariance of the score for a given autocovariance of the residuals.

    The covariance of several records is the sum over the records.

    Args:
        S: whitened sensitivities, zero at missing samples.
        covariance: autocovariance of each channel, from `tapered_covariance`.
    """
    count = S.shape[1]
    spectrum = jnp.fft.rfft(covariance, axis=0).real
    frequency = jnp.arange(count + 1)
    # One-sided transform: every frequency except the first and the last represents two.
    twice = jnp.where((frequency == 0) | (frequency == count), 1.0, 2.0) / (2 * count)
    transformed = jnp.fft.rfft(S, 2 * count, axis=1)
    weighted = transformed * (spectrum * twice[:, None])[None, :, :, None]
    return jnp.einsum("cfjp,cfjq->pq", weighted, jnp.conj(transformed)).real


def tapered_covariance(
    v: Float[Array, "case time output"], mask: Bool[Array, "case time output"]
) -> Float[Array, "lag output"]:
    """Return the autocovariance of each channel, pooled over records, with a Parzen window.

    The order of the lags is 0, 1, ..., -2, -1.

    Args:
        v: residuals, zero at missing samples.
        mask: valid samples.

    Returns:
        Autocovariance; the lags are the first axis, twice as many as the samples. Its Fourier
        transform is not negative.
    """
    count = v.shape[1]
    lag = jnp.minimum(jnp.arange(2 * count), 2 * count - jnp.arange(2 * count))
    lag = lag[:, None] / jnp.maximum(jnp.floor(LONGEST_LAG * _span(mask)), 1.0)[None]
    window = jnp.where(lag <= 0.5, 1 - 6 * lag**2 * (1 - lag), 2 * jnp.clip(1 - lag, 0) ** 3)
    covariance = _sums_of_products(v) / jnp.maximum(valid_pairs(mask), 1.0) * window
    spectrum = jnp.maximum(jnp.fft.rfft(covariance, axis=0).real, 0.0)
    return jnp.fft.irfft(spectrum, 2 * count, axis=0)


def valid_pairs(mask: Bool[Array, "case time output"]) -> Float[Array, "lag output"]:
    """Return the number of pairs of valid samples of each channel, summed over all records.

    The lags are those of `tapered_covariance`.
    """
    return jnp.round(_sums_of_products(mask * 1.0))


def _span(mask: Bool[Array, "case time output"]) -> Float[Array, " output"]:
    """Return the largest span over the records of each channel [samples].

    The span runs from the first to the last valid sample.
    """
    count = mask.shape[1]
    first, last = jnp.argmax(mask, axis=1), count - jnp.argmax(mask[:, ::-1], axis=1)
    return jnp.max(jnp.where(jnp.any(mask, axis=1), last - first, 0), axis=0) * 1.0


def _sums_of_products(x: Float[Array, "case time output"]) -> Float[Array, "lag output"]:
    """Return `sum_i x_i x_(i+k)` of each channel, summed over records.

    The Fourier transform is padded to twice the length, so that the products do not wrap.
    """
    size = 2 * x.shape[1]
    power = jnp.abs(jnp.fft.rfft(x, size, axis=1)) ** 2
    return jnp.sum(jnp.fft.irfft(power, size, axis=1), axis=0)
