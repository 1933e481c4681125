"""Likelihoods, the Gauss-Newton solver with the report's eigenvalue fixes, and `estimate`."""

from .estimate import estimate
from .likelihoods import OutputError
from .listing import listing
from .result import Estimate
from .solver import GaussNewton
from .spectrum_policy import Clip, Plain, Truncate, TwoStep

__all__ = [
    "Clip",
    "Estimate",
    "GaussNewton",
    "OutputError",
    "Plain",
    "Truncate",
    "TwoStep",
    "estimate",
    "listing",
]
