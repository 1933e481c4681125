"""Models: abstract base class, free parameters, polynomials, tables, linear and noise models."""

from .base import AbstractModel
from .errors import EstimateErrors
from .free import Free, Parameters, free, with_values
from .linear import LinearModel
from .names import parameter_names
from .noise import DiagonalNoise, FixedNoise, FullNoise
from .polynomial import Polynomial
from .replace import polynomials_of, with_polynomials
from .robust_noise import HuberNoise, StudentNoise
from .saving import Saved, load, save
from .table_set import TableSet
from .tables import Extrapolation, Interpolation, Table, range_violations, require_inside

__all__ = [
    "AbstractModel",
    "DiagonalNoise",
    "EstimateErrors",
    "Extrapolation",
    "FixedNoise",
    "Free",
    "FullNoise",
    "HuberNoise",
    "Interpolation",
    "LinearModel",
    "Parameters",
    "Polynomial",
    "Saved",
    "StudentNoise",
    "Table",
    "TableSet",
    "free",
    "load",
    "parameter_names",
    "polynomials_of",
    "range_violations",
    "require_inside",
    "save",
    "with_polynomials",
    "with_values",
]
