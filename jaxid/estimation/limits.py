"""Bounds, sizes and priors of the free parameters as vectors."""

import equinox as eqx
import numpy as np

from .._foundation.host import on_host
from .._foundation.types import Array, Float
from ..models.base import as_float
from ..models.free import Free, Parameters


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
