"""`Study`: the result of a closed loop, with its rounds and its prediction errors on test
records.
"""

import dataclasses
from typing import Any

import numpy as np

from .._foundation.checks import require_known
from .._foundation.json_text import json_text
from .._foundation.notebook import Table, paragraphs
from ..data.record import Record
from ..diagnosis.places import LocalisationResult
from ..diagnosis.residual_report import ResidualReport
from ..diagnosis.validation import Prediction
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.result import Estimate
from ..loop.assess import Objection
from ..loop.hypothesis import NoiseHypothesis
from ..loop.options import LoopOptions
from ..loop.outcome import Outcome
from ..loop.wording import STOPPED
from ..models.base import AbstractModel
from .rounds import Alternative, Candidate, Round
from .second_opinion import SecondOpinion
from .wording import (
    APPROXIMATION,
    RANDOM_MOTION,
    error_title,
    location_line,
    round_lines,
    runaway_words,
    second_opinion_words,
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
class Study:
    """The result of `close_loop`.

    Attributes:
        verdict: the result in words.
        outcome: the result as one of six states.
        objections: objections to the effects as the cause, as data.
        effects: names of the effects that were added and kept, in the order of their addition.
        descriptions: descriptions of these effects.
        noise_model: the noise that the records show: white, coloured, or random forces, whose
            parameters stand in `after.estimate` with standard errors.
        rounds: history of the search.
        alternatives: hypotheses that fit about as well as the study's own; `discrimination`
            rates another record by its power to distinguish them.
        next_best: the next best hypothesis and how much worse it is, in words.
        localisation: location of the training residual of the declared model (`before`) and of the
            model with the effects (`after`).
        residual_reports: tests of the training residual of the same two models; the memory of a
            noise model is removed from that of `after`.
        before, after: the declared model and the model with the effects, on the test records.
        noise: standard deviation of the noise by channel, known or estimated: from the complete
            residual of the last fit if that is noise, from its white part if effects are missing.
        noise_known: True if the noise was given and the residual was tested against it; False if
            it was estimated.
        likelihood: the compact form of the given measure of the misfit
            (`AbstractLikelihood.compact`).
        outputs, output_units: names and units of the channels.
        tests: the test records by name.
        train, check: the training records of the final estimate, and the records that decided.
        window: samples at the start of check and test records in which the initial state is fitted.
        options: levels and limits of the search.
        interrupted: True if the search was stopped by the user.
    """

    verdict: str
    outcome: Outcome
    objections: tuple[Objection, ...]
    effects: tuple[str, ...]
    descriptions: tuple[str, ...]
    noise_model: NoiseHypothesis
    rounds: tuple[Round, ...]
    alternatives: tuple[Alternative, ...]
    next_best: str
    localisation: dict[str, LocalisationResult]
    residual_reports: dict[str, ResidualReport]
    before: Side
    after: Side
    noise: dict[str, float]
    noise_known: bool
    likelihood: AbstractLikelihood
    outputs: tuple[str, ...]
    output_units: tuple[str, ...]
    tests: dict[str, Record]
    train: Record
    check: Record
    window: int | None
    options: LoopOptions
    interrupted: bool = False

    @property
    def runaways(self) -> tuple[str, ...]:
        """Descriptions of the test records on which a simulation diverges, for each model; they
        have no error.
        """
        sides = {"declared model": self.before}
        if self.effects:
            sides["model with the added effects"] = self.after
        words = (runaway_words(name, self.tests, side.tests) for name, side in sides.items())
        return tuple(sentence for sentence in words if sentence)

    def to_dict(self) -> dict[str, Any]:
        """Return all results as plain numbers and words, for JSON."""
        single = len(self.tests) == 1
        pick = (lambda rms: next(iter(rms.values()))) if single else (lambda rms: rms)
        return {
            "verdict": self.verdict,
            "outcome": self.outcome.value,
            "interrupted": self.interrupted,
            "effects": list(self.effects),
            "before": pick(self.before.rms),
            "after": pick(self.after.rms),
            "noise": self.noise,
            "noise_known": self.noise_known,
            "noise_model": self.noise_model.words,
            "objections": [
                {"check": one.check.name, "names": one.names, "numbers": one.numbers}
                for one in self.objections
            ],
            "next_best": self.next_best,
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
        }

    def to_json(self) -> str:
        """Return the results as a JSON object; a number that is not finite is null."""
        return json_text(self.to_dict())

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
        parts = [side.tests[name].to_xarray() for side in sides]
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
        errors = [self._errors(test).html(above=[error_title(test)]) for test in self.tests]
        above, below = paragraphs(self._summary_lines()), paragraphs(self.error_notes)
        return "".join([above, *errors, below, self.after.estimate._repr_html_()])

    def __str__(self) -> str:
        lines = self._summary_lines()
        for test in self.tests:
            lines += ["", error_title(test), *self._errors(test).lines()]
        caution = [self.caution] if self.caution else []
        return "\n".join([*lines, *self.error_notes, "", str(self.after.estimate), *caution])

    @property
    def error_notes(self) -> tuple[str, ...]:
        """Sentences on the errors on test records: simulations that diverge, and random forces."""
        random = self.noise_model.outcome is Outcome.PROCESS_NOISE
        return (*self.runaways, *[RANDOM_MOTION] * random)

    @property
    def caution(self) -> str:
        """Meaning of the standard errors where an effect is missing or not certain, else empty."""
        uncertain = self.outcome in (Outcome.PROXIES, Outcome.UNEXPLAINED)
        return APPROXIMATION if uncertain else ""

    def _summary_lines(self) -> list[str]:
        """Verdict, search, and the places of the residual if anything is missing."""
        stopped = [STOPPED] * self.interrupted
        lines = [*stopped, self.verdict, self.next_best, "", *round_lines(self.rounds)]
        missing = self.outcome is not Outcome.NOTHING_MISSING
        where = location_line(self.localisation["before"], self.options.level)
        return [*lines, *[where] * missing]

    def _errors(self, test: str) -> Table:
        """Table of the errors on one set of test records."""
        rows = []
        for name, unit in zip(self.outputs, self.output_units, strict=True):
            numbers = (self.before.rms[test][name], self.after.rms[test][name], self.noise[name])
            rows.append((name, *(f"{number:.4g}" for number in numbers), unit))
        return Table(("channel", "before", "after", "noise", "unit"), (7, 12, 12, 12), tuple(rows))


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
    opinion = entry.second_opinion
    words = opinion and second_opinion_words(opinion, entry.required)
    numbers = dataclasses.asdict(opinion) if isinstance(opinion, SecondOpinion) else {}
    return dataclasses.asdict(entry) | {
        "candidates": tuple(map(_candidate, entry.candidates)),
        "second_opinion": None if opinion is None else {"words": words, **numbers},
    }


def _candidate(candidate: Candidate) -> dict[str, Any]:
    """Fields by name, with the decision in words as `verdict`, the locations as `place`."""
    keys = {"decision": "verdict", "locations": "place"}
    names = [field.name for field in dataclasses.fields(candidate)]
    return {keys.get(name, name): getattr(candidate, keys.get(name, name)) for name in names}


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
