"""Sentences on a search."""

from collections import Counter
from collections.abc import Iterable, Sequence

from ..effects.augmented import split_effects
from .assess import Assessment, Check, Objection
from .fit import LoopFit
from .outcome import Outcome
from .search_tree import SearchTree

# Chosen: difference of chi-square below which two fits are equal; a fit is iterated no further.
EQUAL = 0.1
STOPPED = "The search was stopped; this is its best so far."
NO_PLACE = "No place explains more of the residual than chance would."
NO_EFFECT = (
    "No effect is missing that these records could show: the residual is consistent with {}."
)


def verdict_words(tree: SearchTree, best: LoopFit, assessment: Assessment, level: float) -> str:
    """Return the outcome of a search, with its last fit, in a sentence or two.

    Args:
        tree: the search.
        best: fit of the best hypothesis.
        assessment: its assessment.
        level: probability of a false alarm of the location of the residual.
    """
    effects, noise = effect_words(best), best.hypothesis.noise.words
    near = tree.where.significant(level) if assessment.outcome is Outcome.UNEXPLAINED else ()
    places = " or ".join(place.location.label for place in near)
    where = f"The residual acts at: {places}." if places else NO_PLACE
    sentence = {
        Outcome.NOTHING_MISSING: f"Nothing is missing: the residual is consistent with {noise}, "
        "and no candidate explains any of it.",
        Outcome.EXPLAINED: f"The model lacked: {effects}. With it the residual is consistent with "
        f"{noise}.",
        Outcome.PROXIES: f"Something is missing; the best proxies are: {effects}.",
        Outcome.UNEXPLAINED: "Something is missing, and nothing in the library explains it. "
        f"{where}",
        Outcome.COLOURED_NOISE: NO_EFFECT.format(noise),
        Outcome.PROCESS_NOISE: NO_EFFECT.format(noise),
    }[assessment.outcome]
    return " ".join([sentence, *map(objection_words, assessment.objections)])


def effect_words(best: LoopFit) -> str:
    """Return the effects of a fit, described at their estimates, repeated ones once."""
    estimated = split_effects(best.model)[1] if best.effects else ()
    known = set(best.effects)
    counts = Counter(effect.card.description for effect in estimated if effect.name in known)
    return "; ".join(w if n == 1 else f"{w} ({n} of them)" for w, n in counts.items())


def held_out_words(test: str, worse: Sequence[str], beyond: Sequence[str]) -> str:
    """Return a sentence on test records that are not predicted as well as expected; may be empty.

    Args:
        test: name of the set.
        worse: outputs whose error grows with the effects.
        beyond: channels that exceed their range in the fitted records.
    """
    facts = [f"the error grows in {', '.join(worse)}"] * bool(worse)
    facts += [f"{name} exceeds its range in the fitted records" for name in beyond]
    return f"On {test} {' and '.join(facts)}." if facts else ""


def check_words(beyond: Sequence[str]) -> str:
    """Return a sentence on check records that go beyond the fitted ones.

    Args:
        beyond: channels that exceed their range in the fitted records.
    """
    names = ", ".join(beyond)
    return (
        f"The check records exceed the range of the fitted ones in {names}: an effect that acts "
        "there only cannot be found. Fit records that reach as far."
    )


def objection_words(objection: Objection) -> str:
    """Return the objection of a check as a sentence."""
    if objection.check is Check.ALTERNATIVE:
        return _alternative_words(objection)
    names = ", ".join(objection.names)
    numbers = _numbered(zip(objection.names, objection.numbers, strict=False))
    return {
        Check.NOISE_LIKE: "The residual that remains is more than noise"
        + (f"; it depends on {names}." if names else "."),
        Check.ONE_FUNCTION: f"Together {names} make up one function, whose form is not settled.",
        Check.IN_PLACE: f"The residual of the declared model acts elsewhere than {names}.",
        Check.UNIT_GAIN: f"An effect that is absent or present has another gain than one: "
        f"{numbers}.",
        Check.SPREAD: "A delay or a lag with another course in time fits better, with chi-square "
        f"smaller by: {numbers}.",
        Check.BORNE_OUT: f"On the complete training records it is insignificant: {names}.",
        Check.CARRIES_OVER: "The error of test records, in units of the training error, is: "
        f"{numbers}.",
    }[objection.check]


def _alternative_words(objection: Objection) -> str:
    """Return the hypotheses that fit as well, nearly as well, and better, in a sentence each."""
    worse = dict(zip(objection.names, objection.numbers, strict=True))
    equal = " or ".join(name for name, number in worse.items() if abs(number) < EQUAL)
    larger = _numbered((name, number) for name, number in worse.items() if number >= EQUAL)
    smaller = _numbered((name, -number) for name, number in worse.items() if number <= -EQUAL)
    sentences = (
        (equal, "These records cannot distinguish this from {}: chi-square is the same."),
        (larger, "Other hypotheses fit nearly as well, with chi-square larger by: {}."),
        (smaller, "Other hypotheses fit better, with chi-square smaller by: {}."),
    )
    return " ".join(sentence.format(names) for names, sentence in sentences if names)


def _numbered(pairs: Iterable[tuple[str, float]]) -> str:
    """Return names with their numbers in brackets."""
    return ", ".join(f"{name} ({number:.3g})" for name, number in pairs)


def next_best_words(tree: SearchTree) -> str:
    """Return the next best hypothesis and how much worse it is."""
    others = tree.alternatives()
    if not others:
        return "No other hypothesis was fitted."
    other, worse = others[0]
    effects = " and ".join(other.effects) or "no effect"
    noise = other.hypothesis.noise.words
    if abs(worse) < EQUAL:
        distance = "with the same chi-square"
    elif worse > 0:
        distance = f"worse by {worse:.1f} in chi-square"
    else:
        refused = (s.comparison for s in tree.steps if s.fit is other and not s.comparison.accepted)
        decisions = [comparison.decision.value for comparison in refused]
        why = f"refused ({decisions[-1]})" if decisions else "not chosen"
        distance = f"better by {-worse:.1f} in chi-square, but {why}"
    return f"Next best: {effects} with {noise}, {distance}."
