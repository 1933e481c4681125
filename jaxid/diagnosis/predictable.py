"""How much of a residual its own past predicts: what is left above noise when R itself was estimated."""

import jax.numpy as jnp

from .._foundation.types import Array, Bool, Float
from .validation import root_mean_square

ORDER = 10  # past samples that predict


def allowance(count: int) -> float:
    """What the share of white noise of a given number of samples exceeds with a probability of one in a thousand.

    With no memory in the noise, `count` times the share is chi-square with `ORDER` degrees of freedom, whose 99.9 %
    point is 29.6; `predictable_share` has taken off its mean, 10.
    """
    return 19.6 / count


def predictable_share(
    v: Float[Array, "case time output"], mask: Bool[Array, "case time output"]
) -> Float[Array, " output"]:
    """Share of each channel's residual power that a linear prediction from its own past explains.

        v_i = sum_k a_k v_(i-k) + e_i,    share = 1 - E e^2 / E v^2, corrected for the number of coefficients

    by the Yule-Walker equations on the pooled autocovariance, each lag's sum over the number of all samples: over that of its own
    pairs it were no autocovariance of anything, and a smooth residual of few samples could pass for noise. Near zero for white
    noise. (Box & Jenkins, sections 2.1.5 and 3.2.)

    Args:
        v: residuals.
        mask: valid samples.
    """
    v, order = jnp.where(mask, v, 0.0), min(ORDER, v.shape[1] - 1)
    c = jnp.stack([jnp.sum(v[:, lag:] * v[:, : v.shape[1] - lag], axis=(0, 1)) for lag in range(order + 1)])
    r = c / jnp.where(c[0] > 0, c[0], 1.0)[None]
    toeplitz = r[jnp.abs(jnp.arange(order)[:, None] - jnp.arange(order)[None])]
    ridge = 1e-9 * jnp.eye(order)[:, :, None]
    a = jnp.linalg.solve(jnp.moveaxis(toeplitz + ridge, -1, 0), jnp.moveaxis(r[1:], -1, 0)[..., None])[..., 0]
    explained = jnp.sum(a * r[1:].T, axis=-1)
    count = jnp.maximum(jnp.sum(mask, axis=(0, 1)), order + 2)
    return jnp.clip(1.0 - (1.0 - explained) * count / (count - order), 0.0)


def white_part(v: Float[Array, "case time output"], mask: Bool[Array, "case time output"]) -> Float[Array, " output"]:
    """Variance of what is white in each channel, whatever else is in it that is slow; from third differences.

        var(v_(k+3) - 3 v_(k+2) + 3 v_(k+1) - v_k) = (1 + 9 + 9 + 1) var(v)        of white v

    Of the power of a sinusoid at a tenth of the sampling rate they leave 0.3 per cent. Where a channel has no four valid
    samples in a row it is the mean square.

    Args:
        v: residuals, zero where there is no valid sample.
        mask: where samples are valid.
    """
    third = v[:, 3:] - 3.0 * v[:, 2:-1] + 3.0 * v[:, 1:-2] - v[:, :-3]
    whole = mask[:, 3:] & mask[:, 2:-1] & mask[:, 1:-2] & mask[:, :-3]
    fast = root_mean_square(third, whole) ** 2 / 20.0
    return jnp.where(jnp.any(whole, axis=(0, 1)), fast, root_mean_square(v, mask) ** 2)
