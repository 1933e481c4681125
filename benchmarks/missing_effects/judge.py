"""From the results of many studies to the figures that are held against the goals."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import beta

Result = dict[str, Any]
FALSE = 0.01  # stated level: share of studies with a false effect
WITHIN = 1.05  # error on the test records over what the true model attains
REFUTED = 25.0  # chi-square by which a cause must fit worse than the truth to be refuted: five standard deviations


class Share(NamedTuple):
    """A count out of many, with the 95 % interval of its probability (Clopper & Pearson 1934)."""

    count: int
    of: int

    @property
    def value(self) -> float:
        """The share itself, NaN of nothing."""
        return self.count / self.of if self.of else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end."""
        low = float(beta.ppf(0.025, self.count, self.of - self.count + 1)) if self.count else 0.0
        high = float(beta.ppf(0.975, self.count + 1, self.of - self.count)) if self.count < self.of else 1.0
        return low, high


class Goal(NamedTuple):
    """A figure beside its goal.

    Attributes:
        name: what is counted.
        share: how often it was so.
        goal: the share that is asked for; `at_most` where less is better.
        met: whether it is, by the plain share; for false discoveries, whether the interval reaches down to the level.
    """

    name: str
    share: Share
    goal: float
    at_most: bool
    met: bool


def share(results: Iterable[Result], is_so: Callable[[Result], bool]) -> Share:
    """How many of the results are so; a failed study never is."""
    told = [not one["failed"] and bool(is_so(one)) for one in results]
    return Share(sum(told), len(told))


def split(results: Sequence[Result]) -> dict[str, list[Result]]:
    """The results by what they count for."""
    parts: dict[str, list[Result]] = {"removed": [one for one in results if one["removed"]]}
    for kind in ("single", "double", "control", "process"):
        parts[kind] = [one for one in results if one["kind"] == kind and not one["removed"]]
    return parts


def identifiable(one: Result) -> bool:
    """Whether the true model's fit finds everything that is planted significant; so counts a failed study too."""
    return bool(one["failed"]) or all(one["identifiable"])


def goals(results: Sequence[Result]) -> list[Goal]:
    """Every figure that has a goal, where there are studies for it."""
    parts = split(results)
    placed, no_cause = _without(parts["removed"], results)
    singles = [one for one in parts["single"] if identifiable(one)]
    doubles = [one for one in parts["double"] if identifiable(one)]
    both = singles + doubles
    wanted = [
        ("right effect first", share(singles, lambda one: one["first_right"]), 0.95),
        ("right effect named in the top three", share(singles, lambda one: all(one["top_three"])), 1.0),
        ("error on test records within 5 % of the true model's", share(both, lambda one: one["ratio"] < WITHIN), 1.0),
        ("both effects of a double found", share(doubles, lambda one: all(one["in"])), 0.9),
        ("effect not in the library: place right", placed, 0.9),
        ("effect not in the library: no cause named", no_cause, 0.9),
        ("the same, or one that fits no worse than the truth", share(parts["removed"], _unrefuted(results)), 0.9),
        ("gusts told as such", share(parts["process"], lambda one: one["outcome"] == "process noise"), 0.95),
        ("gusts: no cause named", share(parts["process"], names_no_cause), 0.95),
    ]
    told = [Goal(name, found, goal, False, found.value >= goal) for name, found, goal in wanted if found.of]
    controls = [one for one in parts["control"] if not one["failed"]]
    false = share(controls, lambda one: bool(one["effects"]))
    if false.of:
        told.append(Goal("false effect where nothing is missing", false, FALSE, True, false.interval[0] <= FALSE))
    failed = share(results, lambda one: False)
    failed = Share(sum(bool(one["failed"]) for one in results), failed.of)
    return [*told, Goal("studies that failed", failed, 0.0, True, failed.count == 0)]


def names_no_cause(one: Result, unseen: bool = False) -> bool:
    """Whether a study claims nothing that is not so, and says that no term is missing at most where none can be seen."""
    if unseen:
        return not one["effects"]
    unpredictable = () if one["kind"] == "process" else ("process noise", "coloured noise")
    return one["outcome"] not in ("explained", "nothing missing", *unpredictable)


def unseen_in(results: Sequence[Result]) -> Callable[[Result], bool]:
    """Whether a study is of a flight in which not even the true model's fit finds anything of what is planted significant."""
    whole = [one for one in results if not one["removed"] and one.get("identifiable")]
    flights = {_flight(one) for one in whole if not any(one["identifiable"])}
    return lambda one: _flight(one) in flights


def _unrefuted(results: Sequence[Result]) -> Callable[[Result], bool]:
    """Whether a study names no cause, or one that its records do not refute even where the truth is known."""
    truths = {_flight(one): one["chi_square"] for one in results if not one["removed"] and "chi_square" in one}
    unseen = unseen_in(results)
    return lambda one: names_no_cause(one, unseen(one)) or truths.get(_flight(one), np.inf) - one["fall"] < REFUTED


def _without(removed: Sequence[Result], results: Sequence[Result]) -> tuple[Share, Share]:
    """Of the studies without their effect in the library: where the place is right, if there is one, and no cause named."""
    unseen = unseen_in(results)
    place = share([one for one in removed if not unseen(one)], lambda one: one["place_right"])
    return place, share(removed, lambda one: names_no_cause(one, unseen(one)))


def _flight(one: Result) -> tuple:
    return one["system"], one["scenario"], one["seed"]


class Row(NamedTuple):
    """One scenario over its seeds.

    Attributes:
        system, scenario, kind: which.
        studies, failed: how many.
        chi_square: median fall of the cost with the true model.
        identifiable, first, top, found: shares; of the latter three, of the studies that are identifiable.
        wrong: mean number of effects that are none of the planted ones.
        ratio: median error over what the true model attains, and of the declared model over the same.
        outcomes: how often the loop said what.
        place, no_cause: shares of the studies without the effect in the library.
        naive: share in which a regression of the residual begins with the right signal.
        naive_terms: mean number of its terms.
        seconds: median of a study.
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
    """One row for each scenario, in the order of its first result."""
    keys = dict.fromkeys((one["system"], one["scenario"]) for one in results)
    return [_row(key, [one for one in results if (one["system"], one["scenario"]) == key]) for key in keys]


def _row(key: tuple[str, str], results: list[Result]) -> Row:
    whole = [one for one in results if not one["removed"]]
    removed = [one for one in results if one["removed"]]
    good = [one for one in whole if not one["failed"]]
    seen = [one for one in whole if identifiable(one)]
    place, no_cause = _without(removed, results)
    outcomes: dict[str, int] = {}
    for one in good:
        outcomes[one["outcome"]] = outcomes.get(one["outcome"], 0) + 1
    before = [np.exp(one["error_before"] - one["attainable"]) for one in good]
    return Row(
        *key,
        kind=results[0]["kind"],
        studies=len(whole),
        failed=sum(bool(one["failed"]) for one in results),
        chi_square=_median(one["chi_square"] for one in good),
        identifiable=share(whole, lambda one: all(one["identifiable"])),
        first=share(seen, lambda one: one["first_right"]),
        top=share(seen, lambda one: all(one["top_three"])),
        found=share(seen, lambda one: all(one["in"])),
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
    found = list(values)
    return float(np.median(found)) if found else float("nan")


def _mean(values: Iterable[float]) -> float:
    found = list(values)
    return float(np.mean(found)) if found else float("nan")
