"""What the check records say: an error in one number, how well it is known, and how well a
difference of two.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.host import to_device
from .._foundation.types import Bool, Float
from ..diagnosis.validation import Prediction
from ..estimation.coloured import score_covariance, tapered_covariance, valid_pairs


def mean_log(prediction: Prediction) -> float:
    """Mean over the channels that were seen of the logarithm of the error; infinite where the
    simulation fails.
    """
    return mean_log_of(np.asarray(prediction.rms)[seen(prediction)])


def mean_log_of(rms: Float[np.ndarray, " output"]) -> float:
    """The same of errors by channel."""
    return (
        float(np.mean(np.log(np.maximum(rms, np.finfo(float).tiny))))
        if np.all(np.isfinite(rms))
        else np.inf
    )


def seen(prediction: Prediction) -> Bool[np.ndarray, " output"]:
    """Channels of which a sample counts."""
    return np.any(np.asarray(prediction.scored), axis=(0, 1))


def of_channel(prediction: Prediction, index: int) -> Prediction:
    """A prediction of which one channel counts alone."""
    scored = np.array(prediction.scored)
    scored[..., np.arange(scored.shape[-1]) != index] = False
    return eqx.tree_at(lambda one: one.scored, prediction, to_device(scored))


def difference_error(before: Prediction, after: Prediction) -> float:
    """Standard error of the difference of two `mean_log`, whose residuals are of the same samples
    and coloured; zero where a simulation failed.

    d(log rms) = 1/(2 N) sum_i (v_i^2 / mean v^2 - 1), the sum's variance from its autocovariance
    """

    error = float(_difference_error(before, after))
    return error if np.isfinite(error) else 0.0


@eqx.filter_jit
def _difference_error(before: Prediction, after: Prediction):
    """Standard error of the difference of two `mean_log` (jitted)."""

    def influence(one: Prediction):
        v, counts = jnp.where(one.scored, one.residuals, 0.0), jnp.sum(one.scored, axis=(0, 1))
        power = jnp.where(one.rms > 0, one.rms, 1.0) ** 2  # of a channel that was seen and missed
        return 0.5 * v**2 / (power * jnp.maximum(counts, 1) * jnp.sum(counts > 0))[None, None]

    apart = jnp.sum(influence(before) - influence(after), axis=-1, keepdims=True)
    rows = jnp.any(before.scored, axis=-1, keepdims=True)
    return jnp.sqrt(score_covariance(rows[..., None] * 1.0, apart, rows)[0, 0])


def uncertainty(prediction: Prediction) -> float:
    """Standard error of `mean_log`, from the number of independent samples that the coloured
    residual amounts to.

    var(log rms) = 1/(4 N^2) sum_k 2 n_k r_k^2

    for a Gaussian residual with autocorrelation r_k, of which n_k pairs of valid samples are k
    samples apart.
    """
    return float(_uncertainty(prediction))


@eqx.filter_jit
def _uncertainty(prediction: Prediction):
    """Standard error of `mean_log` (jitted)."""
    v = jnp.where(prediction.scored, prediction.residuals, 0.0)
    count = jnp.sum(prediction.scored, axis=(0, 1))
    covariance = tapered_covariance(v, prediction.scored)
    correlation = covariance / jnp.where(covariance[:1] > 0, covariance[:1], 1.0)
    squared = jnp.sum(valid_pairs(prediction.scored) * correlation**2, axis=0)
    variance = jnp.where(count > 0, 0.5 * squared / jnp.maximum(count, 1) ** 2, 0.0)
    return jnp.sqrt(jnp.sum(variance)) / jnp.sum(count > 0)
