"""Output sensitivities by forward-mode differentiation, in place of Eq. 4.6 to 4.9.

Forward mode suits few parameters and many samples.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from .._foundation.types import Array, Float


def value_and_jacobian(
    function: Callable[[Float[Array, " parameter"]], Float[Array, "..."]],
    theta: Float[Array, " parameter"],
) -> tuple[Float[Array, "..."], Float[Array, "... parameter"]]:
    """Return the value of a function and its Jacobian, all columns in one pass.

        S = d function / d theta

    Works through `lax.scan` and through diffrax with `ForwardMode`, whatever stepper made the
    simulation.

    Args:
        function: from a vector of parameters to an array.
        theta: where to differentiate.

    Returns:
        The value, and the Jacobian with the parameter as last axis.
    """
    if theta.size == 0:
        value = function(theta)
        return value, jnp.zeros((*value.shape, 0))

    def push(direction):
        return jax.jvp(function, (theta,), (direction,))

    return jax.vmap(push, out_axes=(None, -1))(jnp.eye(theta.size))
