"""Model structure determination: regression, criteria, and selection of subsets of terms."""

from .errors_in_variables import instrumental_variables, total_least_squares
from .exchange import best_subsets
from .least_squares import least_squares, regress, with_coloured_errors
from .options import REPORT, Direction, SubsetOptions
from .orthogonal import OrthogonalFunctions, orthogonal_functions
from .problem import Problem, prepare
from .regression import Regression, strong_terms
from .regressors import columns
from .resampling import Stability, stability
from .rules import AbstractRule, CrossValidation, FirstMaximumF, LastStep, MaximumF, Minimum, choose
from .selection import Action, Selection, Step
from .stepwise import stepwise, stepwise_each
from .weak_form import WeakForm, weak_form

__all__ = [
    "REPORT",
    "AbstractRule",
    "Action",
    "CrossValidation",
    "Direction",
    "FirstMaximumF",
    "LastStep",
    "MaximumF",
    "Minimum",
    "OrthogonalFunctions",
    "Problem",
    "Regression",
    "Selection",
    "Stability",
    "Step",
    "SubsetOptions",
    "WeakForm",
    "best_subsets",
    "choose",
    "columns",
    "instrumental_variables",
    "least_squares",
    "orthogonal_functions",
    "prepare",
    "regress",
    "stability",
    "stepwise",
    "stepwise_each",
    "strong_terms",
    "total_least_squares",
    "weak_form",
    "with_coloured_errors",
]
