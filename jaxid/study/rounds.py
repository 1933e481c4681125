"""History of a search: candidates with their decisions, rounds, and alternatives."""

import dataclasses
import enum

import numpy as np

from .._foundation.location import Location
from .._foundation.types import Float
from ..models.base import AbstractModel
from ..models.free import Free


class Decision(enum.Enum):
    """Decision on one candidate of a round. The values are texts for JSON files and reports.

    Attributes:
        NOT_REFITTED: its score is not among the best.
        HOPELESS: not refitted, as its score is far below the largest decrease of the cost that a
            refit has reached.
        NOT_FINITE: not refitted, as its derivative at zero gain is not finite.
        COLLINEAR: not refitted, as the records cannot distinguish it from another candidate.
        CHECK_WORSE: refused, as the check records are predicted worse.
        UNDETERMINED: refused, as its gain is within two standard errors of zero.
        DEGENERATE: refused, as its estimate is on a bound where it has no effect.
        NOT_SIGNIFICANT: refused, as the decrease of the cost may be due to chance.
        ACCEPTABLE: may be added; replaced by one of the next four at the end of the round.
        ADDED: added to the model.
        ALTERNATIVE: fits as well as the candidate that was added.
        WORSE: acceptable, but fits worse than the candidate that was added.
        PASSED_OVER: acceptable, but another search path started from its family.
    """

    NOT_REFITTED = "not refitted"
    HOPELESS = "not refitted: scores far below the best"
    NOT_FINITE = "its derivative at zero gain is not finite"
    COLLINEAR = "in these records indistinguishable from"
    CHECK_WORSE = "predicts the check records worse"
    UNDETERMINED = "its gain is not determined"
    DEGENERATE = "its estimate is on a bound where it has no effect"
    NOT_SIGNIFICANT = "not significant"
    ACCEPTABLE = "kept"
    ADDED = "added"
    ALTERNATIVE = "fits as well as the one added"
    WORSE = "fits worse than the one added"
    PASSED_OVER = "another search path started from its family"


@dataclasses.dataclass(frozen=True)
class Alternative:
    """An effect that fits the records as well as one that was added.

    Attributes:
        name, description: its name and description.
        instead_of: names of the effects that it replaces.
        chi_square: increase of the chi-square of the training records due to the replacement.
        model: the model after the replacement, with its parameters estimated again.
        free: the parameters that were estimated.
        information: factor of the training records' information on these parameters; None if
            unknown.
    """

    name: str
    description: str
    instead_of: tuple[str, ...]
    chi_square: float
    model: AbstractModel
    free: Free
    information: Float[np.ndarray, "row parameter"] | None = None


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One candidate of one round, or a pair of candidates, whose name is `first + second`.

    Attributes:
        name, family, description: its name, family and description.
        locations: where it acts, for both effects of a pair.
        score: chi-square of the score test, for a white residual.
        significance: the same chi-square, corrected for the colour of the residual.
        estimated_gain: gain in the linear model of the score test.
        identifiable_fraction: share of the squared length of its sensitivity that is orthogonal to
            the sensitivities of the free parameters; NaN if the sensitivity is not finite.
        cost_fall: twice the decrease of the training cost in a refit (chi-square); None if it was
            not refitted.
        check_fall: decrease of the logarithm of the check records' error, averaged over channels;
            None if it was not refitted.
        decision: whether it was refitted and added, and why.
        collinear_with: name of the candidate that it cannot be distinguished from, if any.
        pair: names of both effects of a pair; empty for a single effect.
    """

    name: str
    family: str
    locations: tuple[Location, ...]
    description: str
    score: float
    significance: float
    estimated_gain: float
    identifiable_fraction: float
    cost_fall: float | None = None
    check_fall: float | None = None
    decision: Decision = Decision.NOT_REFITTED
    collinear_with: str = ""
    pair: tuple[str, ...] = ()

    @property
    def place(self) -> str:
        """The locations in words."""
        return " and ".join(map(str, self.locations))

    @property
    def acceptable(self) -> bool:
        """True if it may be added."""
        return self.decision is Decision.ACCEPTABLE

    @property
    def verdict(self) -> str:
        """The decision in words."""
        return f"{self.decision.value} {self.collinear_with}".rstrip()

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of its effects: one, or both of a pair."""
        return self.pair or (self.name,)

    @property
    def variance_inflation(self) -> float:
        """Factor by which the residual's autocorrelation inflates chi-squares; at least one."""
        return max(self.score / self.significance, 1.0) if self.significance > 0 else float("inf")

    def with_other(self, other: "Candidate", score: float, significance: float) -> "Candidate":
        """Return the pair of two candidates, with their joint score."""
        return Candidate(
            f"{self.name} + {other.name}",
            f"{self.family} + {other.family}",
            tuple(dict.fromkeys((*self.locations, *other.locations))),
            f"{self.description} and {other.description}",
            score=score,
            significance=significance,
            estimated_gain=float("nan"),
            identifiable_fraction=min(self.identifiable_fraction, other.identifiable_fraction),
            pair=(self.name, other.name),
        )


@dataclasses.dataclass(frozen=True)
class Round:
    """One round of the loop.

    Attributes:
        effects: names of the effects in the model at the beginning of the round.
        candidates: all candidates that were scored, best first.
        added: name of the candidate that was added; None if none was.
        alternatives: candidates that the data cannot distinguish from the one added.
        dropped: effects that became insignificant and were removed.
        errors: root mean square error at the beginning of the round, by set of records (`train`,
            `check`, `test NAME`), then by channel.
        predictable: share of the variance of the training residual that is predictable from its
            past samples, per channel.
        threshold: chi-square that a candidate must exceed to be significant; it grows with the
            number of candidates tested.
    """

    effects: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    added: str | None
    alternatives: tuple[str, ...]
    dropped: tuple[str, ...]
    errors: dict[str, dict[str, float]]
    predictable: dict[str, float]
    threshold: float

    @property
    def winner(self) -> Candidate | None:
        """The candidate that was added; None if none was."""
        return next(
            (candidate for candidate in self.candidates if candidate.name == self.added), None
        )

    @property
    def added_effects(self) -> tuple[str, ...]:
        """Names of the effects that were added: none, one, or a pair."""
        return self.winner.parts if self.winner else ()

    def contenders(self, margin: float) -> tuple[Candidate, ...]:
        """Return the candidates that fit about as well as the one that was added.

        These are its alternatives, and all refitted candidates of other families whose decrease of
        chi-square is smaller by less than `margin`.
        """
        if self.winner is None or self.winner.cost_fall is None:
            return ()
        best, family = self.winner.cost_fall, self.winner.family
        others = [candidate for candidate in self.candidates if candidate.family != family]
        near = {
            candidate.name
            for candidate in others
            if candidate.cost_fall is not None and best - candidate.cost_fall < margin
        }
        names = near | set(self.alternatives)
        return tuple(candidate for candidate in self.candidates if candidate.name in names)
