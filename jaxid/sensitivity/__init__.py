"""Sensitivities of the output to the parameters, and the information that follows from them."""

from .information import Information
from .jacobian import value_and_jacobian
from .spectrum import Spectrum, spectrum, weak_directions

__all__ = ["Information", "Spectrum", "spectrum", "value_and_jacobian", "weak_directions"]
