"""Diagnosis of a fit: residual tests, statistics, prediction, localisation."""

from .bands import Band, Bands, prediction_bands
from .frequency_response import FrequencyResponse, frequency_response
from .localise import localise_residual
from .maps import ResidualMaps, residual_maps
from .places import LocalisationResult, Place
from .residual_report import ResidualReport, analyse_residual
from .residuals import ResidualTests, residual_tests
from .statistics import FitStatistics, statistics
from .validation import Prediction, predict

__all__ = [
    "Band",
    "Bands",
    "FitStatistics",
    "FrequencyResponse",
    "LocalisationResult",
    "Place",
    "Prediction",
    "ResidualMaps",
    "ResidualReport",
    "ResidualTests",
    "analyse_residual",
    "frequency_response",
    "localise_residual",
    "predict",
    "prediction_bands",
    "residual_maps",
    "residual_tests",
    "statistics",
]
