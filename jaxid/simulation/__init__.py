"""From a model and an input to a time history; equilibria, and the linear model at a point."""

from .inputs import BandLimited, Cubic, Linear, ZeroOrder
from .linearise import Linearisation, linearise
from .simulate import simulate
from .solution import Solution
from .steppers import RK4, Adaptive
from .trim import Trim, balance

__all__ = [
    "RK4",
    "Adaptive",
    "BandLimited",
    "Cubic",
    "Linear",
    "Linearisation",
    "Solution",
    "Trim",
    "ZeroOrder",
    "balance",
    "linearise",
    "simulate",
]
