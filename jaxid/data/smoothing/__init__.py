"""Smoothing and differentiation of sampled signals."""

from .fourier import Fourier
from .method import AbstractSmoother, Smoothed
from .polynomial import LocalPolynomial
from .smooth import differentiate, smooth
from .spline import SmoothingSpline

__all__ = [
    "AbstractSmoother",
    "Fourier",
    "LocalPolynomial",
    "Smoothed",
    "SmoothingSpline",
    "differentiate",
    "smooth",
]
