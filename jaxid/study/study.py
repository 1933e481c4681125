"""`Study`: the result of a closed loop, with its rounds and its prediction errors on test
records.
"""

import dataclasses
import json
from typing import Any

import numpy as np

from .._foundation.checks import require_known
from .._foundation.notebook import preformatted
from ..data.record import Record
from ..diagnosis.localise import LocalisationResult
from ..diagnosis.residual_report import ResidualReport
from ..diagnosis.validation import Prediction
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.result import Estimate
from ..models.base import AbstractModel
from .outcome import Outcome
from .rounds import Alternative, Candidate, Round

RUNAWAY_REMEDY = (
    "If a motion is unstable, drifts far, or is held by a pilot or a controller, cut the records "
    "into pieces (`jaxid.segment`, `cut` in a study file)."
)


@dataclasses.dataclass(frozen=True)
class Side:
    """The model before or after: its estimate, and its predictions of the test records.

    Attributes:
        model: the model with its estimated values.
        estimate: joint estimate of the declared parameters and those of the effects.
        tests: predictions by name of test set.
        rms: error by test set and channel.
    """

    model: AbstractModel
    estimate: Estimate
    tests: dict[str, Prediction]
    rms: dict[str, dict[str, float]]


@dataclasses.dataclass(frozen=True)
class RandomForces:
    """Process noise: random forces that no signal predicts, such as those of turbulence.

    Attributes:
        places: places where the records show them to act: states by whose equations they enter, or
            components of the air's motion.
        air: those of all places that are components of the air's motion.
        force: standard deviation of the random force in each uncertain equation [rate of the
            state], and in the air [m/s].
        time: correlation time of the forces [s].
        parameters: values of the free parameters estimated jointly with the forces, by name;
            without standard errors. Like the standard deviations they come from the records of the
            search: without check records the first two thirds of each.
        gain: twice the rise of the log-likelihood over sensor noise alone.
    """

    places: tuple[str, ...]
    air: tuple[str, ...]
    force: dict[str, float]
    time: float
    parameters: dict[str, float]
    gain: float

    def __str__(self) -> str:
        sizes = ", ".join(
            f"{self.force[name]:.3g} "
            + (f"m/s in {name}" if name in self.air else f"in d({name})/dt")
            for name in self.places
        )
        return (
            f"random forces (process noise, as of turbulence) of standard deviation {sizes} and "
            f"correlation time {self.time:.2g} s explain the residual. They bias estimates by "
            "output error: `process_noise.parameters` are the estimates of a filter that includes "
            "them."
        )


@dataclasses.dataclass(frozen=True)
class ColouredNoise:
    """Coloured sensor noise: the sum of a first-order Gauss-Markov process and white noise.

    Attributes:
        sensors: sensors whose noise the records show to be coloured.
        deviation: standard deviation of the coloured part, by channel [unit of the channel].
        white: standard deviation of the white part, by channel [unit of the channel].
        time: correlation time of the coloured part, by channel [s].
        units: units of the channels.
        inflation: ratio of the variance of slow quantities to their variance under white noise of
            the same size, in the worst sensor.
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
            f"{self.deviation[name]:.3g} {self.units[name]}".rstrip()
            + f" and {self.time[name]:.2g} s in {name}"
            for name in self.sensors
        )
        return f"coloured noise of sensors (standard deviation and correlation time: {each})"


@dataclasses.dataclass(frozen=True)
class Study:
    """The result of `close_loop`.

    Attributes:
        verdict: the result in words.
        outcome: the result as one of six states.
        effects: names of the effects that were added and kept, in the order of their addition.
        descriptions: descriptions of these effects.
        rounds: history of the search.
        other_rounds: history of the search path that was abandoned, if the search was started
            twice; else empty.
        alternatives: effects that fit as well in place of one of the final model; `discrimination`
            rates another record by its power to distinguish them.
        localisation: location of the training residual of the declared model (`before`) and of the
            model with the effects (`after`).
        residual_reports: tests of the training residual of the same two models.
        before, after: the declared model and the model with the effects, on the test records.
        noise: standard deviation of the noise by channel, known or estimated: from the complete
            residual of the last fit if that is noise, from its white part if effects are missing.
        process_noise: the random forces if they explain the residual, else None.
        coloured_noise: coloured sensor noise if the last residual consists of it, with effects or
            without, else None.
        noise_known: True if the noise was given and the residual was tested against it; False if
            it was estimated.
        likelihood: the given measure of the misfit.
        outputs, output_units: names and units of the channels.
        tests: the test records by name.
    """

    verdict: str
    outcome: Outcome
    effects: tuple[str, ...]
    descriptions: tuple[str, ...]
    rounds: tuple[Round, ...]
    other_rounds: tuple[Round, ...]
    alternatives: tuple[Alternative, ...]
    localisation: dict[str, LocalisationResult]
    residual_reports: dict[str, ResidualReport]
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
        """Descriptions of the test records on which a simulation diverges, for each model; they
        have no error.
        """
        sides = {"declared model": self.before, "model with the added effects": self.after}
        sentences = []
        for words in sides if self.effects else ("declared model",):
            diverged = [
                self.tests[test].names[case]
                for test, prediction in sides[words].tests.items()
                for case in np.flatnonzero(~np.all(np.isfinite(prediction.residuals), axis=(1, 2)))
            ]
            if diverged:
                sentences.append(f"The {words} diverges on {', '.join(diverged)}. {RUNAWAY_REMEDY}")
        return tuple(sentences)

    def to_dict(self) -> dict[str, Any]:
        """Return all results as plain numbers and words, for JSON."""
        single = len(self.tests) == 1
        pick = (lambda rms: next(iter(rms.values()))) if single else (lambda rms: rms)
        return {
            "verdict": self.verdict,
            "outcome": self.outcome.value,
            "effects": list(self.effects),
            "before": pick(self.before.rms),
            "after": pick(self.after.rms),
            "noise": self.noise,
            "noise_known": self.noise_known,
            "process_noise": dataclasses.asdict(self.process_noise) if self.process_noise else None,
            "coloured_noise": dataclasses.asdict(self.coloured_noise)
            if self.coloured_noise
            else None,
            "tests": {
                name: {"before": self.before.rms[name], "after": self.after.rms[name]}
                for name in self.tests
            },
            "parameters": _parameters(self.after.estimate),
            "declared": _parameters(self.before.estimate),
            "residual": {
                side: _residual_tests(report) for side, report in self.residual_reports.items()
            },
            "where": {side: _places(result) for side, result in self.localisation.items()},
            "alternatives": [_alternative(effect) for effect in self.alternatives],
            "rounds": [_round(entry) for entry in self.rounds],
            "other_rounds": [_round(entry) for entry in self.other_rounds],
        }

    def to_json(self) -> str:
        """Return the results as a JSON object; a number that is not finite is null."""
        return json.dumps(_finite(self.to_dict()), indent=2)

    def to_xarray(self, test: str | None = None) -> Any:
        """Return the predictions of a test set as an `xarray.Dataset` with the axis `side`, the
        declared model ("before") and the model with the added effects ("after").

        Args:
            test: name of the test set, the first by default.
        """
        import xarray as xr  # imported here because it is slow to import

        name = next(iter(self.tests)) if test is None else test
        require_known("test set", [name], self.tests)
        sides = (self.before, self.after)
        parts = [side.tests[name].to_xarray(side.model.outputs) for side in sides]
        together = xr.concat(parts, xr.Variable("side", ["before", "after"]))
        return together.assign_attrs(test=name, outcome=self.outcome.value)

    def plot(self, test: str | None = None, case: int = 0) -> Any:
        """Return a figure of a test record and its predictions before and after, by matplotlib
        (`jaxid[report]`).

        Args:
            test: name of the test set, the first by default.
            case: which record of the set.
        """
        from ..report.figures import prediction

        return prediction(self, next(iter(self.tests)) if test is None else test, case)

    def _repr_html_(self) -> str:
        return preformatted(str(self))

    def __str__(self) -> str:
        lines = [self.verdict, "", *self._search_lines(), *self._location_lines()]
        for test in self.tests:
            lines += self._error_lines(test)
        lines += [*self.runaways, *self._filter_lines()]
        return "\n".join([*lines, "", str(self.after.estimate)])

    def _search_lines(self) -> list[str]:
        """Lines on the rounds of the search."""
        lines = []
        for index, entry in enumerate(self.rounds, 1):
            added = f"added {entry.added}" if entry.added else "nothing added"
            same = f", equivalent to {', '.join(entry.alternatives)}" if entry.alternatives else ""
            best = f" (best score: {entry.candidates[0].name})" if entry.candidates else ""
            lines.append(f"round {index}: {added}{same}{best}")
            lines += [f"         dropped {name}" for name in entry.dropped]
        if self.other_rounds:
            steps = ", ".join(str(entry.added) for entry in self.other_rounds if entry.added)
            lines.append(f"another search path was abandoned: {steps}")
        return lines

    def _location_lines(self) -> list[str]:
        """Line on the location of the residual of the declared model, if anything is missing."""
        if self.outcome is Outcome.NOTHING_MISSING:
            return []
        places = ", or ".join(
            f"{place.location.label} ({place.share:.0%})"
            for place in self.localisation["before"].near_best()
        )
        return [f"where:   the residual of the declared model is in the {places}"]

    def _error_lines(self, test: str) -> list[str]:
        """Table of the errors on one set of test records."""
        width = max(len(name) for name in (*self.outputs, "channel"))
        lines = ["", f"error on {test} (RMS, not used for fitting)"]
        lines.append(f"{'channel':<{width}} {'before':>12} {'after':>12} {'noise':>12}  unit")
        for name, unit in zip(self.outputs, self.output_units, strict=True):
            before, after = self.before.rms[test][name], self.after.rms[test][name]
            lines.append(
                f"{name:<{width}} {before:>12.4g} {after:>12.4g} {self.noise[name]:>12.4g}  {unit}"
            )
        return lines

    def _filter_lines(self) -> list[str]:
        """Table of the parameters that were estimated with the random forces, if any."""
        if not (self.process_noise and self.process_noise.parameters):
            return []
        width = max(map(len, self.process_noise.parameters))
        return [
            "",
            "parameters estimated with the random forces, by a filter",
            *(
                f"{name:<{width}} {value:>12.6g}"
                for name, value in self.process_noise.parameters.items()
            ),
        ]


def _residual_tests(report: ResidualReport) -> dict[str, dict[str, Any]]:
    tests, rows = report.tests, {}
    for j, name in enumerate(tests.outputs):
        signal, correlation, lag = report.strongest_correlation(name)
        variable, chance = report.nonlinear_dependence(name)
        rows[name] = {
            "whiteness_p": float(tests.whiteness.p_value[j]),
            "whiteness_p_by_record": [float(p) for p in report.by_record[:, j]],
            "follows": {
                "signal": signal,
                "correlation": correlation,
                "lag": lag,
                "p": float(np.min(tests.cross_p[j])),
            },
            "mean_over": {"variable": variable, "p": chance},
        }
    return rows


def _round(entry: Round) -> dict[str, Any]:
    return dataclasses.asdict(entry) | {"candidates": tuple(map(_candidate, entry.candidates))}


def _candidate(candidate: Candidate) -> dict[str, Any]:
    """Fields by name, with the decision in words as `verdict`, the locations as `place`."""
    keys = {"decision": "verdict", "locations": "place"}
    names = [field.name for field in dataclasses.fields(candidate)]
    chosen = [keys.get(name, name) for name in names if name != "collinear_with"]
    return {key: getattr(candidate, key) for key in chosen}


def _alternative(alternative: Alternative) -> dict[str, Any]:
    kept = ("name", "description", "instead_of", "chi_square")
    return {name: getattr(alternative, name) for name in kept}


def _places(result: LocalisationResult) -> list[dict[str, Any]]:
    return [
        {
            "kind": place.location.kind.label,
            "name": place.location.name,
            "share": place.share,
            "score": place.score,
            "dof": place.dof,
        }
        for place in result.places
    ]


def _parameters(estimate: Estimate) -> dict[str, dict[str, float]]:
    rows = zip(estimate.names, estimate.values, estimate.corrected_errors, strict=True)
    return {
        name: {"value": float(value), "standard_error": float(error)} for name, value, error in rows
    }


def _finite(value):
    """Return the value with None in place of numbers that JSON cannot represent."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
