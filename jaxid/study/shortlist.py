"""Which candidates of a round are refitted, and which need not be."""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..diagnosis.scores import Scores
from ..effects.base import Effect
from ..loop.columns import own_parameters
from .rounds import Candidate, Decision

COLLINEAR = 0.9999  # overlap from which on two candidates are one and the same to the data
# of the best fall so far: what scores less is no rival of it, whatever the score leaves out
HOPELESS = 0.05


class Shortlist(NamedTuple):
    """The candidates of a round that are refitted.

    Attributes:
        chosen: names of the best-scored candidates.
        unseen: names of those whose score does not tell what they bring.
        twins: candidates that are one and the same to the data as a chosen one, by name, with that
            one's name.
    """

    chosen: tuple[str, ...]
    unseen: frozenset[str]
    twins: dict[str, str]

    def decision_without_refit(
        self, candidate: Candidate, effect: Effect, best_fall: float
    ) -> Decision | None:
        """Why a candidate is not refitted; None where it is.

        Args:
            candidate, effect: what is asked about.
            best_fall: of the training cost with the best candidate that was refitted so far.
        """
        if candidate.name in self.unseen:
            return None
        if np.isnan(candidate.identifiable_fraction):
            return Decision.NOT_FINITE
        if candidate.name in self.twins:
            return Decision.COLLINEAR
        if candidate.name not in self.chosen:
            return Decision.NOT_REFITTED
        # A shape that starts far off can bring much more than its score; a gain alone cannot.
        hopeless = has_no_shape(effect) and candidate.score < HOPELESS * best_fall
        return Decision.HOPELESS if hopeless else None

    def without_refit(self, candidate: Candidate, decision: Decision) -> Candidate:
        """Return a candidate with the decision that it is not refitted, and the one it is collinear
        with.
        """
        twin = self.twins[candidate.name] if decision is Decision.COLLINEAR else ""
        return dataclasses.replace(candidate, decision=decision, collinear_with=twin)


def shortlist(
    candidates: tuple[Candidate, ...],
    scores: Scores,
    effects: Mapping[str, Effect],
    gains: Mapping[str, int],
    measured: dict[str, np.ndarray],
    threshold: float,
    limit: int,
) -> Shortlist:
    """The best-scored candidates and those that no score can see; of each set of twins only the
    simplest.

    Args:
        candidates: the best score first.
        scores: of all columns.
        effects, gains: the library and the column of each gain, by name.
        measured: samples of the outputs, by name.
        threshold: the score from which on a candidate counts.
        limit: how many of the best-scored, and how many of those at most whose score does not tell.
    """
    overlap = np.abs(np.asarray(scores.overlap))
    chosen: list[str] = []
    twins: dict[str, str] = {}
    for one in candidates:
        # Two shapes can be alike at zero gain and differ further on: they are refitted each.
        likes = chosen if has_no_shape(effects[one.name]) else []
        near = overlap[gains[one.name]]
        alike = (
            name for name in likes if near[gains[name]] > COLLINEAR and has_no_shape(effects[name])
        )
        same = next(alike, None)
        if same is not None and effects[one.name].card.complexity < effects[same].card.complexity:
            chosen[chosen.index(same)] = one.name
            twins = {name: one.name if twin == same else twin for name, twin in twins.items()} | {
                same: one.name
            }
        elif same is not None:
            twins[one.name] = same
        elif one.score > threshold and len(chosen) < limit:
            chosen.append(one.name)
    asked = {one.name: effects[one.name] for one in candidates}
    # Of a model with many states there are more such than can be refitted in every round.
    trying = [name for name, one in asked.items() if one.score_blind(measured)]
    first = sorted(trying, key=lambda name: not asked[name].evident_in_data(measured))[:limit]
    unseen = frozenset((*first, *(name for name, one in asked.items() if one.card.refines)))
    return Shortlist(
        tuple(chosen), unseen, {name: same for name, same in twins.items() if name not in unseen}
    )


def has_no_shape(effect: Effect) -> bool:
    """Whether the gain is all that is unknown of an effect."""
    return len(own_parameters(effect)) == 1
