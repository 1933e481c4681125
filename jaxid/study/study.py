"""`Study`: what a closed loop found, round by round, and what it did to the error on records that were not used."""

import dataclasses
import json
from typing import Any

import numpy as np

from ..data.record import Record
from ..diagnosis.reading import Reading
from ..diagnosis.validation import Prediction
from ..diagnosis.where import Where
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.result import Estimate
from ..models.base import AbstractModel
from .rivals import Rival

REMEDY = (
    "Where a motion is unstable, drifts far, or is held by a pilot or a controller, cut the records into pieces (`jaxid.cut`, "
    "`cut` in a study file)."
)


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One candidate of one round, or a pair of them, whose name is `one + other`.

    Attributes:
        name, family, place, sentence: what it is and where it acts.
        score: chi-square of the score test, the colour of the residual not accounted for.
        significance: the same, accounted for.
        expected: the gain that the score expects.
        left: share of its sensitivity that the free parameters cannot imitate; NaN where that is not finite.
        cost_fall: fall of the training cost in a refit, twice (chi-square); None where it was not refitted.
        check_fall: fall of the check records' error, mean over channels of its logarithm; None likewise.
        verdict: what became of it, in words.
        pair: the names of both effects where it is a pair.
    """

    name: str
    family: str
    place: str
    sentence: str
    score: float
    significance: float
    expected: float
    left: float
    cost_fall: float | None = None
    check_fall: float | None = None
    verdict: str = "not refitted"
    pair: tuple[str, ...] = ()

    @property
    def parts(self) -> tuple[str, ...]:
        """The names of its effects: its own, or both of a pair."""
        return self.pair or (self.name,)

    @property
    def colour(self) -> float:
        """By how much the colour of the residual inflates chi-squares; one at least."""
        return max(self.score / self.significance, 1.0) if self.significance > 0 else float("inf")

    def with_other(self, other: "Candidate", score: float, significance: float) -> "Candidate":
        """The pair of two candidates, with their joint score."""
        return Candidate(
            f"{self.name} + {other.name}",
            f"{self.family} + {other.family}",
            self.place if self.place == other.place else f"{self.place} and {other.place}",
            f"{self.sentence} and {other.sentence}",
            score=score,
            significance=significance,
            expected=float("nan"),
            left=min(self.left, other.left),
            pair=(self.name, other.name),
        )


@dataclasses.dataclass(frozen=True)
class Round:
    """One round of the loop.

    Attributes:
        effects: what was in when the round began.
        candidates: all that were scored, best first.
        added: the name of the candidate that was kept, None when none was.
        rivals: candidates that the data cannot tell from it.
        dropped: effects that became insignificant and were taken out again.
        errors: root mean square error per channel by part (`train`, `check`, `test NAME`), at the beginning of the round.
        predictable: share of the training residual that its own past predicts, per channel.
        threshold: chi-square from which on a candidate counts as significant, the number tried accounted for.
    """

    effects: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    added: str | None
    rivals: tuple[str, ...]
    dropped: tuple[str, ...]
    errors: dict[str, dict[str, float]]
    predictable: dict[str, float]
    threshold: float

    @property
    def winner(self) -> Candidate | None:
        """The candidate that was kept, None when none was."""
        return next((one for one in self.candidates if one.name == self.added), None)

    @property
    def came_in(self) -> tuple[str, ...]:
        """The names of the effects that were added: none, one, or a pair."""
        return self.winner.parts if self.winner else ()

    def contenders(self, margin: float) -> tuple[Candidate, ...]:
        """The rivals of what was added, and all of other families that were refitted and fit worse by less than a margin of
        chi-square."""
        if self.winner is None or self.winner.cost_fall is None:
            return ()
        best, family = self.winner.cost_fall, self.winner.family
        others = [one for one in self.candidates if one.family != family]
        near = {one.name for one in others if one.cost_fall is not None and best - one.cost_fall < margin}
        return tuple(one for one in self.candidates if one.name in near | set(self.rivals))


@dataclasses.dataclass(frozen=True)
class Side:
    """The model before or after: its estimate, and what it predicts of each test record.

    Attributes:
        model: with its estimated values.
        estimate: of the declared parameters and the effects' together.
        tests: predictions by name of test set.
        rms: error by test set and channel.
    """

    model: AbstractModel
    estimate: Estimate
    tests: dict[str, Prediction]
    rms: dict[str, dict[str, float]]


@dataclasses.dataclass(frozen=True)
class RandomForces:
    """Process noise: forces that no signal predicts, such as those of turbulence.

    Attributes:
        places: where they act, as far as the records tell: states in whose equations, or what moves in the air.
        air: which of all places are the air's.
        force: standard deviation of the random force in each uncertain equation [rate of the state], and in the air [m/s].
        time: their correlation time [s].
        parameters: the free parameters that fit best beside them, by name; what is known of them is not told yet. Like the sizes
            they are of the records that were searched: without check records the first two thirds of each.
        gain: twice the rise of the log-likelihood over noise of the instruments alone.
    """

    places: tuple[str, ...]
    air: tuple[str, ...]
    force: dict[str, float]
    time: float
    parameters: dict[str, float]
    gain: float

    def __str__(self) -> str:
        sizes = ", ".join(
            f"{self.force[name]:.3g} " + (f"m/s in {name}" if name in self.air else f"in d({name})/dt")
            for name in self.places
        )
        return (
            f"random forces (process noise, as of turbulence) of standard deviation {sizes} and correlation time "
            f"{self.time:.2g} s explain the residual. Estimates by output error suffer from them: "
            "`process_noise.parameters` are those that fit best beside them, by a filter."
        )


@dataclasses.dataclass(frozen=True)
class ColouredNoise:
    """Noise of sensors with a memory: a part of first order in time beside a white one.

    Attributes:
        sensors: those whose noise has a memory, as far as the records tell.
        deviation: standard deviation of the part with a memory, by channel [unit of the channel].
        white: standard deviation of the white part, by channel [unit of the channel].
        time: correlation time of the part with a memory, by channel [s].
        units: of the channels.
        inflation: of the variance of slow quantities over that by white noise of the same size, in the worst sensor.
        gain: twice the rise of the log-likelihood over white noise.
    """

    sensors: tuple[str, ...]
    deviation: dict[str, float]
    white: dict[str, float]
    time: dict[str, float]
    units: dict[str, str]
    inflation: float
    gain: float

    def __str__(self) -> str:
        each = ", ".join(
            f"{self.deviation[name]:.3g} {self.units[name]}".rstrip() + f" and {self.time[name]:.2g} s in {name}"
            for name in self.sensors
        )
        return f"coloured noise of sensors (standard deviation and correlation time: {each})"


@dataclasses.dataclass(frozen=True)
class Study:
    """The result of `close_loop`.

    Attributes:
        verdict: in a sentence.
        outcome: `nothing missing`, `explained`, `proxies` (something is missing, and what was added is not its cause for
            certain), `process noise` (unpredictable forces, and nothing is added), `coloured noise` (sensors whose noise has
            a memory, and nothing is added) or `unexplained`.
        effects: names of the effects that were added and kept, in the order of their finding.
        sentences: the same in words.
        rounds: what happened.
        other_rounds: of the way that was given up, where the search was begun twice; else none.
        rivals: effects that do as well in the place of one that is in, in the end; `told_apart` says what another record would
            make of them.
        where: where the training residual sits, of the declared model (`before`) and of the one with the effects (`after`).
        reading: what tests say of the training residual, of the same two.
        before, after: the declared model and the one with the effects, on the test records.
        noise: standard deviation of the noise by channel, known or estimated: from all that the last fit leaves where that is
            noise, from what is white in it where something is still missing.
        process_noise: the random forces where these explain the residual, else None.
        coloured_noise: that of the sensors where it is what stays, with effects or without, else None.
        noise_known: whether the noise was given, so that the residual was held against it, or estimated.
        likelihood: as it was given.
        outputs, output_units: names and units of the channels.
        tests: the test records by name.
    """

    verdict: str
    outcome: str
    effects: tuple[str, ...]
    sentences: tuple[str, ...]
    rounds: tuple[Round, ...]
    other_rounds: tuple[Round, ...]
    rivals: tuple[Rival, ...]
    where: dict[str, Where]
    reading: dict[str, Reading]
    before: Side
    after: Side
    noise: dict[str, float]
    noise_known: bool
    likelihood: AbstractLikelihood
    process_noise: RandomForces | None
    coloured_noise: ColouredNoise | None
    outputs: tuple[str, ...]
    output_units: tuple[str, ...]
    tests: dict[str, Record]

    @property
    def runaways(self) -> tuple[str, ...]:
        """Test records on which a simulation diverges, so that there is no error, in a sentence for each model."""
        sides = {"declared model": self.before, "model with what was added": self.after}
        found = []
        for words in sides if self.effects else ("declared model",):
            lost = [
                self.tests[test].names[case]
                for test, one in sides[words].tests.items()
                for case in np.flatnonzero(~np.all(np.isfinite(one.residuals), axis=(1, 2)))
            ]
            if lost:
                found.append(f"The {words} runs away on {', '.join(lost)}. {REMEDY}")
        return tuple(found)

    def to_dict(self) -> dict[str, Any]:
        """All figures as plain numbers and words, for JSON."""
        single = len(self.tests) == 1
        pick = (lambda rms: next(iter(rms.values()))) if single else (lambda rms: rms)
        return {
            "verdict": self.verdict,
            "outcome": self.outcome,
            "effects": list(self.effects),
            "before": pick(self.before.rms),
            "after": pick(self.after.rms),
            "noise": self.noise,
            "noise_known": self.noise_known,
            "process_noise": dataclasses.asdict(self.process_noise) if self.process_noise else None,
            "coloured_noise": dataclasses.asdict(self.coloured_noise) if self.coloured_noise else None,
            "tests": {name: {"before": self.before.rms[name], "after": self.after.rms[name]} for name in self.tests},
            "parameters": _parameters(self.after.estimate),
            "declared": _parameters(self.before.estimate),
            "residual": {side: _read(one) for side, one in self.reading.items()},
            "where": {side: _places(one) for side, one in self.where.items()},
            "rivals": [_rival(one) for one in self.rivals],
            "rounds": [dataclasses.asdict(one) for one in self.rounds],
            "other_rounds": [dataclasses.asdict(one) for one in self.other_rounds],
        }

    def to_json(self) -> str:
        """The figures as a JSON object; a number that is not finite is null."""
        return json.dumps(_finite(self.to_dict()), indent=2)

    def __str__(self) -> str:
        lines = [self.verdict, ""]
        for index, one in enumerate(self.rounds, 1):
            best = one.candidates[0] if one.candidates else None
            what = f"added {one.added}" if one.added else "nothing added"
            rivals = f", not to be told from {', '.join(one.rivals)}" if one.rivals else ""
            lines.append(f"round {index}: {what}{rivals}" + (f" (best score: {best.name})" if best else ""))
            lines += [f"         dropped {name}" for name in one.dropped]
        if self.other_rounds:
            steps = ", ".join(str(one.added) for one in self.other_rounds if one.added)
            lines.append(f"another way was tried and given up: {steps}")
        first = self.where["before"]
        if self.outcome != "nothing missing":
            sits = ", or ".join(f"{one.kind} {one.name} ({one.share:.0%})" for one in first.rivals())
            lines.append(f"where:   the declared model's residual sits in the {sits}")
        width = max(len(name) for name in (*self.outputs, "channel"))
        for test in self.tests:
            lines += ["", f"error on {test} (RMS, not used for fitting)"]
            lines.append(f"{'channel':<{width}} {'before':>12} {'after':>12} {'noise':>12}  unit")
            for name, unit in zip(self.outputs, self.output_units, strict=True):
                before, after = self.before.rms[test][name], self.after.rms[test][name]
                lines.append(f"{name:<{width}} {before:>12.4g} {after:>12.4g} {self.noise[name]:>12.4g}  {unit}")
        lines += [*self.runaways]
        if self.process_noise and self.process_noise.parameters:
            lines += ["", "parameters that fit best beside the random forces, by a filter"]
            width = max(map(len, self.process_noise.parameters))
            lines += [f"{name:<{width}} {value:>12.6g}" for name, value in self.process_noise.parameters.items()]
        return "\n".join([*lines, "", str(self.after.estimate)])


def _read(reading: Reading) -> dict[str, dict[str, Any]]:
    tests, found = reading.tests, {}
    for j, name in enumerate(tests.outputs):
        signal, correlation, lag = reading.strongest(name)
        variable, chance = reading.bent(name)
        found[name] = {
            "whiteness_p": float(tests.whiteness.p_value[j]),
            "whiteness_p_by_record": [float(p) for p in reading.by_record[:, j]],
            "follows": {"signal": signal, "correlation": correlation, "lag": lag, "p": float(np.min(tests.cross_p[j]))},
            "mean_over": {"variable": variable, "p": chance},
        }
    return found


def _rival(rival: Rival) -> dict[str, Any]:
    kept = ("name", "sentence", "instead_of", "chi_square")
    return {name: getattr(rival, name) for name in kept}


def _places(where: Where) -> list[dict[str, Any]]:
    kept = ("kind", "name", "share", "score", "dof")
    return [{name: getattr(place, name) for name in kept} for place in where.places]


def _parameters(estimate: Estimate) -> dict[str, dict[str, float]]:
    rows = zip(estimate.names, estimate.values, estimate.coloured_errors, strict=True)
    return {name: {"value": float(value), "standard_error": float(error)} for name, value, error in rows}


def _finite(value):
    """Numbers that JSON has no word for become null."""
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
