"""Reasons not to call effects the cause, although they leave nothing but noise."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from .._foundation.location import LocationKind
from .._foundation.types import Float
from ..diagnosis.localise import LocalisationResult
from ..effects.base import Effect
from ..loop.thresholds import SETTLED
from .fit import Fitted
from .kin import near_kin
from .rounds import Alternative, Round
from .workbench import Workbench

# The misfits of shapes in equal steps grow as squares, 0, 1, 4: where the truth, a step to the
# other side, would fit better by SETTLED, the next shape fits worse by three times that. No library
# holds the end of such a row.
NEXT = 3.0 * SETTLED
# Of the residual's power: places whose shares differ by more are not the same. Two effects in two
# places can together do what one does in a third, so that more is asked of them.
NEAR, NEAR_OF_SEVERAL = 0.2, 0.05
# A gain that is whole or none may be off by so much, and be known no worse: it is then told from
# none, and from twice, by the five standard deviations of SETTLED. Two lags in a row look like one
# of 1.3, a delay like one of 2.
PARTIAL = 0.2
OFF = 3.0  # standard errors that such a gain may be off
# of what an effect explains: a contender that differs by less is to these records the same, and one
# set with it
SAME_FIT = 0.01


class Doubts(NamedTuple):
    """Why effects may not be the cause.

    Attributes:
        parts: those that only together make up one function (`parts_of_one`).
        elsewhere: whether most of them act elsewhere than where the residual sits
            (`act_elsewhere`).
        unsettled: what might as well be the cause (`unsettled`, `near_kin`).
        partial: gains of what is whole or none, and is not seen to be whole (`partial`).
        dropped: what they left nothing but noise with, and the whole of the training records does
            not bear out.
    """

    parts: tuple[str, ...] = ()
    elsewhere: bool = False
    unsettled: tuple[str, ...] = ()
    partial: Mapping[str, tuple[float, float]] = MappingProxyType({})
    dropped: tuple[str, ...] = ()

    def __str__(self) -> str:
        """The first of them in a sentence; empty where there is none."""
        if self.dropped:
            also = " and ".join(self.dropped)
            return (
                f"Nothing but noise stayed with {also} beside them, which the whole of the "
                "training records does not bear out."
            )
        if self.parts:
            parts = " and ".join(self.parts)
            return f"Together {parts} make up one function, and its form is not settled."
        if self.elsewhere:
            return "They leave nothing but noise, but act elsewhere than where the residual sits."
        if self.unsettled:
            nearly = ", ".join(self.unsettled)
            return (
                f"What stays is noise, but these records do not settle the form: {nearly} would do "
                "nearly as well."
            )
        if not self.partial:
            return ""
        gains = (
            f"{name} has a gain of {one:.2f} ± {error:.2f}"
            for name, (one, error) in self.partial.items()
        )
        told = " and ".join(gains)
        return (
            f"What stays is noise, but the form is not settled: {told}, and is what it is called "
            "at 1 only."
        )


def doubts_about(
    bench: Workbench,
    found: Fitted,
    rounds: tuple[Round, ...],
    contenders: tuple[Alternative, ...],
    where: LocalisationResult,
    inflation: float,
) -> Doubts:
    """Every reason, but that shapes which no library holds are only asked about where there is no
    other.

    Args:
        bench: with the library.
        found: the fit with the effects.
        rounds: what was tried.
        contenders: what fits worse by less than `SETTLED` in the place of what was added.
        where: where the residual of the declared model sits.
        inflation: by how much worse than white noise coloured noise lets slow quantities be known.
    """
    effects = tuple(bench.effects[name] for name in found.effects)
    near, torn = (
        unsettled(contenders, rounds),
        partial(effects, bench.standard_errors(found), bench.measured),
    )
    doubts = Doubts(parts_of_one(effects), act_elsewhere(effects, where), near, torn)
    return doubts if any(doubts) else Doubts(unsettled=near_kin(bench, found, NEXT * inflation))


def parts_of_one(effects: tuple[Effect, ...]) -> tuple[str, ...]:
    """Names of effects that, being of different shapes, only together make up a function of the
    same signals in one place.

    A series of terms is a way to write a function; a kink, a friction and a cubic that it takes to
    say what one signal does are not three causes, and a delay with a lag says that an input is late
    in a way of which two things are known. An instrument that stands elsewhere along two axes
    stands elsewhere.
    """
    groups: dict[tuple, list[Effect]] = {}
    for effect in effects:
        card = effect.card
        if card.signals:
            groups.setdefault((card.location, card.signals), []).append(effect)
    mixed = [
        group
        for group in groups.values()
        if len(set(map(type, group))) > 1 and not all(one.terms for one in group)
    ]
    return tuple(effect.name for group in mixed for effect in group)


def act_elsewhere(effects: tuple[Effect, ...], where: LocalisationResult) -> bool:
    """Whether most of the effects act in places that explain clearly less of the residual than the
    best one does.

    What predicts well may still be of another kind than the cause: two late sensors for a late
    input. Only equations, inputs and sensors are held against it; what acts through a coefficient
    or a parameter may move several equations, and so does what acts between two parts, a function
    of the same signals in the equation of each.
    """
    if act_between(effects):
        return False
    told = [effect.card.location for effect in effects]
    # no effect is a gust
    solid = tuple(one for one in where.places if one.location.kind is not LocationKind.AIR)
    where = where._replace(places=solid)
    rivals = where.near_best(NEAR if len(set(told)) == 1 else NEAR_OF_SEVERAL)
    known, close = ({one.location for one in some} for some in (where.places, rivals))
    return set(told) <= known and 2 * sum(one not in close for one in told) > len(told)


def act_between(effects: tuple[Effect, ...]) -> bool:
    """Whether the effects are one action between two parts: of the same difference of signals, in
    the equations of both.
    """
    cards = [effect.card for effect in effects]
    locations, signals = {card.location for card in cards}, {card.signals for card in cards}
    alike = len(signals) == 1 and all("-" in signal for one in signals for signal in one)
    in_equations = all(one.kind is LocationKind.EQUATION for one in locations)
    return alike and len(locations) == len(effects) > 1 and in_equations


def unsettled(contenders: tuple[Alternative, ...], rounds: tuple[Round, ...]) -> tuple[str, ...]:
    """Names of the contenders that these records do not refute, although they are of another shape.

    A faint effect is fitted to within the noise by whatever resembles it. Where the library's
    nearest other shape is not clearly worse, a shape that the library lacks could be the cause as
    well.
    """
    falls = {one.added_effects: one.winner.cost_fall for one in rounds if one.winner}
    return tuple(
        one.name
        for one in contenders
        if abs(one.chi_square) > SAME_FIT * (falls[one.instead_of] or 0.0)
    )


def partial(
    effects: tuple[Effect, ...],
    estimates: Mapping[str, tuple[float, float]],
    measured: dict[str, Float[np.ndarray, " _"]],
) -> dict[str, tuple[float, float]]:
    """Gains, with standard errors, of effects that are whole or none and are not seen to be whole:
    something else may stand behind them.

    A delay is a lag of gain two, to second order in its time; two lags in a row are one of 1.3.
    What the records show by themselves, such as a stop, needs no such proof.

    Args:
        effects: what is in.
        estimates: value and standard error by name.
        measured: samples of the outputs, by name.
    """
    asked = [
        effect.name
        for effect in effects
        if effect.card.unit_gain and not effect.evident_in_data(measured)
    ]
    gains = {name: estimates[f"{name}.gain"] for name in asked}
    return {
        name: (gain, error)
        for name, (gain, error) in gains.items()
        if error > PARTIAL or abs(gain - 1.0) > max(OFF * error, PARTIAL)
    }
