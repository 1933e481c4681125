"""The search for missing effects: hypotheses, moves, evidence, assessment."""

from .hypothesis import Coloured, Hypothesis, NoiseHypothesis, RandomForces, White
from .options import LoopOptions
from .outcome import Outcome
from .problem import LoopProblem
from .search_effects import EffectSearch, search_effects

__all__ = [
    "Coloured",
    "EffectSearch",
    "Hypothesis",
    "LoopOptions",
    "LoopProblem",
    "NoiseHypothesis",
    "Outcome",
    "RandomForces",
    "White",
    "search_effects",
]
