"""Error of held-out records as one number, its standard error, and that of a difference."""

import jax.numpy as jnp
import numpy as np

from .._foundation.compiler import fast_compile_jit
from .._foundation.types import Bool, Float
from ..estimation.coloured import score_covariance, tapered_covariance, valid_pairs
from .validation import Prediction


def mean_log(prediction: Prediction) -> float:
    """Return the mean over the observed channels of the logarithm of the error; infinite if the
    simulation fails.
    """
    return mean_log_of(np.asarray(prediction.rms)[observed_channels(prediction)])


def mean_log_of(rms: Float[np.ndarray, " output"]) -> float:
    """Return the mean logarithm of errors by channel; infinite if one is not finite."""
    return (
        float(np.mean(np.log(np.maximum(rms, np.finfo(float).tiny))))
        if np.all(np.isfinite(rms))
        else np.inf
    )


def observed_channels(prediction: Prediction) -> Bool[np.ndarray, " output"]:
    """Return a mask of the channels with a scored sample."""
    return np.any(np.asarray(prediction.scored), axis=(0, 1))


def difference_error(before: Prediction, after: Prediction) -> float:
    """Return the standard error of the difference of two `mean_log` of the same samples, with
    coloured residuals; zero if a simulation failed.

    d(log rms) = 1/(2 N) sum_i (v_i^2 / mean v^2 - 1), the sum's variance from its autocovariance
    """

    error = float(_difference_error(before.anonymous(), after.anonymous()))
    return error if np.isfinite(error) else 0.0


@fast_compile_jit
def _difference_error(before: Prediction, after: Prediction):
    """Standard error of the difference of two `mean_log` (jitted)."""

    def influence(prediction: Prediction):
        v = jnp.where(prediction.scored, prediction.residuals, 0.0)
        counts, rms = jnp.sum(prediction.scored, axis=(0, 1)), prediction.rms
        power = jnp.where(rms > 0, rms, 1.0) ** 2
        return 0.5 * v**2 / (power * jnp.maximum(counts, 1) * jnp.sum(counts > 0))[None, None]

    apart = jnp.sum(influence(before) - influence(after), axis=-1, keepdims=True)
    rows = jnp.any(before.scored, axis=-1, keepdims=True)
    return jnp.sqrt(score_covariance(rows[..., None] * 1.0, apart, rows)[0, 0])


def uncertainty(prediction: Prediction) -> float:
    """Return the standard error of `mean_log`, from the effective number of samples of a coloured
    residual.

    var(log rms) = 1/(4 N^2) sum_k 2 n_k r_k^2

    for a Gaussian residual with autocorrelation r_k and n_k pairs of valid samples that are k
    samples apart.
    """
    return float(_uncertainty(prediction.anonymous()))


@fast_compile_jit
def _uncertainty(prediction: Prediction):
    """Standard error of `mean_log` (jitted)."""
    v = jnp.where(prediction.scored, prediction.residuals, 0.0)
    count = jnp.sum(prediction.scored, axis=(0, 1))
    covariance = tapered_covariance(v, prediction.scored)
    correlation = covariance / jnp.where(covariance[:1] > 0, covariance[:1], 1.0)
    squared = jnp.sum(valid_pairs(prediction.scored) * correlation**2, axis=0)
    variance = jnp.where(count > 0, 0.5 * squared / jnp.maximum(count, 1) ** 2, 0.0)
    return jnp.sqrt(jnp.sum(variance)) / jnp.sum(count > 0)
