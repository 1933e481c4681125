"""Likelihoods, the Gauss-Newton solver with the report's eigenvalue fixes, and `estimate`."""

from .estimate import estimate
from .likelihoods import OutputError
from .policies import Clip, Plain, Truncate, TwoStep
from .result import Estimate
from .solver import GaussNewton

__all__ = ["Clip", "Estimate", "GaussNewton", "OutputError", "Plain", "Truncate", "TwoStep", "estimate"]
