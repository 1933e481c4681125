"""What the residual says: tests, statistics, prediction of records not used, and the score of absent effects."""

from .bands import Band, Bands, bands
from .maps import ResidualMaps, residual_maps
from .reading import Reading, read
from .residuals import ResidualTests, residual_tests
from .scores import Scores
from .statistics import FitStatistics, statistics
from .validation import Prediction, predict
from .where import Place, Where, where

__all__ = [
    "Band",
    "Bands",
    "FitStatistics",
    "Place",
    "Prediction",
    "Reading",
    "ResidualMaps",
    "ResidualTests",
    "Scores",
    "Where",
    "bands",
    "predict",
    "read",
    "residual_maps",
    "residual_tests",
    "statistics",
    "where",
]
