"""Tables of a study as rows of words, for the page."""

from typing import NamedTuple

import numpy as np

from ..diagnosis.residual_report import ResidualReport
from ..effects.augmented import split_effects
from ..estimation.result import Estimate
from ..study.rounds import Candidate, Round
from ..study.study import Study
from ..study.wording import second_opinion_words
from .equations import equation
from .words import ABSENT, display_unit, number, percent, raised, unit_words, with_error

MOST_PLACES = 8  # rows of the table of places (chosen)
MOST_CORRELATED = 15  # parameters of the table of correlations (chosen)


class CorrelationRow(NamedTuple):
    """Correlations of a parameter with those before it and itself, in words."""

    name: str
    values: tuple[str, ...]


class ParameterRow(NamedTuple):
    """One parameter: name, estimates before and after, unit."""

    name: str
    before: str
    after: str
    unit: str


class EffectRow(NamedTuple):
    """One added effect: description, equation, name in the code, place, parameters and
    alternatives.
    """

    description: str
    equation: str
    name: str
    place: str
    parameters: tuple[ParameterRow, ...]
    alternatives: tuple[str, ...]


class CandidateRow(NamedTuple):
    """One refitted candidate: description with the effects it replaces, score, result of the refit,
    and verdict.
    """

    description: str
    score: str
    cost_fall: str
    check_change: str
    verdict: str
    role: str


class RoundRow(NamedTuple):
    """One round: effects before, changes, refitted candidates, initial errors, second opinion."""

    number: int
    effects: tuple[str, ...]
    added: str
    dropped: tuple[str, ...]
    candidates: tuple[CandidateRow, ...]
    others: int
    errors: tuple[tuple[str, ...], ...]
    second_opinion: str


class RemainsRow(NamedTuple):
    """Residual of one channel: share that is predictable from its past, and related signals."""

    channel: str
    before: str
    after: str
    follows_before: str
    follows_after: str


class PlaceRow(NamedTuple):
    """One place: shares of the residual explained by a disturbance there; True if near the best."""

    place: str
    before: str
    after: str
    first: bool


def correlation_rows(estimate: Estimate) -> tuple[CorrelationRow, ...]:
    """Return the correlations of the shared parameters, the lower half; none of more than
    `MOST_CORRELATED` parameters.

    Args:
        estimate: the estimate of one case.
    """
    r = np.asarray(estimate.correlation)
    names = estimate.names if len(estimate.names) <= MOST_CORRELATED else ()
    return tuple(
        CorrelationRow(raised(name), tuple(_correlation(value) for value in r[k, : k + 1]))
        for k, name in enumerate(names)
    )


def _correlation(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else ABSENT


def eigenvalues(estimate: Estimate) -> str:
    """Return the eigenvalues of the scaled information in words, the largest first."""
    values = np.sort(np.asarray(estimate.spectrum.eigenvalues))[::-1]
    return ", ".join(number(float(value), 3) for value in values)


def effect_rows(study: Study) -> tuple[EffectRow, ...]:
    """Return the added effects with their parameters.

    Args:
        study: the study.

    Returns:
        One row for each effect, in the order of addition.
    """
    estimate, rows = study.after.estimate, []
    effects = split_effects(study.after.model)[1]
    equations = {effect.name: raised(equation(effect)) for effect in effects}
    for name, description in zip(study.effects, study.descriptions, strict=True):
        parameters = tuple(
            ParameterRow(parameter.removeprefix(f"{name}."), "", value, unit)
            for parameter, (value, unit) in _values(estimate).items()
            if parameter.startswith(f"{name}.")
        )
        alternatives = tuple(
            raised(effect.description) for effect in study.alternatives if name in effect.instead_of
        )
        words = raised(description), equations[name]
        rows.append(EffectRow(*words, name, _place(study, name), parameters, alternatives))
    return tuple(rows)


def _place(study: Study, name: str) -> str:
    """Return the place of an added effect, in words."""
    candidates = [each for search_round in study.rounds for each in search_round.candidates]
    return next((each.place for each in candidates if each.name == name), "")


def parameter_rows(study: Study) -> tuple[ParameterRow, ...]:
    """Return the declared parameters before and after.

    Args:
        study: the study.

    Returns:
        One row for each.
    """
    before, after = _values(study.before.estimate), _values(study.after.estimate)
    return tuple(
        ParameterRow(
            raised(name),
            value,
            after[name][0] if name in after else ABSENT,
            unit,
        )
        for name, (value, unit) in before.items()
    )


def round_rows(study: Study) -> tuple[RoundRow, ...]:
    """Return the course of the search, round by round.

    Args:
        study: the study.

    Returns:
        One row for each round.
    """
    rows = []
    for index, search_round in enumerate(study.rounds, 1):
        refitted = _listed_candidates(search_round)
        opinion = search_round.second_opinion
        rows.append(
            RoundRow(
                number=index,
                effects=tuple(raised(name) for name in search_round.effects),
                added=_description(search_round, search_round.added) if search_round.added else "",
                dropped=tuple(raised(name) for name in search_round.dropped),
                candidates=tuple(map(_candidate, refitted)),
                others=len(search_round.candidates) - len(refitted),
                errors=_errors(study, search_round),
                second_opinion=second_opinion_words(opinion, search_round.required)
                if opinion
                else "",
            )
        )
    return tuple(rows)


def remains_rows(study: Study) -> tuple[RemainsRow, ...]:
    """Return the predictable share of each channel's training residual.

    The shares are those of the first and of the last round, before a candidate is added.

    Args:
        study: the study.

    Returns:
        One row for each channel.
    """
    first = study.rounds[0].predictable
    # With effects in the model, the share belongs to the same model as the related signals.
    last = study.rounds[-1].predictable if study.effects else first
    before, after = study.residual_reports["before"], study.residual_reports["after"]
    return tuple(
        RemainsRow(
            name,
            percent(first[name]),
            percent(last[name]),
            _follows(before, name),
            _follows(after, name),
        )
        for name in study.outputs
    )


def _follows(report: ResidualReport, name: str) -> str:
    """Return the signals related to a channel's residual, in words.

    They are the most correlated signal and the variable over which its mean is not zero, if any.
    """
    j = report.tests.outputs.index(name)
    signal, correlation, lag = report.strongest_correlation(name)
    late = f" {lag} samples later" if lag else ""
    related = (
        [f"{signal} ({correlation:+.2f}{late})"] if bool(np.any(report.tests.follows[j])) else []
    )
    variable, p = report.nonlinear_dependence(name)
    if p < report.tests.level / report.maps.p_value.size:
        related.append(f"its mean changes over {'time' if variable == 't' else variable}")
    return "; ".join(related) or "nothing"


def place_rows(study: Study) -> tuple[PlaceRow, ...]:
    """Return the places of the residual, in the order of their share before.

    Args:
        study: the study.

    Returns:
        One row for each of the first places.
    """
    after = {place.location: place for place in study.localisation["after"].places}
    near = study.localisation["before"].significant(study.options.level)
    best = {place.location for place in near}
    return tuple(
        PlaceRow(
            place.location.label,
            percent(place.share),
            percent(after[place.location].share),
            place.location in best,
        )
        for place in study.localisation["before"].places[:MOST_PLACES]
    )


def decided(study: Study) -> tuple[str, ...]:
    """Return the test sets that are the check records.

    Args:
        study: the study.

    Returns:
        Names of test sets, usually none.
    """
    return tuple(name for name, records in study.tests.items() if records is study.check)


def _values(estimate: Estimate) -> dict[str, tuple[str, str]]:
    """Return each estimate with its colour-corrected standard error, and its unit, by name."""
    rows = zip(
        estimate.names,
        np.asarray(estimate.values),
        np.asarray(estimate.corrected_errors),
        estimate.units,
        strict=True,
    )
    return {
        name: (with_error(float(value), float(error)), unit_words(unit))
        for name, value, error, unit in rows
    }


def _listed_candidates(search_round: Round) -> tuple[Candidate, ...]:
    """Return the fitted candidates, and the others with half the best fitted score or more."""
    best = max(
        (
            candidate.score
            for candidate in search_round.candidates
            if candidate.cost_fall is not None
        ),
        default=np.inf,
    )
    return tuple(
        x for x in search_round.candidates if x.cost_fall is not None or x.score > best / 2
    )


def _candidate(candidate: Candidate) -> CandidateRow:
    fall, check = candidate.cost_fall, candidate.check_fall
    return CandidateRow(
        description=raised(candidate.description + candidate.replacement),
        score=number(candidate.score, 3),
        cost_fall=ABSENT if fall is None else number(fall, 3),
        check_change=ABSENT
        if check is None or not np.isfinite(check)
        else f"{100 * np.expm1(-check):+.1f} %",
        verdict=candidate.verdict,
        role="added" if candidate.added else "",
    )


def _errors(study: Study, search_round: Round) -> tuple[tuple[str, ...], ...]:
    """Return channel, unit, and the error on training and check records."""
    rows = []
    for name, unit in zip(study.outputs, study.output_units, strict=True):
        scale, shown = display_unit(unit)
        parts = (
            number(scale * search_round.errors[part][name])
            for part in ("train", "check")
            if part in search_round.errors
        )
        rows.append((name, unit_words(shown), *parts))
    return tuple(rows)


def _description(search_round: Round, name: str) -> str:
    """Return the description of a candidate."""
    return raised(
        next(
            (
                candidate.description
                for candidate in search_round.candidates
                if candidate.name == name
            ),
            name,
        )
    )
