"""`assess`: the checks of a search's result, in order, and its verdict."""

import dataclasses
import enum
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from .._foundation.checks import require
from .._foundation.location import Location, LocationKind
from ..data.record import Record
from ..diagnosis.heldout_error import (
    difference_error,
    mean_log,
    mean_log_of,
    observed_channels,
    uncertainty,
)
from ..diagnosis.places import LocalisationResult
from ..effects.base import Effect
from ..estimation.likelihoods import OutputError
from .dependence import followed_signals
from .evidence import DETERMINED, SETTLED, inflation, is_drift, is_noise_like, memory
from .fit import LoopFit
from .hypothesis import White
from .linear import falls, joint_fall, reduce
from .moves import MoveKind
from .noise import above_known_noise
from .options import LoopOptions
from .outcome import Outcome
from .search_tree import SearchTree

# Derived: the misfits of shapes in equal steps grow as squares, 0, 1, 4. Where the truth is one
# step to the other side and would fit better by SETTLED, the next shape fits worse by three times
# that.
SETTLED_NEIGHBOUR = 3.0 * SETTLED
# Chosen: share of the residual's power by which a place may explain less than the best one and
# still be the place; several effects in several places may act as one in another.
NEAR_PLACE, NEAR_PLACE_OF_TWO = 0.2, 0.05
# Chosen: largest deviation from one, and largest standard error, of a gain that is zero or one. It
# is then five standard errors from zero and from two.
UNIT_GAIN_ERROR = 0.2
# Chosen: standard errors by which a gain of zero or one may deviate from one.
UNIT_GAIN_DEVIATION = 3.0
# Chosen: share of an effect's fall of chi-square within which another function of the same signals
# at the same place is the same to the records, so that both name one cause.
SAME_SHARE = 0.01
# Chosen: ratio of the error of test records to the error of training records, up to which errors of
# the parameters explain it. Each of 74 true effects predicts within 1.05 of the true model.
WORSE = 1.2


class Check(enum.Enum):
    """The checks, in their order."""

    NOISE_LIKE = enum.auto()
    ONE_FUNCTION = enum.auto()
    IN_PLACE = enum.auto()
    UNIT_GAIN = enum.auto()
    SPREAD = enum.auto()
    ALTERNATIVE = enum.auto()
    CARRIES_OVER = enum.auto()
    BORNE_OUT = enum.auto()


class Objection(NamedTuple):
    """Objection of one check to the effects as the cause.

    Attributes:
        check: the check.
        names: effects, signals or sets of records concerned.
        numbers: figures concerned, in the order of the names.
    """

    check: Check
    names: tuple[str, ...] = ()
    numbers: tuple[float, ...] = ()


@dataclasses.dataclass(frozen=True, eq=False)
class Assessment:
    """Verdict of a search.

    Attributes:
        outcome: the outcome.
        objections: objections of the checks.
    """

    outcome: Outcome
    objections: tuple[Objection, ...] = ()


def assess(tree: SearchTree, tests: Mapping[str, Record], options: LoopOptions) -> Assessment:
    """Return the verdict of a search, with anonymous test records by name of set."""
    more, best = noise_like(tree, options), tree.best
    if not best.effects:
        if more is not None:
            return Assessment(Outcome.UNEXPLAINED, (more,))
        return Assessment(best.hypothesis.noise.outcome)
    effects = [best.problem.effects[name] for name in best.effects]
    at = in_place(effects, tree.where, options.level)
    results = [more, one_function(effects), at, unit_gain(best), spread(best, options.level)]
    if not any(results):
        results.append(alternative(tree))
    results.append(carries_over(tree, tests))
    objections = tuple(result for result in results if result is not None)
    return Assessment(Outcome.PROXIES if objections else Outcome.EXPLAINED, objections)


def noise_like(tree: SearchTree, options: LoopOptions) -> Objection | None:
    """Return an objection if the residual of the best hypothesis is more than noise.

    It is if its past predicts it, if it is larger than a given noise, if a free-form disturbance at
    some place explains it, if it depends on a signal under a noise model or that noise is as slow
    as a drift.

    It alone decides when no shape of the library comes near the effect: a scale of the sensor that
    no other effect imitates (`test_absent_effect_is_not_named`); when a white residual is larger
    than the given noise (`test_residual_above_given_noise_is_unexplained`); and when a constant
    error of a sensor is noise only with an endless memory
    (`test_constant_sensor_error_is_not_reported_as_coloured_noise`).
    """
    best, level = tree.best, options.level
    # The signals that refused noises depend on, where no effect was found.
    followed = () if best.effects else tree.followed
    if not is_noise_like(best, options) or above_known_noise(best, level):
        return Objection(Check.NOISE_LIKE, followed)
    if not isinstance(best.hypothesis.noise, White):
        return _noise_model(tree, followed, level)
    if best.effects and tree.where_after.is_significant(level):
        return Objection(Check.NOISE_LIKE)
    return None


def _noise_model(tree: SearchTree, followed: tuple[str, ...], level: float) -> Objection | None:
    """Return an objection if the noise model of the best hypothesis is no noise."""
    best = tree.best
    if tree.path and tree.path[-1].move.kind is MoveKind.NOISE:
        return None  # both were looked at before it was accepted
    signals = followed_signals(best, level)
    more = signals or is_drift(best, memory(best))
    return Objection(Check.NOISE_LIKE, signals or followed) if more else None


def one_function(effects: Sequence[Effect]) -> Objection | None:
    """Return an objection if effects of different shapes make up one function of one signal.

    Terms of one series are one function; a kink, a friction and a cubic of the same signal at one
    place are not three causes.

    It alone decides for a quadratic drag outside the library, which a cubic and a dead band imitate
    (`test_shapes_that_imitate_a_drag_together_are_proxies`).
    """
    groups: dict[tuple, list[Effect]] = {}
    for effect in effects:
        if effect.card.signals:
            groups.setdefault((effect.card.location, effect.card.signals), []).append(effect)
    names = tuple(
        effect.name
        for group in groups.values()
        for effect in group
        if len({type(member) for member in group}) > 1 and not all(member.terms for member in group)
    )
    return Objection(Check.ONE_FUNCTION, names) if names else None


def in_place(
    effects: Sequence[Effect], where: LocalisationResult, level: float
) -> Objection | None:
    """Return an objection if most effects act where the residual of the declared model is not.

    Only equations, inputs and sensors count: a coefficient or a parameter may move more equations
    than one, and so does an action between two parts. Where no place explains more of the residual
    than chance would, there is no objection.

    It alone decides when effects elsewhere imitate the cause in full: two late sensors for a late
    input (`test_effects_elsewhere_are_proxies`).
    """
    locations = [effect.card.location for effect in effects]
    known = set(locations) <= {place.location for place in where.places}
    if act_between(effects) or not known or not where.is_significant(level):
        return None
    near = _near_best(where, NEAR_PLACE if len(set(locations)) == 1 else NEAR_PLACE_OF_TWO)
    elsewhere = tuple(e.name for e, at in zip(effects, locations, strict=True) if at not in near)
    return Objection(Check.IN_PLACE, elsewhere) if 2 * len(elsewhere) > len(effects) else None


def _near_best(where: LocalisationResult, within: float) -> set[Location]:
    """Return the places near the best one, gusts left out: no effect is a gust."""
    places = tuple(p for p in where.places if p.location.kind is not LocationKind.AIR)
    return {place.location for place in where._replace(places=places).near_best(within)}


def act_between(effects: Sequence[Effect]) -> bool:
    """Return True if the effects are one action between two parts: functions of the same difference
    of signals, in the equations of both.
    """
    cards = [effect.card for effect in effects]
    locations, signals = {card.location for card in cards}, {card.signals for card in cards}
    of_difference = len(signals) == 1 and all("-" in name for names in signals for name in names)
    in_equations = all(location.kind is LocationKind.EQUATION for location in locations)
    return of_difference and in_equations and len(locations) == len(effects) > 1


def unit_gain(best: LoopFit) -> Objection | None:
    """Return an objection if the gain of an all-or-nothing effect is not shown to be one.

    It alone decides when a related effect takes a gain without a meaning: a lag of another gain
    than one for a delay (`test_lag_of_partial_gain_is_proxy`).
    """
    effects = [best.problem.effects[name] for name in best.effects]
    names = [e.name for e in effects if e.card.unit_gain and not best.problem.is_evident(e.name)]
    partial = {}
    for name in names:
        gain, error = best.estimates[f"{name}.gain"]
        allowed = max(UNIT_GAIN_DEVIATION * error, UNIT_GAIN_ERROR)
        if not (error <= UNIT_GAIN_ERROR and abs(gain - 1.0) <= allowed):
            partial[name] = gain
    return Objection(Check.UNIT_GAIN, tuple(partial), tuple(partial.values())) if partial else None


def spread(best: LoopFit, level: float) -> Objection | None:
    """Return an objection if a delay or a lag has another course in time than the records.

    It alone decides when a sensor lags and the library has only a delay of this sensor
    (`test_lag_taken_for_delay_is_proxy`).
    """
    gained = falls_by_spread(best)
    share = level / (len(Check) * max(len(gained), 1))  # of one effect in one of the checks
    allowed = scipy.stats.chi2.isf(share, 1) * inflation(best, best.effects)
    larger = {name: fall for name, fall in gained.items() if fall > allowed}
    return Objection(Check.SPREAD, tuple(larger), tuple(larger.values())) if larger else None


def falls_by_spread(best: LoopFit) -> dict[str, float]:
    """Return the fall of chi-square if each delay and each lag may have another course in time.

    A delay moves a signal as a whole, a lag spreads it in time, a filter of second order does both.
    With the same mean they differ by a response in which half of the signal arrives earlier and
    half later (`LinearMotion.response_to_spread`). Its fall has one degree of freedom.
    """
    if not isinstance(best.estimation.problem.likelihood, OutputError):
        return {}  # with random forces effects are never the cause
    columns = {}
    for effect in (best.problem.effects[name] for name in best.effects):
        if effect.card.delay:
            time, _ = best.estimates[f"{effect.name}.{effect.card.delay}"]
            # a disturbance of an input passes through the states of its lag
            centre = 0.0 if effect.extra_states else time
            at = effect.card.location
            columns[effect.name] = best.motion.response_to_spread(at, time, centre)
    if not columns:
        return {}
    triangle = best.triangle_with(columns)
    reduced = reduce(triangle)
    return {name: joint_fall(reduced, triangle.at([name]))[0] for name in columns}


def alternative(tree: SearchTree) -> Objection | None:
    """Return an objection if another shape fits nearly as well as an effect.

    Refitted alternatives of no more parameters or effects, and shapes next to those of the effects
    that the library need not hold, such as the next higher power.

    It alone decides when an effect is faint (`test_faint_effect_is_proxy`), or when another one
    acts elsewhere and does the same to the records
    (`test_effect_with_exact_equal_at_another_place_is_proxy`).
    """
    best = tree.best
    margin = SETTLED * inflation(best, best.effects)
    explained = 2.0 * (tree.declared.cost - best.cost)
    near = {
        str(other.hypothesis): worse
        for other, worse in tree.alternatives()
        if worse < margin
        and _is_as_simple(best, other)
        and not (abs(worse) <= SAME_SHARE * explained and _one_cause(best, other))
    }
    if not near:
        near = {
            n: w for n, w in neighbours(best).items() if w < margin / SETTLED * SETTLED_NEIGHBOUR
        }
    return Objection(Check.ALTERNATIVE, tuple(near), tuple(near.values())) if near else None


def _is_as_simple(best: LoopFit, other: LoopFit) -> bool:
    """Return True if a fit has no more parameters than the best one, or with the same noise no more
    effects, none of them a refinement of the best one's; the price of its parameters counts
    already.
    """
    cards = best.problem.cards
    families = {cards[name].family for name in best.effects}
    same_noise = other.hypothesis.noise.key == best.hypothesis.noise.key
    refines = any(cards[name].refines in families for name in other.effects)
    fewer_effects = len(other.effects) <= len(best.effects) and not refines
    return other.count <= best.count or (same_noise and fewer_effects)


def _one_cause(best: LoopFit, other: LoopFit) -> bool:
    """Return True if the effects in which two fits differ act at the same places, by functions of
    the same signals.
    """
    cards, both = best.problem.cards, {*best.effects} & {*other.effects}
    ours, theirs = (
        {(cards[name].location, cards[name].signals) for name in fitted.effects if name not in both}
        for fitted in (best, other)
    )
    return ours == theirs


def carries_over(tree: SearchTree, tests: Mapping[str, Record]) -> Objection | None:
    """Return an objection if test records are predicted worse with the effects than without, or
    worse than the training records.

    It alone decides when an effect holds only in the range of the train and check records
    (`test_effect_that_does_not_carry_over_is_proxy`, `test_power_is_proxy_where_a_sine_leaves_it`).
    """
    worse: dict[str, float] = {}
    usual = np.asarray(tree.best.predict(tree.problem.train).rms) if tests else np.zeros(0)
    for name, records in tests.items():
        before, after = tree.declared.predict(records), tree.best.predict(records)
        grows = mean_log(after) - mean_log(before) > DETERMINED * difference_error(before, after)
        excess = mean_log(after) - mean_log_of(usual[observed_channels(after)])
        if grows or excess > np.log(WORSE) + DETERMINED * uncertainty(after):
            worse[name] = float(np.exp(excess))
    return Objection(Check.CARRIES_OVER, tuple(worse), tuple(worse.values())) if worse else None


def neighbours(best: LoopFit) -> dict[str, float]:
    """Return how much worse each neighbouring shape fits in place of its effect, in chi-square of
    the linear model.

    A shape is a sum of terms in equations, and its column the response of the linear model to them.
    """
    problem = best.problem
    known = {effect.name for effect in problem.library}
    pairs = {
        shape.name: (effect, shape)
        for effect in problem.library
        for shape in (effect.neighbouring_shapes() if effect.name in best.effects else ())
        if shape.name not in known
    }
    if not pairs:
        return {}
    for name, (effect, shape) in pairs.items():
        require(
            len(shape.terms) > 0,
            f"{name!r}, a neighbouring shape of {effect.name!r}, has no `terms`. "
            "Give a sum of terms.",
        )
    columns = {name: best.motion.response(shape.terms) for name, (_, shape) in pairs.items()}
    triangle, worse = best.triangle_with(columns), {}
    for name, (effect, _) in pairs.items():
        reduced = reduce(triangle, triangle.at(problem.columns.of_effect[effect.name]))
        worse[name] = -float(falls(reduced, np.array([triangle.at([name])]))[0])
    return worse
