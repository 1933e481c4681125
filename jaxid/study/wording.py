"""Sentences on a study."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..data.record import Record
from ..diagnosis.places import LocalisationResult
from ..diagnosis.validation import Prediction
from ..loop.wording import NO_PLACE
from .rounds import Round
from .second_opinion import Refusal, SecondOpinion

RANDOM_MOTION = (
    "A simulation of the test records does not contain the motion that the random forces cause, so "
    "that this error by itself does not rate a model."
)
APPROXIMATION = (
    "The model is an approximation, as an effect is missing or not certain. The standard errors do "
    "not contain its error: a true parameter can lie many of them away."
)


def runaway_words(
    model: str, tests: Mapping[str, Record], predictions: Mapping[str, Prediction]
) -> str:
    """Return a sentence on the test records on which a simulation diverges; may be empty.

    Args:
        model: the model in words.
        tests: test records by name of set.
        predictions: predictions of the model by name of set.
    """
    diverged = [
        tests[test].names[case]
        for test, prediction in predictions.items()
        for case in np.flatnonzero(~np.all(np.isfinite(prediction.residuals), axis=(1, 2)))
    ]
    if not diverged:
        return ""
    return (
        f"The {model} diverges on {', '.join(diverged)}. If a motion is unstable, drifts far, or "
        "is held by a pilot or a controller, cut the records into pieces (`jaxid.segment`, `cut` "
        "in a study file)."
    )


def round_lines(rounds: Sequence[Round]) -> list[str]:
    """Return lines on the rounds of a search.

    Args:
        rounds: the rounds.
    """
    lines = []
    for index, entry in enumerate(rounds, 1):
        added = f"added {entry.added}" if entry.added else "nothing added"
        best = max(entry.candidates, key=lambda candidate: candidate.score, default=None)
        score = f" (best score: {best.name}{best.replacement})" if best else ""
        lines.append(f"round {index}: {added}{score}")
        lines += [f"         dropped {name}" for name in entry.dropped]
        if entry.second_opinion is not None:
            words = second_opinion_words(entry.second_opinion, entry.required)
            lines.append(f"         {words}")
    return lines


def second_opinion_words(opinion: SecondOpinion | Refusal, required: float) -> str:
    """Return a second opinion in words, with the threshold of the search.

    Args:
        opinion: the second opinion, or the reason why there is none.
        required: chi-square that the search required.
    """
    if isinstance(opinion, Refusal):
        return f"no second opinion: {opinion.value}"
    limit = f"{opinion.threshold:.1f}" if np.isfinite(opinion.threshold) else "more of them"
    return (
        f"second opinion: the score {opinion.score:.1f} by chance with p = {opinion.p_value:.2g} "
        f"({opinion.draws} draws of random signs); at the level of {100 * opinion.level:.2g} % the "
        f"draws require {limit}, the search {required:.1f}"
    )


def combination_words(a: str, b: str, power: float, value: float, error: float) -> str:
    """Return a sentence on a product or ratio that is determined although neither parameter is.

    Args:
        a, b: names of the parameters.
        power: exponent of the second: 1 for a product, -1 for a ratio.
        value, error: estimate and standard error of `a * b**power`.
    """
    combined = "product" if power > 0 else "ratio"
    return (
        f"These records determine only the {combined} of {a} and {b}, {value:.4g} +- {error:.2g}, "
        "neither of them alone."
    )


def location_line(declared: LocalisationResult, level: float) -> str:
    """Return a line on the places of the residual of the declared model.

    Args:
        declared: its location.
        level: probability of a false alarm.
    """
    places = ", or ".join(
        f"{place.location.label} ({place.share:.0%})" for place in declared.significant(level)
    )
    where = f"the residual of the declared model is in the {places}" if places else NO_PLACE
    return f"where:   {where}"


def error_title(test: str) -> str:
    """Return the title of a table of errors on a set of test records.

    Args:
        test: name of the set.
    """
    return f"error on {test} (RMS, not used for fitting)"
