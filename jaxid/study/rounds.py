"""History of a search, round by round, and the alternatives to its result."""

import dataclasses

import numpy as np

from .._foundation.location import Location
from .._foundation.types import Float
from ..diagnosis.validation import root_mean_square
from ..loop.evidence import Decision
from ..loop.fit import LoopFit
from ..loop.moves import MoveKind, Proposals
from ..loop.options import LoopOptions
from ..loop.search_tree import SearchTree, Step
from ..models.base import AbstractModel
from ..models.free import Free
from .second_opinion import Refusal, SecondOpinion, second_opinion


@dataclasses.dataclass(frozen=True)
class Alternative:
    """A hypothesis that fits the records about as well as the study's own.

    Attributes:
        name, description: names and descriptions of the effects that replace others.
        instead_of: names of the effects that they replace.
        chi_square: increase of the chi-square of the training records, priced by parameters.
        model: the model of the hypothesis, with its parameters estimated again.
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
    """One change that a round considered: an effect, several, an exchange, or a noise model.

    Attributes:
        name, description: names and descriptions of the effects that it adds, or the noise.
        family: families of these effects; empty for a noise model.
        parts: names of these effects; empty for a noise model.
        instead_of: names of the effects that it removes.
        locations: places where the effects act.
        score: fall of chi-square in the linear model.
        estimated_gain: gain in the linear model; where a pair starts from the values of a refused
            addition, the gain of the second effect; NaN for other changes of several effects.
        cost_fall: fall of twice the training cost by the refit (chi-square); None without a refit.
        required: least fall for the change; None without a refit.
        check_fall: fall of the logarithm of the check records' error, averaged over channels; NaN
            for a change of noise, None without a refit.
        decision: decision after the refit; None without a refit.
        added: True if the next round starts with it.
    """

    name: str
    description: str
    family: str
    parts: tuple[str, ...]
    instead_of: tuple[str, ...]
    locations: tuple[Location, ...]
    score: float
    estimated_gain: float
    cost_fall: float | None = None
    required: float | None = None
    check_fall: float | None = None
    decision: Decision | None = None
    added: bool = False

    @property
    def place(self) -> str:
        """The locations in words."""
        return " and ".join(map(str, self.locations))

    @property
    def replacement(self) -> str:
        """The effects that it removes, in words after its name; empty if there are none."""
        return f", in place of {' and '.join(self.instead_of)}" if self.instead_of else ""

    @property
    def verdict(self) -> str:
        """The decision in words."""
        if self.added:
            return "added"
        return "not refitted" if self.decision is None else self.decision.value


@dataclasses.dataclass(frozen=True)
class Round:
    """One round: all changes that were considered from one hypothesis.

    Attributes:
        effects: names of the effects at the beginning of the round.
        candidates: the changes, best score first.
        added: name of the change that was made; None if none was.
        dropped: effects that became insignificant after it, or were replaced.
        errors: root mean square error at the beginning of the round, by set of records (`train`,
            `check`), then by channel.
        predictable: share of the variance of each training residual that its past predicts.
        threshold: chi-square that a single candidate must exceed to be significant.
        second_opinion: the same question by random signs of the residual, or the reason why it has
            no answer; None without candidates or with `LoopOptions(draws=0)`.
    """

    effects: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    added: str | None
    dropped: tuple[str, ...]
    errors: dict[str, dict[str, float]]
    predictable: dict[str, float]
    threshold: float
    second_opinion: SecondOpinion | Refusal | None

    @property
    def required(self) -> float:
        """Chi-square that the search required of the change that was made, colour accounted for; of
        a single candidate if none was made.
        """
        if self.winner is None or self.winner.required is None:
            return self.threshold
        return self.winner.required

    @property
    def added_effects(self) -> tuple[str, ...]:
        """Names of the effects that were added: none, one, or several."""
        return self.winner.parts if self.winner else ()

    @property
    def winner(self) -> Candidate | None:
        """The change that was made; None if none was."""
        return next((candidate for candidate in self.candidates if candidate.added), None)


def rounds_of(tree: SearchTree, options: LoopOptions) -> tuple[Round, ...]:
    """Return the rounds of a search: one from each hypothesis of its path, removals left out."""
    rounds: list[Round] = []
    path: list[Step | None] = [*tree.path, None]
    start = tree.declared
    for step in path:
        if step is not None and step.move.kind is MoveKind.DROP:
            dropped = tuple(n for n in step.parent.effects if n not in step.fit.effects)
            rounds[-1] = dataclasses.replace(rounds[-1], dropped=(*rounds[-1].dropped, *dropped))
        else:
            rounds.append(_round(tree, step.parent if step else start, step, options))
        start = step.fit if step else start
    return tuple(rounds)


def _round(tree: SearchTree, parent: LoopFit, made: Step | None, options: LoopOptions) -> Round:
    """Return the round from one fit.

    Args:
        tree: the search.
        parent: the fit.
        made: the change that was made; None if none was.
        options: levels of the search.
    """
    proposals = Proposals(parent, options)
    refitted = [
        _refitted(step, step is made)
        for step in tree.steps
        if step.parent is parent and step.move.kind is not MoveKind.DROP
    ]
    others = _scored(proposals, {candidate.name for candidate in refitted})
    everything = sorted([*refitted, *others], key=lambda candidate: -candidate.score)
    added = next((candidate for candidate in refitted if candidate.added), None)
    problem = parent.problem
    rms = root_mean_square(parent.solution.residuals, problem.train.mask)
    errors = {"train": rms, "check": parent.check_prediction.rms}
    return Round(
        parent.effects,
        tuple(everything),
        added.name if added else None,
        added.instead_of if added else (),
        {
            part: dict(zip(problem.model.outputs, map(float, np.asarray(rms)), strict=True))
            for part, rms in errors.items()
        },
        parent.predictable,
        proposals.threshold,
        second_opinion(proposals, made, tree.best),
    )


def _scored(proposals: Proposals, known: set[str]) -> list[Candidate]:
    """Return the candidates that were only scored.

    Args:
        proposals: candidates with their scores.
        known: names of the refitted ones.
    """
    cards = proposals.problem.cards
    return [
        Candidate(
            name,
            cards[name].description,
            cards[name].family,
            (name,),
            (),
            (cards[name].location,),
            proposals.score(name),
            proposals.gain(name),
        )
        for name in proposals.candidates
        if name not in known
    ]


def _refitted(step: Step, added: bool) -> Candidate:
    """Return the candidate of a refitted change."""
    problem, comparison, parts = step.fit.problem, step.comparison, step.move.into
    cards = [problem.effects[name].card for name in parts]
    noise = step.fit.hypothesis.noise.words
    is_noise = step.move.kind is MoveKind.NOISE
    gains = list(step.move.estimated.values())
    return Candidate(
        noise if is_noise else " + ".join(parts),
        noise if is_noise else " and ".join(card.description for card in cards),
        " + ".join(card.family for card in cards),
        parts,
        tuple(name for name in step.parent.effects if name not in step.fit.effects),
        tuple(dict.fromkeys(card.location for card in cards)),
        step.move.expected,
        gains[0] if len(gains) == 1 else float("nan"),
        comparison.fall,
        comparison.required,
        comparison.check_fall,
        comparison.decision,
        added,
    )


def alternatives_of(tree: SearchTree, margin: float) -> tuple[Alternative, ...]:
    """Return the hypotheses that are worse than the best one by less than a margin of chi-square.

    Args:
        tree: the search.
        margin: chi-square, priced by parameters.
    """
    best = tree.best
    near = []
    for other, worse in tree.alternatives():
        new = tuple(name for name in other.effects if name not in best.effects)
        if worse < margin and new:
            model, free = other.model, other.estimation.free
            effects = other.problem.effects
            description = " and ".join(effects[name].card.description for name in new)
            missing = tuple(name for name in best.effects if name not in other.effects)
            near.append(
                Alternative(
                    " + ".join(new), description, missing, worse, model, free, other.information
                )
            )
    return tuple(near)
