"""Uncertainty of an estimate: of functions of the parameters, from fixed constants, combined."""

from .bootstrap import Bootstrap, bootstrap
from .combination import ParameterTable, combine, constrain
from .comparison import ErrorComparison, ErrorKind, compare_errors
from .curves import Curve, combine_curves, curve
from .fixed_constants import FixedConstants, consider
from .posterior import Posterior, posterior
from .profile import Profile, Shape, profile_likelihood
from .propagation import Propagated, propagate
from .sandwich import Sandwich, sandwich
from .trims import TrimPolynomial, combine_trims

__all__ = [
    "Bootstrap",
    "Curve",
    "ErrorComparison",
    "ErrorKind",
    "FixedConstants",
    "ParameterTable",
    "Posterior",
    "Profile",
    "Propagated",
    "Sandwich",
    "Shape",
    "TrimPolynomial",
    "bootstrap",
    "combine",
    "combine_curves",
    "combine_trims",
    "compare_errors",
    "consider",
    "constrain",
    "curve",
    "posterior",
    "profile_likelihood",
    "propagate",
    "sandwich",
]
