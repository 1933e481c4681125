"""What the residual says: tests, statistics, prediction of records not used, and the score of absent effects."""

from .scores import Scores, score_test
from .validation import Prediction, predict

__all__ = ["Prediction", "Scores", "predict", "score_test"]
