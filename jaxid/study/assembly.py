"""Assembly of a `Study` from the findings of a search."""

from typing import NamedTuple

import equinox as eqx
import numpy as np

from .._foundation.linalg import triangle
from ..data.record import Record
from ..diagnosis.autoregression import white_noise_variance
from ..diagnosis.localise import LocalisationResult
from ..diagnosis.residual_report import ResidualReport
from ..effects.augmented import split_effects
from ..estimation.estimate import (
    Fit,
)
from ..estimation.result import Estimate
from ..sensitivity.spectrum import spectrum
from .fit import Fitted
from .rounds import Alternative, Round
from .search import Search
from .study import Side, Study
from .verdict import Conclusion, not_carried_over, verdict
from .way import Way


class StudyRecords(NamedTuple):
    """The records of a study.

    Attributes:
        fitted: training records of the search, a stack.
        complete: the complete training records, if their last third is the check; else None.
        check: records that decide, a stack.
        tests: records that are reported, by name.
    """

    fitted: Record
    complete: Record | None
    check: Record
    tests: dict[str, Record]

    @property
    def used(self) -> Record:
        """Records of the final estimate."""
        return self.fitted if self.complete is None else self.complete


class Findings(NamedTuple):
    """Results of the search.

    Attributes:
        declared, final: fits of the declared model and of the model with the effects found.
        predicting: the same two fits, as the test records are predicted by them.
        rounds: history of the search.
        alternatives: effects that fit nearly as well as one that was added.
        where, residual_reports: localisation and tests of the residual, before and after.
        conclusion: the outcome and its evidence.
    """

    declared: Fitted
    final: Fitted
    predicting: tuple[Fitted, Fitted]
    rounds: tuple[Round, ...]
    alternatives: tuple[Alternative, ...]
    where: dict[str, LocalisationResult]
    residual_reports: dict[str, ResidualReport]
    conclusion: Conclusion


def assemble_study(
    findings: Findings, search: Search, records: StudyRecords, other: Way | None
) -> Study:
    """Assemble the study from the findings, the predictions and the verdict."""
    workbench, conclusion, final = search.bench, findings.conclusion, findings.final
    used, tests, where = records.used, records.tests, findings.where
    before, after = (
        _side(search, predicting, fitted, tests, used)
        for predicting, fitted in zip(findings.predicting, (findings.declared, final), strict=True)
    )
    known = workbench.likelihood.noise.is_known
    noise = np.diagonal(np.asarray(final.fit.noise))
    if not known and conclusion.outcome.leaves_more_than_noise:
        noise = np.minimum(np.asarray(white_noise_variance(final.fit.residuals, used.mask)), noise)
    estimated = {effect.name: effect for effect in split_effects(after.model)[1]}
    descriptions = tuple(estimated[name].card.description for name in final.effects)
    caveats = ()
    if final.effects:
        caveats = not_carried_over(before, after, final.effects, findings.rounds, tests, used)
    words = verdict(conclusion, descriptions, findings.alternatives, where["after"]), *caveats
    return Study(
        verdict=" ".join(words),
        outcome=conclusion.outcome,
        effects=final.effects,
        descriptions=descriptions,
        rounds=findings.rounds,
        other_rounds=other.rounds if other else (),
        alternatives=findings.alternatives,
        localisation=where,
        residual_reports=findings.residual_reports,
        before=before,
        after=after,
        noise=dict(zip(used.outputs, map(float, np.sqrt(noise)), strict=True)),
        noise_known=known,
        likelihood=workbench.likelihood,
        process_noise=conclusion.process_noise,
        coloured_noise=conclusion.coloured_noise,
        outputs=used.outputs,
        output_units=used.output_units,
        tests=tests,
    )


def _side(
    search: Search, predicting: Fitted, fitted: Fitted, tests: dict[str, Record], used: Record
) -> Side:
    """One model of the study: its estimate, and its predictions of the test records."""
    workbench = search.bench
    predictions = {
        name: workbench.predict(predicting, test, search.judge.window)
        for name, test in tests.items()
    }
    rms = {
        name: dict(zip(used.outputs, map(float, prediction.rms), strict=True))
        for name, prediction in predictions.items()
    }
    model, free = workbench.model_and_free(fitted)
    known, threshold = workbench.likelihood.noise.is_known, workbench.solver.policy.threshold
    estimate = Estimate.of(_unpadded(fitted), model, free, used, threshold, known)
    return Side(model, estimate, predictions, rms)


def _unpadded(fitted: Fitted) -> Fit:
    """Remove the padding columns of a fit."""
    return _first_columns(fitted.fit, len(fitted.columns))


@eqx.filter_jit
def _first_columns(fit: Fit, count: int) -> Fit:
    """Keep the first columns of a fit (jitted)."""
    keep = np.r_[np.arange(count), fit.parameters.shared.size]
    information = eqx.tree_at(
        lambda node: (node.factor, node.own.coupling),
        fit.information,
        (triangle(fit.information.factor[:, keep]), fit.information.own.coupling[..., :count]),
    )
    return eqx.tree_at(
        lambda node: (
            node.parameters.shared,
            node.covariance,
            node.robust_covariance,
            node.robust_dof,
            node.shared_on_bound,
            node.information,
            node.spectrum,
        ),
        fit,
        (
            fit.parameters.shared[:count],
            fit.covariance[:count, :count],
            fit.robust_covariance[:count, :count],
            fit.robust_dof[:count],
            fit.shared_on_bound[:count],
            information,
            spectrum(information.triangle, information.rhs),
        ),
    )
