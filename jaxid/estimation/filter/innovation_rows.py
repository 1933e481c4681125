"""Rows of misfit of a filter, and of their sensitivities, from innovations and covariances.

With `B = L L'`, `w = L^-1 v`, the rows of a sample are `w` and `vec(I - w w')/sqrt(2)`, without the
repeated ones; of their sensitivities `L^-1 dv` and `vec(L^-1 dB L^-T)/sqrt(2)`.
"""

import jax.numpy as jnp
import numpy as np

from ..._foundation.types import Array, Bool, Float


def innovation_rows(
    v: Float[Array, "time output"],
    inverse: Float[Array, "time output output"],
    mask: Bool[Array, "time output"],
) -> Float[Array, "time row"]:
    """Return the rows of `InnovationNoise`.

    Args:
        v: innovations.
        inverse: inverses of the Cholesky factors of their covariances.
        mask: valid samples.
    """
    w = jnp.einsum("tij,tj->ti", inverse, v)
    both = mask[:, :, None] & mask[:, None]
    spread = jnp.where(both, jnp.eye(v.shape[-1])[None] - w[:, :, None] * w[:, None, :], 0.0)
    log_det = -jnp.sum(jnp.log(jnp.diagonal(inverse, axis1=-2, axis2=-1)), axis=-1)
    return jnp.concatenate([w, pairs(spread[..., None])[..., 0], log_det[:, None], v], axis=-1)


def white_rows(
    dy: Float[Array, "*sample output column"], dB: Float[Array, "*sample output output column"]
) -> Float[Array, "*sample row column"]:
    """Return minus the derivatives of `w` and `vec(I - w w')/sqrt(2)`, without the repeated ones,
    that stand in the information.

    Args:
        dy: derivatives `L^-1 dy` of the predicted outputs.
        dB: derivatives `L^-1 dB L^-T` of the covariances of the innovations.
    """
    return jnp.concatenate([dy, -pairs(dB)], axis=-2)


def pairs(
    symmetric: Float[Array, "*sample output output column"],
) -> Float[Array, "*sample pair column"]:
    """Return the weighted upper triangles of symmetric matrices, `vec(.)/sqrt(2)` without
    repeats.
    """
    first, second = np.triu_indices(symmetric.shape[-2])
    weight = np.where(first == second, np.sqrt(0.5), 1.0)
    upper = symmetric[..., first, second, :]
    return upper * weight.reshape((1,) * (upper.ndim - 2) + (-1, 1))
