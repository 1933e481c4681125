"""What the residual says: tests, statistics, prediction of records not used, and the score of absent effects."""

from .residuals import ResidualTests, residual_tests
from .scores import Scores, score_test
from .statistics import FitStatistics, statistics
from .validation import Prediction, predict

__all__ = [
    "FitStatistics",
    "Prediction",
    "ResidualTests",
    "Scores",
    "predict",
    "residual_tests",
    "score_test",
    "statistics",
]
