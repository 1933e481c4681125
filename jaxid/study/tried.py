"""`Tried`: the refits of a round."""

from collections.abc import Mapping
from typing import NamedTuple

from ..diagnosis.validation import Prediction
from .fit import Fitted
from .rounds import Candidate


class Tried(NamedTuple):
    """The refits of a round, from which one is chosen.

    Attributes:
        fitted: the fit without them.
        before: the check records as it predicts them.
        candidates: with their verdicts, best score first.
        refits: those that were refitted, by name.
        twins: candidates that are one and the same to the data as a refitted one, by name, with
            that one's name.
        number: of the round.
    """

    fitted: Fitted
    before: Prediction
    candidates: tuple[Candidate, ...]
    refits: Mapping[str, Fitted]
    twins: Mapping[str, str]
    number: int

    @property
    def singles(self) -> tuple[Candidate, ...]:
        """The candidates that are no pairs."""
        return tuple(one for one in self.candidates if not one.pair)
