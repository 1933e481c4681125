"""`Way`: the rounds that a search has gone, and where they ended."""

from collections.abc import Collection
from typing import NamedTuple

from .fit import Fitted
from .rounds import Round


class Way(NamedTuple):
    """Where a search ended, and how it came there.

    Attributes:
        fitted: the last fit.
        rounds: all of them.
        worth: of the fit after each round, as `Judge.worth` has it.
    """

    fitted: Fitted
    rounds: tuple[Round, ...]
    worth: tuple[float, ...]

    def holds(self, effects: Collection[str]) -> bool:
        """Whether it has gone on from these effects."""
        return any(set(effects) == set(one.effects) for one in self.rounds if one.effects)

    def is_ahead_of(self, worth: tuple[float, ...]) -> bool:
        """Whether it was worth more after as many rounds, more than one, than another way."""
        return len(worth) > 1 and worth[-1] < self.worth[: len(worth)][-1]
