"""The tables of a study as rows of words, for the page to set."""

from typing import NamedTuple

import numpy as np

from ..diagnosis.reading import Reading
from ..estimation.result import Estimate
from ..study.study import Candidate, Round, Study
from .words import display_unit, number, percent, raised, unit_words, with_error

ABSENT = "n/a"
MOST_PLACES = 8


class ErrorRow(NamedTuple):
    """Error of one channel on one test set: before, after, noise, their ratio, and by how much the error fell."""

    channel: str
    unit: str
    before: str
    after: str
    noise: str
    ratio: str
    change: str


class ParameterRow(NamedTuple):
    """One parameter: name, what it was estimated at before and after, its unit, and what it is beside random forces."""

    name: str
    before: str
    after: str
    unit: str
    beside: str = ABSENT


class EffectRow(NamedTuple):
    """One effect that was found: in words, its name in the code, and its parameters."""

    sentence: str
    name: str
    place: str
    parameters: tuple[ParameterRow, ...]
    rivals: tuple[str, ...]


class CandidateRow(NamedTuple):
    """One refitted candidate: what it is, its scores, what the refit brought, and what became of it."""

    sentence: str
    score: str
    significance: str
    cost_fall: str
    check_change: str
    verdict: str
    role: str


class RoundRow(NamedTuple):
    """One round: what was in, what was added or taken out, the refitted candidates, and the errors at its beginning."""

    number: int
    effects: tuple[str, ...]
    added: str
    rivals: tuple[str, ...]
    dropped: tuple[str, ...]
    candidates: tuple[CandidateRow, ...]
    others: int
    errors: tuple[tuple[str, ...], ...]


class RemainsRow(NamedTuple):
    """What is left on one channel: the share of the training residual that its own past predicts, and what it follows."""

    channel: str
    before: str
    after: str
    follows_before: str
    follows_after: str


class PlaceRow(NamedTuple):
    """One place in words: share of the residual that a disturbance there explains, and whether it is among the first."""

    place: str
    before: str
    after: str
    first: bool


def error_rows(study: Study, test: str) -> tuple[ErrorRow, ...]:
    """Error before and after by channel, in display units.

    Args:
        study: the study.
        test: name of the test set.

    Returns:
        One row for each channel.
    """
    rows = []
    for name, unit in zip(study.outputs, study.output_units, strict=True):
        scale, shown = display_unit(unit)
        before, after, noise = (scale * x[name] for x in (study.before.rms[test], study.after.rms[test], study.noise))
        ratio = number(after / noise, 3) if noise > 0 else ABSENT
        change = after / before - 1.0 if before > 0 and np.isfinite(before) else float("nan")
        words = ABSENT if not np.isfinite(change) or not study.effects else f"{100 * change:+.0f} %"
        rows.append(ErrorRow(name, unit_words(shown), number(before), number(after), number(noise), ratio, words))
    return tuple(rows)


def effect_rows(study: Study) -> tuple[EffectRow, ...]:
    """The effects that were found, with their parameters.

    Args:
        study: the study.

    Returns:
        One row for each effect, in the order of their finding.
    """
    estimate, rows = study.after.estimate, []
    for name, sentence in zip(study.effects, study.sentences, strict=True):
        own = tuple(
            ParameterRow(parameter.removeprefix(f"{name}."), "", value, unit)
            for parameter, (value, unit) in _values(estimate).items()
            if parameter.startswith(f"{name}.")
        )
        place = next((one.place for a_round in study.rounds for one in a_round.candidates if one.name == name), "")
        rivals = tuple(raised(rival.sentence) for rival in study.rivals if name in rival.instead_of)
        rows.append(EffectRow(raised(sentence), name, place, own, rivals))
    return tuple(rows)


def parameter_rows(study: Study) -> tuple[ParameterRow, ...]:
    """The declared parameters before and after.

    Args:
        study: the study.

    Returns:
        One row for each.
    """
    before, after = _values(study.before.estimate), _values(study.after.estimate)
    beside = study.process_noise.parameters if study.process_noise else {}
    return tuple(
        ParameterRow(
            raised(name),
            value,
            after[name][0] if name in after else ABSENT,
            unit,
            f"{beside[name]:.4g}" if name in beside else ABSENT,
        )
        for name, (value, unit) in before.items()
    )


def round_rows(study: Study) -> tuple[RoundRow, ...]:
    """What happened, round by round.

    Args:
        study: the study.

    Returns:
        One row for each round.
    """
    rows = []
    for index, one in enumerate(study.rounds, 1):
        refitted = _worth_telling(one)
        rows.append(
            RoundRow(
                number=index,
                effects=tuple(raised(name) for name in one.effects),
                added=_sentence(one, one.added) if one.added else "",
                rivals=tuple(_sentence(one, name) for name in one.rivals),
                dropped=tuple(raised(name) for name in one.dropped),
                candidates=tuple(_candidate(one, candidate) for candidate in refitted),
                others=len(one.candidates) - len(refitted),
                errors=_errors(study, one),
            )
        )
    return tuple(rows)


def other_way(study: Study) -> tuple[str, ...]:
    """What was added, in this order, on the way that was given up.

    Args:
        study: the study.

    Returns:
        A sentence for each effect; none where the search was begun once.
    """
    return tuple(_sentence(one, one.added) for one in study.other_rounds if one.added)


def remains_rows(study: Study) -> tuple[RemainsRow, ...]:
    """How much of each channel's training residual is no noise, at the beginning of the first and of the last round.

    Args:
        study: the study.

    Returns:
        One row for each channel.
    """
    first = study.rounds[0].predictable
    last = study.rounds[-1].predictable if study.effects else first  # of what is in, as what follows is
    before, after = study.reading["before"], study.reading["after"]
    return tuple(
        RemainsRow(name, percent(first[name]), percent(last[name]), _follows(before, name), _follows(after, name))
        for name in study.outputs
    )


def _follows(reading: Reading, name: str) -> str:
    """The signal that a channel's residual follows and the variable over which its mean is off zero, if any."""
    j = reading.tests.outputs.index(name)
    signal, correlation, lag = reading.strongest(name)
    late = f" {lag} samples later" if lag else ""
    found = [f"{signal} ({correlation:+.2f}{late})"] if bool(np.any(reading.tests.follows[j])) else []
    variable, p = reading.bent(name)
    if p < reading.tests.level / reading.maps.p_value.size:
        found.append(f"its mean changes over {'time' if variable == 't' else variable}")
    return "; ".join(found) or "nothing"


def place_rows(study: Study) -> tuple[PlaceRow, ...]:
    """Where the residual sits, before and after, the places that explain most before first.

    Args:
        study: the study.
    """
    after = {(one.kind, one.name): one for one in study.where["after"].places}
    rivals = {(one.kind, one.name) for one in study.where["before"].rivals()}
    return tuple(
        PlaceRow(
            f"{one.kind} {one.name}",
            percent(one.share),
            percent(after[one.kind, one.name].share),
            (one.kind, one.name) in rivals,
        )
        for one in study.where["before"].places[:MOST_PLACES]
    )


def decided(study: Study) -> tuple[str, ...]:
    """Names of test sets that are the check records themselves: their errors are the very same in every round.

    Args:
        study: the study.

    Returns:
        Names of test sets, usually none.
    """
    return tuple(
        name
        for name in study.tests
        if all(_same(one.errors["check"], one.errors[f"test {name}"]) for one in study.rounds)
    )


def _same(one: dict[str, float], other: dict[str, float]) -> bool:
    """Whether two errors by channel are the very same, failed ones included."""
    return np.array_equal([*one.values()], [*other.values()], equal_nan=True)


def _values(estimate: Estimate) -> dict[str, tuple[str, str]]:
    """Estimate with its colour-corrected standard error, and unit, by name."""
    rows = zip(
        estimate.names, np.asarray(estimate.values), np.asarray(estimate.coloured_errors), estimate.units, strict=True
    )
    return {name: (with_error(float(value), float(error)), unit_words(unit)) for name, value, error, unit in rows}


def _worth_telling(one: Round) -> tuple[Candidate, ...]:
    """The candidates that were fitted, and those that were not though they scored half as high as the best of them."""
    best = max((candidate.score for candidate in one.candidates if candidate.cost_fall is not None), default=np.inf)
    return tuple(x for x in one.candidates if x.cost_fall is not None or x.score > best / 2)


def _candidate(one: Round, candidate: Candidate) -> CandidateRow:
    fall, check = candidate.cost_fall, candidate.check_fall
    role = "added" if candidate.name == one.added else "rival" if candidate.name in one.rivals else ""
    return CandidateRow(
        sentence=raised(candidate.sentence),
        score=number(candidate.score, 3),
        significance=number(candidate.significance, 3),
        cost_fall=ABSENT if fall is None else number(fall, 3),
        check_change=ABSENT if check is None or not np.isfinite(check) else f"{100 * np.expm1(-check):+.1f} %",
        verdict=candidate.verdict,
        role=role,
    )


def _errors(study: Study, one: Round) -> tuple[tuple[str, ...], ...]:
    """Channel, unit, and the error on training and check records."""
    rows = []
    for name, unit in zip(study.outputs, study.output_units, strict=True):
        scale, shown = display_unit(unit)
        parts = (number(scale * one.errors[part][name]) for part in ("train", "check") if part in one.errors)
        rows.append((name, unit_words(shown), *parts))
    return tuple(rows)


def _sentence(one: Round, name: str) -> str:
    """What a candidate is, in words."""
    return raised(next((candidate.sentence for candidate in one.candidates if candidate.name == name), name))
