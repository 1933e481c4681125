"""Summary of many studies: shares that are compared with the goals, and one row per scenario."""

import enum
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import beta

from benchmarks.missing_effects.scenarios import HARDER, KINDS
from jaxid.loop.outcome import Outcome

Result = dict[str, Any]
FALSE = 0.01  # stated level: share of studies with a false effect
WITHIN = 1.05  # chosen: error on the test records over the error of the true model
# Chi-square by which a cause must fit worse than the truth to be refuted: five standard deviations.
REFUTED = 25.0


class Share(NamedTuple):
    """A count out of many, with the 95 % interval of its probability (Clopper & Pearson 1934)."""

    count: int
    of: int

    @property
    def value(self) -> float:
        """The share; NaN if `of` is zero."""
        return self.count / self.of if self.of else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end of the 95 % interval."""
        low = float(beta.ppf(0.025, self.count, self.of - self.count + 1)) if self.count else 0.0
        high = (
            float(beta.ppf(0.975, self.count + 1, self.of - self.count))
            if self.count < self.of
            else 1.0
        )
        return low, high


class Goal(NamedTuple):
    """A share and its goal.

    Attributes:
        name: name of the counted property.
        share: share of the studies with it.
        goal: required share.
        at_most: True if the goal is an upper limit.
        met: True if the share reaches the goal; for false discoveries, True if the interval of the
            share reaches down to the level.
    """

    name: str
    share: Share
    goal: float
    at_most: bool
    met: bool


def share(results: Iterable[Result], is_so: Callable[[Result], bool]) -> Share:
    """Return the share of results for which `is_so` is True; a failed study never counts."""
    flags = [not one["failed"] and bool(is_so(one)) for one in results]
    return Share(sum(flags), len(flags))


def split(results: Sequence[Result]) -> dict[str, list[Result]]:
    """Return the results by kind; studies with the effect left out are `removed`."""
    parts: dict[str, list[Result]] = {"removed": [one for one in results if one["removed"]]}
    for kind in (*KINDS, HARDER):
        parts[kind] = [one for one in results if one["kind"] == kind and not one["removed"]]
    return parts


def identifiable(one: Result) -> bool:
    """Return True if all planted effects are significant in the true model's fit.

    A failed study counts as identifiable, so that it lowers the shares.
    """
    return bool(one["failed"]) or all(one["identifiable"])


def goals(results: Sequence[Result]) -> list[Goal]:
    """Return all shares with a goal for which there are studies."""
    parts = split(results)
    placed, no_cause = _without(parts["removed"], results)
    singles = [one for one in parts["single"] if identifiable(one)]
    doubles = [one for one in parts["double"] if identifiable(one)]
    both = singles + doubles
    wanted = [
        ("right effect first", share(singles, lambda one: one["first_right"]), 0.95),
        (
            "right effect named in the top three",
            share(singles, lambda one: all(one["top_three"])),
            1.0,
        ),
        (
            "error on test records within 5 % of the true model's",
            share(both, lambda one: one["ratio"] < WITHIN),
            1.0,
        ),
        ("both effects of a double found", share(doubles, lambda one: all(one["in"])), 0.9),
        ("effect not in the library: place right", placed, 0.9),
        ("effect not in the library: no cause named", no_cause, 0.9),
        (
            "the same, or one that fits no worse than the truth",
            share(parts["removed"], _unrefuted(results)),
            0.9,
        ),
        (
            "gusts told as such",
            share(parts["process"], lambda one: outcome_of(one) is Outcome.PROCESS_NOISE),
            0.95,
        ),
        ("gusts: no cause named", share(parts["process"], names_no_cause), 0.95),
        ("harder truths: no wrong cause named", share(parts[HARDER], is_honest), 0.9),
    ]
    figures = [
        Goal(name, counted, goal, False, counted.value >= goal)
        for name, counted, goal in wanted
        if counted.of
    ]
    controls = [one for one in parts["control"] if not one["failed"]]
    false = share(controls, lambda one: bool(one["effects"]))
    if false.of:
        figures.append(
            Goal(
                "false effect where nothing is missing",
                false,
                FALSE,
                True,
                false.interval[0] <= FALSE,
            )
        )
    failed = share(results, lambda one: False)
    failed = Share(sum(bool(one["failed"]) for one in results), failed.of)
    return [*figures, Goal("studies that failed", failed, 0.0, True, failed.count == 0)]


class Answer(enum.Enum):
    """Answer of a study to a harder truth; the value is its column in the table.

    Attributes:
        RIGHT: all planted effects that the records determine are named, and no other.
        PART: some of them are named, and no other.
        DOUBT: something is missing, and no cause is named: the right answer if the library lacks
            the truth.
        UNSEEN: nothing is named, and the records do not determine any planted effect.
        WRONG: another effect is named, or a missing one is denied.
        FAILED: the study failed.
    """

    RIGHT = "right"
    PART = "part"
    DOUBT = "doubt"
    UNSEEN = "unseen"
    WRONG = "wrong"
    FAILED = "failed"


def answer(one: Result) -> Answer:
    """Return the answer of a study to a harder truth."""
    if one["failed"]:
        return Answer.FAILED
    outcome = outcome_of(one)
    if outcome in (Outcome.PROXIES, Outcome.UNEXPLAINED):
        return Answer.DOUBT
    if outcome is not Outcome.EXPLAINED:
        return Answer.WRONG if any(one["identifiable"]) else Answer.UNSEEN
    if one["wrong"]:
        return Answer.WRONG
    pairs = zip(one["in"], one["identifiable"], strict=True)
    return Answer.RIGHT if all(has or not seen for has, seen in pairs) else Answer.PART


def is_honest(one: Result) -> bool:
    """Return True if a study of a harder truth names no wrong cause and denies nothing."""
    return answer(one) not in (Answer.WRONG, Answer.FAILED)


def outcome_of(one: Result) -> Outcome:
    """Return the outcome of a study as an `Outcome`."""
    return Outcome(one["outcome"])


def names_no_cause(one: Result, unseen: bool = False) -> bool:
    """Return True if a study makes no false claim.

    "Nothing missing" is a false claim unless the planted effect is not significant (`unseen`).
    """
    if unseen:
        return not one["effects"]
    outcome = outcome_of(one)
    if outcome in (Outcome.PROCESS_NOISE, Outcome.COLOURED_NOISE):
        return one["kind"] == "process"
    return outcome not in (Outcome.EXPLAINED, Outcome.NOTHING_MISSING)


def unseen_in(results: Sequence[Result]) -> Callable[[Result], bool]:
    """Return a predicate: the true model's fit of the flight has no significant planted effect."""
    with_library = [one for one in results if not one["removed"] and one.get("identifiable")]
    flights = {_flight(one) for one in with_library if not any(one["identifiable"])}
    return lambda one: _flight(one) in flights


def _unrefuted(results: Sequence[Result]) -> Callable[[Result], bool]:
    """Return a predicate: a study names no cause, or one that fits almost as well as the truth."""
    truths = {
        _flight(one): one["chi_square"]
        for one in results
        if not one["removed"] and "chi_square" in one
    }
    unseen = unseen_in(results)
    return lambda one: (
        names_no_cause(one, unseen(one)) or truths.get(_flight(one), np.inf) - one["fall"] < REFUTED
    )


def _without(removed: Sequence[Result], results: Sequence[Result]) -> tuple[Share, Share]:
    """Return the shares of studies without their effect in the library that meet two conditions.

    The first share is of studies with the right place, among those with a significant effect; the
    second is of studies that name no cause.
    """
    unseen = unseen_in(results)
    place = share([one for one in removed if not unseen(one)], lambda one: one["place_right"])
    return place, share(removed, lambda one: names_no_cause(one, unseen(one)))


def _flight(one: Result) -> tuple:
    return one["system"], one["scenario"], one["seed"]


class Row(NamedTuple):
    """Results of one scenario over its seeds.

    Attributes:
        system, scenario, kind: names of the scenario.
        studies, failed: numbers of studies.
        chi_square: median of twice the cost reduction by the true model.
        identifiable, first, top, found: shares of the studies; the last three count identifiable
            studies only.
        wrong: mean number of added effects that were not planted.
        ratio: median error over the error of the true model, after the loop and before.
        outcomes: number of studies by outcome.
        place, no_cause: shares of the studies without the effect in the library.
        naive: share in which a regression of the residual begins with the right signal.
        naive_terms: mean number of its terms.
        seconds: median time of a study [s].
    """

    system: str
    scenario: str
    kind: str
    studies: int
    failed: int
    chi_square: float
    identifiable: Share
    first: Share
    top: Share
    found: Share
    wrong: float
    ratio: tuple[float, float]
    outcomes: dict[str, int]
    place: Share
    no_cause: Share
    naive: Share
    naive_terms: float
    seconds: float


def rows(results: Sequence[Result]) -> list[Row]:
    """Return one row for each scenario, in the order of first results."""
    keys = dict.fromkeys((one["system"], one["scenario"]) for one in results)
    return [
        _row(key, [one for one in results if (one["system"], one["scenario"]) == key])
        for key in keys
    ]


def _row(key: tuple[str, str], results: list[Result]) -> Row:
    with_library = [one for one in results if not one["removed"]]
    removed = [one for one in results if one["removed"]]
    good = [one for one in with_library if not one["failed"]]
    identifiable_studies = [one for one in with_library if identifiable(one)]
    place, no_cause = _without(removed, results)
    outcomes: dict[str, int] = {}
    for one in good:
        outcomes[one["outcome"]] = outcomes.get(one["outcome"], 0) + 1
    before = [np.exp(one["error_before"] - one["attainable"]) for one in good]
    return Row(
        *key,
        kind=results[0]["kind"],
        studies=len(with_library),
        failed=sum(bool(one["failed"]) for one in results),
        chi_square=_median(one["chi_square"] for one in good),
        identifiable=share(with_library, lambda one: all(one["identifiable"])),
        first=share(identifiable_studies, lambda one: one["first_right"]),
        top=share(identifiable_studies, lambda one: all(one["top_three"])),
        found=share(identifiable_studies, lambda one: all(one["in"])),
        wrong=_mean(one["wrong"] for one in good),
        ratio=(_median(one["ratio"] for one in good), _median(before)),
        outcomes=outcomes,
        place=place,
        no_cause=no_cause,
        naive=share(good, lambda one: one["naive"]["right"]),
        naive_terms=_mean(one["naive"]["terms"] for one in good),
        seconds=_median(one["seconds"] for one in results),
    )


def _median(values: Iterable[float]) -> float:
    numbers = list(values)
    return float(np.median(numbers)) if numbers else float("nan")


def _mean(values: Iterable[float]) -> float:
    numbers = list(values)
    return float(np.mean(numbers)) if numbers else float("nan")
