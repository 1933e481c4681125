"""Bounds, sizes and priors of the free parameters as vectors."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.host import on_host
from .._foundation.types import Array, Float
from ..models.base import as_float
from ..models.free import Free, Parameters

# Distance from a bound that is due to rounding, relative to the larger of the parameter and the
# bound (derived: eight times the spacing of float64 numbers at one).
ROUNDING = 8 * float(np.finfo(np.float64).eps)


class Limits(eqx.Module):
    """Bounds, typical sizes (`scale`) and Gaussian priors as vectors.

    Without a bound or prior, the bound or the standard deviation of the prior (`prior_deviation`)
    is infinite. An unknown size is NaN.
    """

    lower: Parameters
    upper: Parameters
    scale: Float[Array, " parameter"]
    prior_mean: Float[Array, " parameter"]
    prior_deviation: Float[Array, " parameter"]

    @classmethod
    def of(cls, free: Free, n_cases: int) -> "Limits":
        """Return the limits of the free parameters, those per record repeated `n_cases` times."""

        @on_host
        def repeated(xp, vector):
            return xp.broadcast_to(vector, (n_cases, vector.size))

        shared, per_record = free.bounds("shared"), free.bounds("per_record")
        priors = [free.prior.get(name, (0.0, np.inf)) for name in free.shared]
        return cls(
            Parameters(shared[0], repeated(per_record[0])),
            Parameters(shared[1], repeated(per_record[1])),
            as_float([free.scale.get(name, np.nan) for name in free.shared]),
            as_float([mean for mean, _ in priors]),
            as_float([deviation for _, deviation in priors]),
        )


def within_bounds(value, low, high, inverse_error, near: float):
    """Return the nearest values within bounds; one within rounding of a bound is set to it.

    Args:
        value, low, high: values and bounds.
        inverse_error: reciprocals of standard errors.
        near: distance in standard errors within which a value is set to its bound.
    """
    for bound in (low, high):
        finite = jnp.isfinite(bound)
        distance = jnp.abs(value - jnp.where(finite, bound, 0.0))
        rounding = ROUNDING * jnp.maximum(jnp.abs(value), jnp.where(finite, jnp.abs(bound), 0.0))
        close = (distance <= rounding) | (distance * inverse_error < near)
        value = jnp.where(finite & close, bound, value)
    return jnp.clip(value, low, high)
