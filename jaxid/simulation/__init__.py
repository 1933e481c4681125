"""Simulation of models, equilibria, and linearisation at a point."""

from . import hold as hold
from .hold import BandLimited, Cubic, Linear, ZeroOrder
from .linearise import Linearisation, linearise
from .simulate import simulate
from .solution import Solution
from .steppers import RK4, Adaptive
from .trim import Trim, solve_equilibrium

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
    "hold",
    "linearise",
    "simulate",
    "solve_equilibrium",
]
