"""How the output depends on the parameters, and what that says about them."""

from .information import Information
from .jacobian import value_and_jacobian
from .spectrum import Spectrum, spectrum, weak_directions

__all__ = ["Information", "Spectrum", "spectrum", "value_and_jacobian", "weak_directions"]
