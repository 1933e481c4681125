"""Sentences and the table of a search; no other file of the search has any."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from ..diagnosis.heldout_error import mean_log
from ..effects.augmented import split_effects
from .assess import Assessment, Check, Objection
from .evidence import Decision
from .fit import LoopFit
from .hypothesis import Coloured, NoiseHypothesis, RandomForces, White
from .outcome import Outcome
from .search import SearchTree, Step

DECISIONS = {
    Decision.BETTER: "better",
    Decision.CHECK_WORSE: "predicts the check records worse",
    Decision.UNDETERMINED: "its gain is not determined",
    Decision.DEGENERATE: "on a bound where it has no effect",
    Decision.NOT_SIGNIFICANT: "not significant",
}
NO_EFFECT = (
    "No effect is missing that these records could show: the residual is consistent with {}."
)
MOST_STEPS = 12  # chosen: rows of the table


def noise_words(noise: NoiseHypothesis) -> str:
    """Return a noise model in words."""
    if isinstance(noise, Coloured):
        return f"coloured sensor noise of order {noise.order}"
    if isinstance(noise, RandomForces):
        places = [f"the equation of {name}" for name in noise.equations] + [*noise.air]
        return f"random forces in {' and '.join(places)}"
    return "white noise" if isinstance(noise, White) else noise.words


def verdict_words(best: LoopFit, assessment: Assessment) -> str:
    """Return the outcome in a sentence or two."""
    effects = effect_words(best)
    noise = noise_words(best.hypothesis.noise)
    sentence = {
        Outcome.NOTHING_MISSING: f"Nothing is missing: the residual is consistent with {noise}, "
        "and no candidate explains any of it.",
        Outcome.EXPLAINED: f"The model lacked: {effects}. With it the residual is consistent with "
        f"{noise}.",
        Outcome.PROXIES: f"Something is missing; the best proxies are: {effects}.",
        Outcome.UNEXPLAINED: "Something is missing, and nothing in the library explains it. The "
        f"residual acts at: {place_words(assessment)}.",
        Outcome.COLOURED_NOISE: NO_EFFECT.format(noise),
        Outcome.PROCESS_NOISE: NO_EFFECT.format(noise),
    }[assessment.outcome]
    return " ".join([sentence, *map(objection_words, assessment.objections)])


def effect_words(best: LoopFit) -> str:
    """Return the effects of a fit, described at their estimates, repeated ones once."""
    estimated = split_effects(best.model_and_free[0])[1] if best.effects else ()
    known = set(best.effects)
    counts = Counter(effect.card.description for effect in estimated if effect.name in known)
    return "; ".join(w if n == 1 else f"{w} ({n} of them)" for w, n in counts.items())


def worse_words(test: str, channels: Sequence[str], beyond: Sequence[str]) -> str:
    """Return a caveat for test records that are predicted worse with the effects.

    Args:
        test: name of the set.
        channels: outputs whose error grows.
        beyond: inputs that exceed their range in the fitted records.
    """
    outside = f", in which {', '.join(beyond)} exceeds its range in the fitted records"
    return (
        f"But the error on {test} grows with it ({', '.join(channels)}): it does not carry over to "
        f"these records{outside if beyond else ''}."
    )


def place_words(assessment: Assessment) -> str:
    """Return the places near the best one."""
    if assessment.where is None:
        return "no place"
    return " or ".join(place.location.label for place in assessment.where.near_best())


def objection_words(objection: Objection) -> str:
    """Return the objection of a check as a sentence."""
    names = ", ".join(objection.names)
    numbers = ", ".join(
        f"{name} ({number:.3g})"
        for name, number in zip(objection.names, objection.numbers, strict=False)
    )
    return {
        Check.NOISE_LIKE: "The residual that remains is more than noise"
        + (f"; it depends on {names}." if names else "."),
        Check.ONE_FUNCTION: f"Together {names} make up one function, whose form is not settled.",
        Check.IN_PLACE: f"The residual of the declared model acts elsewhere than {names}.",
        Check.UNIT_GAIN: f"An effect that is absent or present has another gain than one: "
        f"{numbers}.",
        Check.ALTERNATIVE: f"Other hypotheses fit nearly as well, with chi-square larger by: "
        f"{numbers}.",
        Check.BORNE_OUT: f"On the complete training records it is insignificant: {names}.",
        Check.CARRIES_OVER: f"The error of test records grows, by the logarithm: {numbers}.",
    }[objection.check]


def next_best_words(tree: SearchTree) -> str:
    """Return the next best hypothesis and how much worse it is."""
    others = tree.alternatives()
    if not others:
        return "No other hypothesis was fitted."
    other, worse = others[0]
    effects = " and ".join(other.effects) or "no effect"
    noise = noise_words(other.hypothesis.noise)
    return f"Next best: {effects} with {noise}, worse by {worse:.1f} in chi-square."


def table(tree: SearchTree) -> str:
    """Return the refits of a search, best first, and the estimates of the best hypothesis."""
    header = f"{'chi-square falls by':>20} {'required':>9} {'check':>7}  hypothesis: decision"
    rows = sorted(tree.steps, key=lambda step: step.fit.cost)[:MOST_STEPS]
    lines = [header, *map(_row, rows), "", f"{'parameter':<40} {'value':>12} {'std. error':>12}"]
    lines += [f"{n:<40} {v:>12.5g} {e:>12.3g}" for n, (v, e) in tree.best.estimates.items()]
    return "\n".join(lines)


def error_words(before: LoopFit, after: LoopFit, tests) -> str:
    """Return the ratio of the errors on test records after and before, by set."""
    parts = []
    for name, records in tests.items():
        ratio = np.exp(mean_log(after.predict(records)) - mean_log(before.predict(records)))
        parts.append(f"Error on {name}: {ratio:.3g} times the error of the declared model.")
    return "\n".join(parts)


def _row(step: Step) -> str:
    comparison = step.comparison
    effects = ", ".join(step.fit.effects) or "no effect"
    words = f"{effects} with {noise_words(step.fit.hypothesis.noise)}"
    numbers = f"{comparison.fall:>20.1f} {comparison.required:>9.1f} {comparison.check_fall:>7.3f}"
    return f"{numbers}  {words}: {DECISIONS[comparison.decision]}"
