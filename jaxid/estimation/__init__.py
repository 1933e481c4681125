"""Likelihoods, the Gauss-Newton solver with the report's eigenvalue fixes, and `estimate`."""

from .autoregressive_noise import AutoregressiveNoise, select_order
from .estimate import estimate
from .filter_error import FilterError
from .innovation_form import InnovationForm
from .likelihoods import OutputError
from .listing import listing
from .noise_options import FirstOrder, Fixed
from .result import Estimate
from .smoother import Smoothed, smooth_states
from .solver import GaussNewton
from .spectrum_policy import Clip, Plain, Truncate, TwoStep

__all__ = [
    "AutoregressiveNoise",
    "Clip",
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
