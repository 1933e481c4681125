"""From a model and an input to a time history."""

from .inputs import BandLimited, Cubic, Linear, ZeroOrder
from .simulate import simulate
from .solution import Solution
from .steppers import RK4, Adaptive

__all__ = ["RK4", "Adaptive", "BandLimited", "Cubic", "Linear", "Solution", "ZeroOrder", "simulate"]
