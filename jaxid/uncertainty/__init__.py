"""Uncertainty of an estimate: of functions of the parameters, from fixed constants, combined."""

from .combination import ParameterTable, combine, constrain
from .curves import Curve, combine_curves, curve
from .fixed_constants import FixedConstants, consider
from .propagation import Propagated, propagate

__all__ = [
    "Curve",
    "FixedConstants",
    "ParameterTable",
    "Propagated",
    "combine",
    "combine_curves",
    "consider",
    "constrain",
    "curve",
    "propagate",
]
