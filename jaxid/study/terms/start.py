"""`Start`: maximum likelihood at the values of the regression."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ..._foundation.compiler import fast_compile_jit
from ..._foundation.types import Array, Float
from ...estimation.estimate import Case
from ...estimation.shared_programs import evaluate
from ...sensitivity.information import Information
from ...sensitivity.spectrum import spectrum

# Cited: eigenvalues below this share of the largest are not used (the report, section 4.4).
SMALLEST_EIGENVALUE = 1e-10


class Start(NamedTuple):
    """The second stage at the values of the regression, before its first step.

    Attributes:
        names: names of the estimated parameters.
        values: their starting values.
        F: `(value / standard error)^2` with the standard errors of maximum likelihood at the
            starting values.
        cost: negative log-likelihood without its constant.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " parameter"]
    F: Float[np.ndarray, " parameter"]
    cost: float


def a_priori(case: Case) -> Start:
    """Return cost and F-values at the start of maximum likelihood.

    Args:
        case: the second stage, with the values of the regression.
    """
    cost, linearised = evaluate(case, case.begin)
    values, limits = case.begin.shared, case.problem.limits
    F = _F(values, linearised.information, limits.scale)
    return Start(case.free.shared, np.asarray(values), np.asarray(F), float(cost))


@fast_compile_jit
def _F(values: Float[Array, " parameter"], information: Information, scale):
    """Return the squared values over their variances."""
    eigen = spectrum(information.triangle, information.rhs, scale)
    return values**2 / jnp.diagonal(eigen.covariance(SMALLEST_EIGENVALUE))
