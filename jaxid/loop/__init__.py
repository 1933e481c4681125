"""The search for missing effects: hypotheses, moves, evidence, assessment."""

from .hypothesis import Coloured, Hypothesis, NoiseHypothesis, RandomForces, White
from .problem import LoopProblem, SearchOptions
from .search_effects import EffectSearch, search_effects

__all__ = [
    "Coloured",
    "EffectSearch",
    "Hypothesis",
    "LoopProblem",
    "NoiseHypothesis",
    "RandomForces",
    "SearchOptions",
    "White",
    "search_effects",
]
