"""What a loop may claim: the gate between an effect that explains and one that only helps, and the words for it."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jax.scipy.stats import chi2

from ..diagnosis.where import Where
from ..models.effects import Effect
from ..models.noise import FixedNoise
from .rivals import Rival
from .search import INSEPARABLE, Search
from .study import ColouredNoise, RandomForces, Round
from .unpredictable import coloured_noise, random_forces
from .workbench import Fitted, Workbench

PLACES = {
    "equation": "equation of",
    "input": "input",
    "output": "sensor",
    "parameter": "parameter",
}  # as `Effect.place` calls them
# Of the residual's power: places whose shares differ by more are not the same. Two effects in two places can together do what
# one does in a third, so that more is asked of them.
NEAR, NEAR_OF_SEVERAL = 0.2, 0.05
SETTLED = 25.0  # by how much worse another shape must fit for this one to be the cause: a discovery's five standard deviations
ALIKE = 0.01  # of what an effect explains: a contender that differs by less is to these records the same, and one set with it


class Conclusion(NamedTuple):
    """What a loop may claim.

    Attributes:
        outcome: as in `Study`.
        process_noise: the random forces where these are it.
        coloured_noise: the noise of sensors, where that is what stays.
        contenders: what fits hardly worse in the place of what was added.
        parts: of the effects that are in, those that only together make up one function (`parts_of_one`).
        elsewhere: whether most of the effects that are in act elsewhere than where the residual sits (`act_elsewhere`).
        unsettled: what might as well be the cause (`unsettled`).
    """

    outcome: str
    process_noise: RandomForces | None = None
    coloured_noise: ColouredNoise | None = None
    contenders: tuple[Rival, ...] = ()
    parts: tuple[str, ...] = ()
    elsewhere: bool = False
    unsettled: tuple[str, ...] = ()


def conclude(
    search: Search,
    rounds: tuple[Round, ...],
    declared: Fitted,
    found: Fitted,
    where: Mapping[str, Where],
) -> Conclusion:
    """Whether the residual is consistent with noise after what was added, white or coloured, or with random forces alone.

    Args:
        search: with its workbench and options.
        rounds: what was tried.
        declared, found: the declared model's fit, and the one with what was added.
        where: the places of the residual `before` and `after`, of these two.
    """
    last = rounds[-1]
    fires = any(min(one.score, one.significance) > last.threshold for one in last.candidates)
    coloured = not search.looks_like_noise(last.predictable)
    if isinstance(search.bench.likelihood.noise, FixedNoise):
        coloured = coloured or _above_known_noise(found, search.bench, search.options.level)
    if found.effects:
        coloured = coloured or stands_out(where["after"], search.options.level)
    if not (coloured or fires):
        return _cause(search, rounds, found, where, None) if found.effects else Conclusion("nothing missing")
    forces = random_forces(search, declared, where["before"])
    if forces is not None:
        return Conclusion("process noise", forces)
    noise = coloured_noise(search, found)
    # A filter that knows the noise's memory tells what is slow from it better than a score does that was corrected for it.
    alone = coloured_noise(search, declared) if noise and found.effects else noise
    if alone is not None:
        return Conclusion("coloured noise", coloured_noise=alone)
    if noise is not None:
        return _cause(search, rounds, found, where, noise)
    if not found.effects:
        return Conclusion("unexplained")
    return Conclusion("proxies", contenders=search.contenders(found, rounds, INSEPARABLE))


def _cause(
    search: Search, rounds: tuple[Round, ...], found: Fitted, where: Mapping[str, Where], noise: ColouredNoise | None
) -> Conclusion:
    """Whether effects that leave nothing but noise, white unless it is given, are to be called the cause."""
    effects = tuple(search.bench.effects[name] for name in found.effects)
    contenders = search.contenders(found, rounds, SETTLED * (noise.inflation if noise else 1.0))
    doubts = parts_of_one(effects), act_elsewhere(effects, where["before"]), unsettled(contenders, rounds)
    return Conclusion("proxies" if any(doubts) else "explained", None, noise, contenders, *doubts)


def stands_out(where: Where, level: float) -> bool:
    """Whether a disturbance of free form, at one of the places, explains more of a residual than it would of white noise.

    It asks more than that the past of the residual predict little of it: what is slow and small passes there.
    """
    chances = [float(chi2.sf(one.score, one.dof)) for one in where.places if one.dof]
    return min(chances, default=1.0) < level / max(len(chances), 1)


def parts_of_one(effects: tuple[Effect, ...]) -> tuple[str, ...]:
    """Names of effects that, being of different shapes, only together make up a function of the same signals in one place.

    A series of terms is a way to write a function; a kink, a friction and a cubic that it takes to say what one signal does are
    not three causes, and a delay with a lag says that an input is late in a way of which two things are known.
    """
    groups: dict[tuple, list[Effect]] = {}
    for effect in effects:
        if effect.signals_used:
            groups.setdefault((effect.place, effect.signals_used), []).append(effect)
    mixed = [group for group in groups.values() if len(group) > 1 and not all(effect.terms for effect in group)]
    return tuple(effect.name for group in mixed for effect in group)


def act_elsewhere(effects: tuple[Effect, ...], where: Where) -> bool:
    """Whether most of the effects act in places that explain clearly less of the residual than the best one does.

    What predicts well may still be of another kind than the cause: two late sensors for a late input. Only equations, inputs and
    sensors are held against it; what acts through a coefficient or a parameter may move several equations, and so does what acts
    between two parts, a function of the same signals in the equation of each.
    """
    if act_between(effects):
        return False
    told = [effect.place for effect in effects]
    where = where._replace(places=tuple(one for one in where.places if one.kind != "air"))  # no effect is a gust
    rivals = where.rivals(NEAR if len(set(told)) == 1 else NEAR_OF_SEVERAL)
    known, close = ({f"{PLACES[one.kind]} {one.name}" for one in some} for some in (where.places, rivals))
    return set(told) <= known and 2 * sum(place not in close for place in told) > len(told)


def act_between(effects: tuple[Effect, ...]) -> bool:
    """Whether the effects are one action between two parts: of the same difference of signals, in the equations of both."""
    places, signals = {effect.place for effect in effects}, {effect.signals_used for effect in effects}
    alike = len(signals) == 1 and all("-" in signal for one in signals for signal in one)
    return alike and len(places) == len(effects) > 1 and all(place.startswith(PLACES["equation"]) for place in places)


def unsettled(contenders: tuple[Rival, ...], rounds: tuple[Round, ...]) -> tuple[str, ...]:
    """Names of the contenders that these records do not refute, although they are of another shape.

    A faint effect is fitted to within the noise by whatever resembles it. Where the library's nearest other shape is not
    clearly worse, a shape that the library lacks could be the cause as well.
    """
    falls = {one.came_in: one.winner.cost_fall for one in rounds if one.winner}
    return tuple(one.name for one in contenders if abs(one.chi_square) > ALIKE * (falls[one.instead_of] or 0.0))


def _above_known_noise(found: Fitted, bench: Workbench, level: float) -> bool:
    """Whether the residual's whitened sum of squares is larger than known noise allows (chi-square)."""
    mask = np.asarray(bench.records.mask)
    deviation = np.sqrt(np.diagonal(np.asarray(found.fit.noise)))
    white = np.asarray(found.fit.residuals) / deviation
    return bool(chi2.sf(np.sum(white[mask] ** 2), int(mask.sum()) - len(found.columns)) < level)


def verdict(conclusion: Conclusion, sentences: tuple[str, ...], rivals: tuple[Rival, ...], left: Where) -> str:
    """The outcome in a sentence or two.

    Args:
        conclusion: what may be claimed.
        sentences: of the effects that are in.
        rivals: what the records cannot tell from them.
        left: where what is left sits.
    """
    what = "; ".join(sentences)
    names = ", ".join(rival.name for rival in rivals)
    also = f" (these records cannot tell it from: {names})" if rivals and not conclusion.unsettled else ""
    stays = "What stays after them is more than noise."
    if conclusion.parts:
        stays = f"Together {' and '.join(conclusion.parts)} make up one function, and its form is not settled."
    elif conclusion.elsewhere:
        stays = "They leave nothing but noise, but act elsewhere than where the residual sits."
    elif conclusion.unsettled:
        nearly = ", ".join(conclusion.unsettled)
        stays = f"What stays is noise, but these records do not settle the form: {nearly} would do nearly as well."
    noise = conclusion.coloured_noise or "noise"
    sits = " or the ".join(f"{one.kind} {one.name}" for one in left.rivals())
    return {
        "nothing missing": "Nothing is missing: the residual is consistent with noise, and no candidate explains any of it.",
        "explained": f"The model lacked: {what}{also}. With it the residual is consistent with {noise}.",
        "proxies": f"Something is missing; the best proxies are: {what}{also}. {stays}",
        "unexplained": f"Something is missing here, and nothing in the library explains it. It sits in the {sits}.",
        "process noise": f"No term is missing that these records could show: {conclusion.process_noise}",
        "coloured noise": "No term is missing that these records could show: the residual is consistent with "
        f"{conclusion.coloured_noise}.",
    }[conclusion.outcome]
