"""Likelihoods, the Gauss-Newton solver with the report's eigenvalue fixes, and `estimate`."""

from .autoregressive_noise import AutoregressiveNoise, select_order
from .estimate import estimate
from .filter.filter_error import FilterError
from .filter.innovation_form import InnovationForm
from .filter.noise_options import FirstOrder, Fixed
from .filter.smoother import Smoothed, smooth_states
from .likelihoods import OutputError
from .listing import listing
from .result import Estimate
from .solver import GaussNewton
from .spectrum_policy import Clip, Damp, Plain, Truncate, TwoStep

__all__ = [
    "AutoregressiveNoise",
    "Clip",
    "Damp",
    "Estimate",
    "FilterError",
    "FirstOrder",
    "Fixed",
    "GaussNewton",
    "InnovationForm",
    "OutputError",
    "Plain",
    "Smoothed",
    "Truncate",
    "TwoStep",
    "estimate",
    "listing",
    "select_order",
    "smooth_states",
]
