"""`own_covariance`: covariance of the unknowns of each record, that of the shared ones included."""

import jax.numpy as jnp

from .._foundation.types import Array, Float
from .information import OwnBlock
from .spectrum import SHARE, Spectrum

# Chosen: move of an unknown by one standard error of the shared parameters, over its own standard
# error, below which the move is rounding.
ROUNDED_MOVE = 1e-6


def own_covariance(
    own: OwnBlock, svd: Spectrum, covariance: Float[Array, "parameter parameter"], threshold: float
) -> Float[Array, "case own own"]:
    """Return the covariance of each record's own unknowns; the variance of one that moves with an
    undetermined direction of the shared parameters is infinite.
    """
    known = own.covariance(jnp.where(jnp.isfinite(covariance), covariance, 0.0))
    if not covariance.size:
        return known
    moved = own.inverse @ own.coupling
    share = svd.weak_share(moved.reshape(-1, covariance.shape[0]), threshold)
    by_shared = jnp.linalg.norm(moved / svd.scale[None, None], axis=-1)
    alone = jnp.linalg.norm(own.inverse, axis=-1)
    # Rounding moves an unknown that is independent of the shared parameters.
    lost = (share.reshape(alone.shape) > SHARE) & (by_shared > ROUNDED_MOVE * alone)
    return known + jnp.where(lost, jnp.inf, 0.0)[..., None] * jnp.eye(alone.shape[-1])[None]
