"""Products of matrices with the derivatives of a matrix by all parameters, in one product each."""

import jax.numpy as jnp

from ..._foundation.types import Array, Float


def congruence(a: Float[Array, "i j"], dP: Float[Array, "j j p"]) -> Float[Array, "i i p"]:
    """Return `a dP a'` for each parameter."""
    return left_product(a, jnp.swapaxes(left_product(a, dP), 0, 1))


def left_product(a: Float[Array, "i j"], d: Float[Array, "j k p"]) -> Float[Array, "i k p"]:
    """Return `a d` for each parameter."""
    return (a @ d.reshape(d.shape[0], -1)).reshape(a.shape[0], *d.shape[1:])
