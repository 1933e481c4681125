"""Covariance of the estimate when the residual is coloured: the Cramer-Rao bound assumes it white and is then too small."""

import jax.numpy as jnp

from .._foundation.types import Array, Float


def score_covariance(
    S: Float[Array, "case time output parameter"], v: Float[Array, "case time output"], fraction: float = 0.2
) -> Float[Array, "parameter parameter"]:
    r"""Covariance of the score `sum_i S_i' v_i` for residuals with the autocorrelation that they show.

        B = sum_j sum_k c_j(k) sum_i S_ij S_(i+k)j',    c_j(k) = 1/N sum_i v_ij v_(i+k)j

    with lags up to a fraction of the record under a Parzen window, which keeps B positive. With white residuals B is the
    information matrix. (Morelli & Klein, Journal of Aircraft 34(6), 1997; Klein & Morelli, Aircraft System Identification,
    section 6.3.)

    Args:
        S: whitened sensitivities, zero at missing samples.
        v: whitened residuals, zero at missing samples.
        fraction: longest lag, as a share of the record.
    """
    count = v.shape[1]
    size = 2 * count
    spectrum_v = jnp.abs(jnp.fft.rfft(v, size, axis=1)) ** 2
    covariance = jnp.sum(jnp.fft.irfft(spectrum_v, size, axis=1), axis=0)
    valid = jnp.maximum(jnp.sum(v != 0, axis=(0, 1)), 1)
    lag = jnp.minimum(jnp.arange(size), size - jnp.arange(size)) / max(int(fraction * count), 1)
    window = jnp.where(lag <= 0.5, 1 - 6 * lag**2 * (1 - lag), 2 * jnp.clip(1 - lag, 0) ** 3)
    weight = jnp.fft.rfft(covariance / valid * window[:, None], axis=0).real
    spectrum_S = jnp.fft.rfft(S, size, axis=1)
    # One-sided transform: all frequencies but the first and the last stand for two.
    twice = jnp.where((jnp.arange(weight.shape[0]) == 0) | (jnp.arange(weight.shape[0]) == count), 1.0, 2.0) / size
    weighted = spectrum_S * (weight * twice[:, None])[None, :, :, None]
    return jnp.einsum("cfjp,cfjq->pq", weighted, jnp.conj(spectrum_S)).real
