"""`propose`: the hypotheses next to a fit, with the fall of chi-square that each should bring."""

import dataclasses
import enum
import itertools
from collections.abc import Mapping
from functools import cached_property

import numpy as np
import scipy

from .._foundation.location import LocationKind
from .._foundation.types import Float
from ..diagnosis.localise import localise, resolution
from ..diagnosis.places import LocalisationResult
from .evidence import least_expected_fall
from .fit import LoopFit
from .hypothesis import Hypothesis
from .linear import Reduced, falls, gains, reduce
from .options import LoopOptions
from .problem import regular

# Chosen: overlap from which two candidates are the same to the records.
COLLINEAR_OVERLAP = 0.9999


class MoveKind(enum.Enum):
    """Kind of a change of hypothesis."""

    ADD = enum.auto()
    GROUP = enum.auto()
    PAIR = enum.auto()
    SWAP = enum.auto()
    DROP = enum.auto()
    NOISE = enum.auto()


@dataclasses.dataclass(frozen=True, eq=False)
class Move:
    """A change of hypothesis.

    Attributes:
        kind: kind of the change.
        hypothesis: the hypothesis after it.
        into: effects that it adds.
        expected: fall of chi-square in the linear model.
        start: starting values by name.
        estimated: gains of the added effects in the linear model, by name; where a pair starts from
            the values of a refused addition, only the gain of the second effect.
    """

    kind: MoveKind
    hypothesis: Hypothesis
    into: tuple[str, ...]
    expected: float
    start: Mapping[str, float]
    estimated: Mapping[str, float]


class Proposals:
    """The moves from one fit."""

    def __init__(self, fit: LoopFit, options: LoopOptions):
        self.fit, self.options, self.problem = fit, options, fit.problem
        self.candidates = self.problem.absent(fit.effects)
        self.level = options.level / max(len(self.candidates), 1)
        self.threshold = float(scipy.stats.chi2.isf(self.level, 1))

    @cached_property
    def reduced(self) -> Reduced:
        """The linear model of all columns."""
        return reduce(self.fit.triangle)

    @cached_property
    def _scores(self) -> dict[str, float]:
        falls = self._falls(self.reduced, [(name,) for name in self.candidates])
        return dict(zip(self.candidates, falls.tolist(), strict=True))

    def score(self, name: str) -> float:
        """Return the fall of chi-square by adding one candidate."""
        return self._scores[name]

    def gain(self, name: str) -> float:
        """Return the gain of one candidate in the linear model."""
        return self._gains(self.reduced, (name,))[0]

    def drops(self) -> list[Move]:
        """Return removals of effects that have become insignificant, the least harmful first; they
        need no sensitivities to the candidates.
        """
        moves, triangle = [], self.fit.free_triangle
        for name in self._removable():
            reduced = reduce(triangle, triangle.at(self.problem.columns.of_effect[name]))
            if reduced.base > -self.threshold:
                moves.append(self._move(MoveKind.DROP, (), (name,), reduced.base, reduced))
        return sorted(moves, key=lambda move: -move.expected)

    def additions(self) -> list[Move]:
        """Return the best candidates, the best of each place, the best of those with a shape, and
        the best of those whose score does not predict their fall.

        A place is a location of a card: many shapes at one place must not crowd out the others. The
        score of a candidate with a shape holds at a guess of this shape. Candidates that the
        records cannot distinguish are represented by the simplest.
        """
        moves = []
        for name in self._chosen():
            refines = self.problem.cards[name].refines
            out = tuple(e for e in self.fit.effects if self.problem.cards[e].family == refines)
            fall = max(self.score(name), 0.0)
            moves.append(self._move(MoveKind.ADD, (name,), out, fall, self.reduced))
        return moves

    def _chosen(self) -> list[str]:
        """Return the candidates to be refitted, each once."""
        refits, cards = self.options.refits, self.problem.cards
        distinct = self._distinct(sorted(self.candidates, key=lambda name: -self.score(name)))
        significant = [name for name in distinct if self.score(name) > self._least_score(name)]
        best_of_place: dict = {}
        for name in significant:
            best_of_place.setdefault(cards[name].location, name)
        shaped = [name for name in significant if self.problem.has_shape(name)]
        blind = [name for name in self.candidates if self.is_blind(name)]
        blind.sort(key=lambda name: not self.problem.is_evident(name))
        chosen = [*significant[:refits], *best_of_place.values()]
        chosen += [*shaped[: -(-refits // 2)], *blind[:refits]]
        return [*dict.fromkeys(chosen)]

    def _least_score(self, name: str) -> float:
        """Return the score below which a candidate cannot be accepted; one with a shape has a score
        at a guess of the shape.
        """
        return self.threshold if self.problem.has_shape(name) else self._least_fall

    @cached_property
    def _least_fall(self) -> float:
        return max(self.threshold, least_expected_fall(self.fit, self.options))

    def groups(self) -> list[Move]:
        """Return sets of terms of one signal in one place that are significant only together."""
        sets: dict[tuple, list[str]] = {}
        for name in self.candidates:
            card = self.problem.cards[name]
            if self.problem.effects[name].terms and len(card.signals) == 1:
                sets.setdefault((card.location, card.signals), []).append(name)
        moves = []
        for names in (names for names in sets.values() if len(names) > 1):
            joint = float(self._falls(self.reduced, [names])[0])
            least = scipy.stats.chi2.isf(self.level, len(names) - 1)
            if joint - max(map(self.score, names)) > least:
                moves.append(self._move(MoveKind.GROUP, tuple(names), (), joint, self.reduced))
        return moves

    def pair_sets(self) -> list[tuple[str, ...]]:
        """Return the pairs of candidates of two families."""
        family = {name: card.family for name, card in self.problem.cards.items()}
        pairs = itertools.combinations(self.candidates, 2)
        return [pair for pair in pairs if family[pair[0]] != family[pair[1]]]

    def pairs(self) -> list[Move]:
        """Return the best pairs of effects that hide each other: weak alone, strong together."""
        pairs = self.pair_sets()
        joint = self._falls(self.reduced, pairs)
        threshold = scipy.stats.chi2.isf(self.options.level / max(len(pairs), 1), 2)
        best = [k for k in np.argsort(-joint)[: self.options.swap_limit] if joint[k] > threshold]
        return [
            self._move(MoveKind.PAIR, pairs[k], (), float(joint[k]), self.reduced) for k in best
        ]

    def swaps(self, margin: float, pairs: bool = True) -> list[Move]:
        """Return exchanges of one or two effects for another one, the best first.

        Args:
            margin: chi-square by which the exchange may be worse.
            pairs: False for exchanges of single effects only.
        """
        sizes = (1, 2) if pairs else (1,)
        sets = [out for n in sizes for out in itertools.combinations(self._removable(), n)]
        moves = [move for out in sets for move in self._swaps_of(out, margin)]
        return sorted(moves, key=lambda move: -move.expected)

    def _swaps_of(self, out: tuple[str, ...], margin: float) -> list[Move]:
        """Return the best exchanges of some effects for another one."""
        own = [name for effect in out for name in self.problem.columns.of_effect[effect]]
        reduced = reduce(self.fit.triangle, self.fit.triangle.at(own))
        rest = self.problem.absent(self.fit.hypothesis.changed(out).effects)
        others = [n for n in rest if n not in out and not self.problem.cards[n].refines]
        expected = self._falls(reduced, [(name,) for name in others])
        expected += self.problem.price * (len(out) - 1)
        best = [
            k for k in np.argsort(-expected)[: self.options.swap_limit] if expected[k] > -margin
        ]
        return [
            self._move(MoveKind.SWAP, (others[k],), out, float(expected[k]), reduced) for k in best
        ]

    def is_blind(self, name: str) -> bool:
        """Return True if the score of a candidate does not predict its fall of the cost."""
        refines = bool(self.problem.cards[name].refines)
        return refines or self.problem.effects[name].score_blind(self.problem.measured)

    def _removable(self) -> list[str]:
        return [name for name in self.fit.effects if not self.problem.is_evident(name)]

    def _falls(self, reduced: Reduced, sets) -> Float[np.ndarray, " set"]:
        """Return the fall of chi-square by sets of effects of one size."""
        index = self.problem.columns.index
        at = [[index[f"{name}.gain"] for name in names] for names in sets]
        return falls(reduced, np.array(at, int)) if at else np.zeros(0)

    def _gains(self, reduced: Reduced, names: tuple[str, ...]) -> list[float]:
        """Return the gains of effects in the linear model."""
        index = self.problem.columns.index
        return gains(reduced, [index[f"{name}.gain"] for name in names]).tolist()

    def _distinct(self, ordered: list[str]) -> list[str]:
        """Return the candidates without those that the records cannot distinguish from another."""
        kept, cards = [], self.problem.cards
        for name in ordered:
            alike = [k for k, other in enumerate(kept) if self._same(name, other)]
            if not alike:
                kept.append(name)
            elif cards[name].complexity < cards[kept[alike[0]]].complexity:
                kept[alike[0]] = name
        return kept

    def _same(self, name: str, other: str) -> bool:
        """Return True if two effects without a shape have the same influence on the outputs."""
        if self.problem.has_shape(name) or self.problem.has_shape(other):
            return False
        index = self.problem.columns.index
        overlap = self.reduced.correlation[index[f"{name}.gain"], index[f"{other}.gain"]]
        return bool(abs(overlap) > COLLINEAR_OVERLAP)

    def _move(self, kind, into, out, expected: float, reduced: Reduced) -> Move:
        """Return a move with its starting values."""
        cards, known = self.problem.cards, self.fit.estimates
        start = {f"{name}.gain": cards[name].initial_gain for name in into}
        for name, other in itertools.product(into, out):
            if cards[other].family == cards[name].refines:
                fields = (
                    own.removeprefix(f"{name}.") for own in self.problem.columns.of_effect[name]
                )
                common = (field for field in fields if f"{other}.{field}" in known)
                start |= {f"{name}.{field}": known[f"{other}.{field}"][0] for field in common}
        estimated = {
            f"{name}.gain": gain
            for name, gain in zip(into, self._gains(reduced, into), strict=True)
        }
        return Move(kind, self.fit.hypothesis.changed(out, into), into, expected, start, estimated)


def localise_fit(fit: LoopFit, splines: tuple[int, int] | None = None) -> LocalisationResult:
    """Return the location of the residual of a fit with output error, by as many splines and rows
    as an earlier result has.
    """
    problem, motion = fit.problem, fit.motion
    places = motion.places | {LocationKind.EQUATION: problem.equations}
    places = {kind: names for kind, names in places.items() if names}
    base = motion.fixed[0]
    padding = problem.padding(fit.effects)._replace(own_width=base.positions.rows.size)
    S = padding.padded_columns(motion.chosen(problem.columns.chosen(fit.effects)))
    splines = splines or resolution(problem.train, fit.solution.residuals)
    R = regular(fit.noise_covariance)
    linear = motion.linear_at(places)
    return localise(base, linear, (motion.sensitivities[0], S), R, splines, places)
