"""What a loop may claim: the gate between an effect that explains and one that only helps, and the
words for it.
"""

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.stats import chi2

from ..data.record import Record
from ..diagnosis.localise import LocalisationResult
from ..diagnosis.validation import Prediction
from ..loop.heldout_error import (
    difference_error,
    mean_log,
    mean_log_of,
    observed_channels,
    of_channel,
    uncertainty,
)
from ..loop.thresholds import INSEPARABLE, SETTLED
from .doubts import Doubts, doubts_about
from .fit import Fitted
from .outcome import Outcome
from .rounds import Alternative, Round
from .search import Search
from .study import ColouredNoise, RandomForces, Side
from .unpredictable import act_on_the_motion, coloured_noise, random_forces
from .workbench import Workbench

MORE = "Take more manoeuvres to fit and to check."
SHOWN = 3.0  # standard errors by which a single channel's error must grow: there may be a dozen
# of its range in the records that were fitted, from which on an input runs further in others
FURTHER = 0.1


class Conclusion(NamedTuple):
    """What a loop may claim.

    Attributes:
        outcome: as in `Study`.
        process_noise: the random forces where these are it.
        coloured_noise: the noise of sensors, where that is what stays.
        contenders: what fits hardly worse in the place of what was added.
        doubts: why what was added may not be the cause, although it leaves nothing but noise.
    """

    outcome: Outcome
    process_noise: RandomForces | None = None
    coloured_noise: ColouredNoise | None = None
    contenders: tuple[Alternative, ...] = ()
    doubts: Doubts = Doubts()


def conclude(
    search: Search,
    rounds: tuple[Round, ...],
    declared: Fitted,
    found: Fitted,
    where: Mapping[str, LocalisationResult],
) -> Conclusion:
    """Whether the residual is consistent with noise after what was added, white or coloured, or
    with random forces alone.

    Args:
        search: with its workbench and options.
        rounds: what was tried.
        declared, found: the declared model's fit, and the one with what was added.
        where: the places of the residual `before` and `after`, of these two.
    """
    last = rounds[-1]
    fires = any(min(one.score, one.significance) > last.threshold for one in last.candidates)
    coloured = not search.judge.looks_like_noise(last.predictable)
    if search.bench.likelihood.noise.is_known:
        coloured = coloured or _above_known_noise(found, search.bench, search.options.level)
    if found.effects:
        coloured = coloured or stands_out(where["after"], search.options.level)
    if not (coloured or fires):
        return (
            _cause(search, rounds, found, where, None)
            if found.effects
            else Conclusion(Outcome.NOTHING_MISSING)
        )
    forces = random_forces(search, declared, where["before"])
    if forces is not None:
        return Conclusion(Outcome.PROCESS_NOISE, forces)
    noise = coloured_noise(search, found)
    # A filter that knows the noise's memory tells what is slow from it better than a score does
    # that was corrected for it.
    alone = coloured_noise(search, declared) if noise and found.effects else noise
    if alone is not None:
        return Conclusion(Outcome.COLOURED_NOISE, coloured_noise=alone)
    if noise is not None and not act_on_the_motion(search, found, where["after"], noise.gain):
        return _cause(search, rounds, found, where, noise)
    if not found.effects:
        return Conclusion(Outcome.UNEXPLAINED)
    return Conclusion(Outcome.PROXIES, contenders=search.contenders(found, rounds, INSEPARABLE))


def _cause(
    search: Search,
    rounds: tuple[Round, ...],
    found: Fitted,
    where: Mapping[str, LocalisationResult],
    noise: ColouredNoise | None,
) -> Conclusion:
    """Whether effects that leave nothing but noise, white unless it is given, are to be called the
    cause.
    """
    inflation = noise.inflation if noise else 1.0
    contenders = search.contenders(found, rounds, SETTLED * inflation)
    doubts = doubts_about(search.bench, found, rounds, contenders, where["before"], inflation)
    outcome = Outcome.PROXIES if any(doubts) else Outcome.EXPLAINED
    return Conclusion(outcome, None, noise, contenders, doubts)


def not_borne_out(
    conclusion: Conclusion, effects: tuple[str, ...], dropped: tuple[str, ...]
) -> Conclusion:
    """What may be claimed where an estimate on more records takes effects out again.

    Args:
        conclusion: what might be claimed before.
        effects, dropped: what is left, and what went out.
    """
    if not effects:
        return Conclusion(Outcome.UNEXPLAINED)
    doubts = (
        Doubts(dropped=dropped) if conclusion.outcome is Outcome.EXPLAINED else conclusion.doubts
    )
    return conclusion._replace(outcome=Outcome.PROXIES, coloured_noise=None, doubts=doubts)


def stands_out(where: LocalisationResult, level: float) -> bool:
    """Whether a disturbance of free form, at one of the places, explains more of a residual than it
    would of white noise.

    It asks more than that the past of the residual predict little of it: what is slow and small
    passes there.
    """
    places = [one for one in where.places if one.dof]
    scores, dofs = (np.array([getattr(one, name) for one in places]) for name in ("score", "dof"))
    chances = np.asarray(jax.jit(chi2.sf)(scores, dofs * 1.0)).tolist()
    return min(chances, default=1.0) < level / max(len(chances), 1)


def _above_known_noise(found: Fitted, bench: Workbench, level: float) -> bool:
    """Whether the residual's whitened sum of squares is larger than known noise allows
    (chi-square).
    """
    mask = np.asarray(bench.records.mask)
    triangle = np.linalg.cholesky(np.asarray(found.fit.noise))
    white = np.where(mask, np.asarray(found.fit.residuals), 0.0) @ np.linalg.inv(triangle).T
    unknown = len(found.columns) + found.fit.parameters.rows.size
    return bool(chi2.sf(np.sum(white**2), max(int(mask.sum()) - unknown, 1)) < level)


def verdict(
    conclusion: Conclusion,
    sentences: tuple[str, ...],
    rivals: tuple[Alternative, ...],
    left: LocalisationResult,
) -> str:
    """The outcome in a sentence or two.

    Args:
        conclusion: what may be claimed.
        sentences: of the effects that are in.
        rivals: what the records cannot tell from them.
        left: where what is left sits.
    """
    count = Counter(sentences)
    what = "; ".join(
        one if times == 1 else f"{one} ({times} of them)" for one, times in count.items()
    )
    # one may stand in the place of several
    names = ", ".join(dict.fromkeys(rival.name for rival in rivals))
    also = (
        f" (these records cannot tell it from: {names})"
        if rivals and not conclusion.doubts.unsettled
        else ""
    )
    stays = str(conclusion.doubts) or "What stays after them is more than noise."
    noise = conclusion.coloured_noise or "noise"
    sits = " or the ".join(one.location.label for one in left.near_best())
    return {
        Outcome.NOTHING_MISSING: "Nothing is missing: the residual is consistent with noise, "
        "and no candidate explains any of it.",
        Outcome.EXPLAINED: f"The model lacked: {what}{also}. With it the residual is consistent "
        f"with {noise}.",
        Outcome.PROXIES: f"Something is missing; the best proxies are: {what}{also}. {stays}",
        Outcome.UNEXPLAINED: "Something is missing here, and nothing in the library explains it. "
        f"It sits in the {sits}.",
        Outcome.PROCESS_NOISE: "No term is missing that these records could show: "
        f"{conclusion.process_noise}",
        Outcome.COLOURED_NOISE: "No term is missing that these records could show: the residual is "
        "consistent with "
        f"{conclusion.coloured_noise}.",
    }[conclusion.outcome]


def not_carried_over(
    before: Side,
    after: Side,
    effects: tuple[str, ...],
    rounds: tuple[Round, ...],
    tests: Mapping[str, Record],
    used: Record,
) -> tuple[str, ...]:
    """Of each set of test records what was added predicts worse, by more than the scatter: all of
    it, some channels, or what came in late.

    Args:
        before, after: the model without what was added and with it.
        effects, rounds: names of what was added, and how it came in.
        tests: records by name of set.
        used: those that were fitted.
    """
    told = []
    for name, old in before.tests.items():
        new = after.tests[name]
        if mean_log(new) - mean_log(old) > difference_error(old, new):
            channels = [one for one, rms in after.rms[name].items() if rms > before.rms[name][one]]
            outside = ", ".join(beyond(used, tests[name]))
            further = f", in which {outside} runs further than in those that were fitted"
            told.append(
                f"But the error on {name} grows with it ({', '.join(channels)}): what was added "
                f"does not carry over to these records{further if outside else ''}. {MORE}"
            )
        else:
            told += (*grown(name, old, new, used.outputs), *late(name, new, effects, rounds))
    return tuple(told)


def grown(name: str, old: Prediction, new: Prediction, outputs: tuple[str, ...]) -> tuple[str, ...]:
    """The words for single channels of a set of test records that are predicted worse, where all
    together are not.

    Args:
        name: of the set.
        old, new: predictions without what was added and with it.
        outputs: names of the channels.
    """
    found = []
    for index in map(int, np.flatnonzero(observed_channels(new))):
        before, after = (of_channel(one, index) for one in (old, new))
        rise = mean_log(after) - mean_log(before)
        if rise > SHOWN * difference_error(before, after):
            found.append(f"{outputs[index]} by {np.expm1(rise):.0%}")
    return (f"But the error on {name} grows with it in {' and '.join(found)}.",) if found else ()


def late(
    name: str, test: Prediction, effects: tuple[str, ...], rounds: tuple[Round, ...]
) -> tuple[str, ...]:
    """The words for a set of test records that an earlier round predicted better than the last, by
    more than the scatter of the last; none where there is none.

    Args:
        name: of the set.
        test: the last prediction of it.
        effects: that are in at last.
        rounds: by which they came in; of the errors at the beginning of each only those behind the
            first are asked.
    """
    known = observed_channels(test)
    errors = [
        mean_log_of(np.array([*one.errors[f"test {name}"].values()])[known]) for one in rounds[1:]
    ]
    if not errors or not mean_log(test) - min(errors) > uncertainty(test):
        return ()
    best = int(np.argmin(errors))
    new = [one for one in effects if one not in rounds[1 + best].effects]
    less = 1.0 - np.exp(min(errors) - mean_log(test))
    words = (
        f"But after round {1 + best}, without {', '.join(new)}, the error on {name} was "
        f"{less:.0%} smaller"
    )
    return (
        (f"{words}: what came in later does not carry over to these records. {MORE}",)
        if new
        else ()
    )


def beyond(used: Record, test: Record) -> tuple[str, ...]:
    """Inputs that leave the range they had in the records that were fitted, by more than a tenth of
    it.
    """
    low, high = jnp.min(used.u, axis=(0, 1)), jnp.max(used.u, axis=(0, 1))
    more = jnp.maximum(low - jnp.min(test.u, axis=(0, 1)), jnp.max(test.u, axis=(0, 1)) - high)
    return tuple(
        name for name, far in zip(used.inputs, more > FURTHER * (high - low), strict=True) if far
    )
