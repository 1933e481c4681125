"""Share of a residual that its own past predicts, a test of the noise if R itself is estimated."""

import jax.numpy as jnp

from .._foundation.compiler import fast_compile_jit
from .._foundation.types import Array, Bool, Float
from .thresholds import CHANCE_LEVEL, ORDER
from .validation import root_mean_square


def chance_level(count: int) -> float:
    """Return the share that white noise of `count` samples exceeds with probability 0.001.

    For white noise, `count` times the share is chi-square with `ORDER` degrees of freedom, whose
    99.9 % point is 29.6; `autoregressive_r2` subtracts its mean, 10.
    """
    return CHANCE_LEVEL / count


@fast_compile_jit
def autoregressive_r2(
    v: Float[Array, "case time output"], mask: Bool[Array, "case time output"]
) -> Float[Array, " output"]:
    """Return the share of each channel's residual power explained by an autoregression.

        v_i = sum_k a_k v_(i-k) + e_i,    share = 1 - E e^2 / E v^2

    corrected for the number of coefficients. The Yule-Walker equations use the pooled
    autocovariance, where the sum of each lag is divided by the number of all samples: divided by
    the number of pairs it need not be positive definite, and a smooth residual of few samples could
    pass for noise. The share is near zero for white noise. (Box & Jenkins, sections 2.1.5 and 3.2.)

    Args:
        v: residuals.
        mask: valid samples.
    """
    v, order = jnp.where(mask, v, 0.0), min(ORDER, v.shape[1] - 1)
    c = jnp.stack(
        [jnp.sum(v[:, lag:] * v[:, : v.shape[1] - lag], axis=(0, 1)) for lag in range(order + 1)]
    )
    r = c / jnp.where(c[0] > 0, c[0], 1.0)[None]
    toeplitz = r[jnp.abs(jnp.arange(order)[:, None] - jnp.arange(order)[None])]
    ridge = 1e-9 * jnp.eye(order)[:, :, None]
    a = jnp.linalg.solve(
        jnp.moveaxis(toeplitz + ridge, -1, 0), jnp.moveaxis(r[1:], -1, 0)[..., None]
    )[..., 0]
    explained = jnp.sum(a * r[1:].T, axis=-1)
    count = jnp.maximum(jnp.sum(mask, axis=(0, 1)), order + 2)
    return jnp.clip(1.0 - (1.0 - explained) * count / (count - order), 0.0)


@fast_compile_jit
def white_noise_variance(
    v: Float[Array, "case time output"], mask: Bool[Array, "case time output"]
) -> Float[Array, " output"]:
    """Return the variance of the white part of each channel, from third differences.

        var(v_(k+3) - 3 v_(k+2) + 3 v_(k+1) - v_k) = (1 + 9 + 9 + 1) var(v)        of white v

    Slow components hardly contribute: 0.3 % of the power of a sinusoid at a tenth of the sampling
    rate remains. A channel without four valid samples in a row gets its mean square.

    Args:
        v: residuals, zero where there is no valid sample.
        mask: valid samples.
    """
    third = v[:, 3:] - 3.0 * v[:, 2:-1] + 3.0 * v[:, 1:-2] - v[:, :-3]
    complete = mask[:, 3:] & mask[:, 2:-1] & mask[:, 1:-2] & mask[:, :-3]
    fast = root_mean_square(third, complete) ** 2 / 20.0
    return jnp.where(jnp.any(complete, axis=(0, 1)), fast, root_mean_square(v, mask) ** 2)
