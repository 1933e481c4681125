"""Assembly of a `Study` from a search: final fits, predictions of the test records, verdict."""

import dataclasses
from collections.abc import Callable

import numpy as np

from .._foundation.compiler import fast_compile_jit
from .._foundation.host import to_device
from .._foundation.linalg import triangle
from .._foundation.types import Array, Float
from ..data.record import Record
from ..diagnosis.autoregression import white_noise_variance
from ..diagnosis.residual_report import ResidualReport, analyse_residual
from ..effects.augmented import split_effects
from ..estimation.estimate import Fit
from ..estimation.likelihoods import OutputError
from ..estimation.result import Estimate
from ..loop.assess import Assessment, Check, Objection
from ..loop.columns import Padding
from ..loop.evidence import INSEPARABLE, compare
from ..loop.fit import LoopFit, fit
from ..loop.moves import Proposals
from ..loop.options import LoopOptions
from ..loop.outcome import Outcome
from ..loop.problem import LoopProblem
from ..loop.search_effects import EffectSearch
from ..loop.search_tree import SearchTree
from ..loop.wording import next_best_words, verdict_words
from ..models.free import Parameters
from ..sensitivity.information import Information, OwnBlock, Profile
from ..sensitivity.spectrum import spectrum
from .caveats import caveats
from .rounds import alternatives_of, rounds_of
from .study import Side, Study
from .study_records import StudyRecords


def assemble_study(
    result: EffectSearch,
    records: StudyRecords,
    options: LoopOptions,
    progress: Callable[[str], None],
) -> Study:
    """Return the study of a search.

    Args:
        result: the search.
        records: training, check and test records.
        options: levels of the search.
        progress: function that receives a short text at every step.
    """
    tree, assessment = result.tree, result.assessment
    rounds = rounds_of(tree, options)
    where, reports = _where(tree), _residual_reports(tree)
    # A noise model that the checks did not pass explains nothing.
    accepted = assessment.outcome is not Outcome.UNEXPLAINED
    declared, best, dropped = tree.declared, tree.best if accepted else tree.declared, ()
    predicting = declared, best
    if records.complete is not None:
        progress("estimate on the complete training records")
        declared, best, dropped = _fitted_on(records.complete, declared, best, options)
        assessment = without(assessment, best.effects, dropped)
        last = dataclasses.replace(rounds[-1], dropped=(*rounds[-1].dropped, *dropped))
        rounds = (*rounds[:-1], last)
        if records.has_tests:
            predicting = declared, best
        elif dropped:  # the complete records contain the check records, which are reported
            predicting = tree.declared, fit(tree.best.problem, best.hypothesis, tree.best)
    progress("prediction of the test records")
    before, after = (
        _side(predictor, fitted, records)
        for predictor, fitted in zip(predicting, (declared, best), strict=True)
    )
    estimated = {effect.name: effect for effect in split_effects(after.model)[1]}
    words = [
        verdict_words(tree, best, assessment, options.level),
        *caveats(assessment, before, after, records),
    ]
    return Study(
        verdict=" ".join(words),
        outcome=assessment.outcome,
        objections=assessment.objections,
        effects=best.effects,
        descriptions=tuple(estimated[name].card.description for name in best.effects),
        noise_model=best.hypothesis.noise,
        rounds=rounds,
        alternatives=alternatives_of(tree, INSEPARABLE) if best.effects else (),
        next_best=next_best_words(tree),
        localisation=where,
        residual_reports=reports,
        before=before,
        after=after,
        noise=_noise(best, assessment.outcome, records.used),
        noise_known=tree.problem.likelihood.noise.is_known,
        likelihood=tree.problem.likelihood,
        outputs=records.used.outputs,
        output_units=records.used.output_units,
        tests=records.tests,
        train=records.used,
        check=records.check,
        window=tree.problem.window,
        options=options,
        interrupted=tree.interrupted,
    )


def _where(tree: SearchTree):
    """Return the location of the residual before and after."""
    before, best = tree.where, tree.best
    after = best.effects and isinstance(best.estimation.problem.likelihood, OutputError)
    return {"before": before, "after": tree.where_after if after else before}


def _residual_reports(tree: SearchTree) -> dict[str, ResidualReport]:
    """Return the tests of the training residual before and after, noise models removed."""
    train = tree.problem.train
    signals = to_device(dict(tree.declared.motion.variables))

    def report(residuals):
        return analyse_residual(residuals, train.mask, signals, train.outputs)

    return {
        "before": report(tree.declared.solution.residuals),
        "after": report(tree.best.white_residuals),
    }


def _fitted_on(records: Record, declared: LoopFit, best: LoopFit, options: LoopOptions):
    """Return both fits on the complete training records, and the effects insignificant there."""
    problem, is_declared = best.problem.on(records), best is declared
    declared = fit(problem, declared.hypothesis, declared)
    best, dropped = declared if is_declared else fit(problem, best.hypothesis, best), []
    while best.effects and (moves := Proposals(best, options).drops()):
        fewer = fit(problem, moves[0].hypothesis, best)
        if not compare(best, fewer, options, len(problem.effects)).accepted:
            break
        dropped += [name for name in best.effects if name not in fewer.effects]
        best = fewer
    return declared, best, tuple(dropped)


def without(
    assessment: Assessment, effects: tuple[str, ...], dropped: tuple[str, ...]
) -> Assessment:
    """Return the assessment after effects turned out insignificant on the complete records
    (`test_effect_removed_by_complete_records_is_no_cause`).

    Args:
        assessment: the assessment of the search.
        effects: names of the effects that remain.
        dropped: names of the insignificant effects.
    """
    if not dropped:
        return assessment
    outcome = Outcome.PROXIES if effects else Outcome.UNEXPLAINED
    objection = Objection(Check.BORNE_OUT, dropped)
    return dataclasses.replace(
        assessment, outcome=outcome, objections=(*assessment.objections, objection)
    )


def _side(predicting: LoopFit, fitted: LoopFit, records: StudyRecords) -> Side:
    """Return one model of the study: its estimate, and its predictions of the test records."""
    used = records.used
    predictions = {name: predicting.predict(test) for name, test in records.tests.items()}
    rms = {
        name: dict(zip(used.outputs, map(float, np.asarray(prediction.rms)), strict=True))
        for name, prediction in predictions.items()
    }
    problem, model, free = fitted.problem, fitted.model, fitted.estimation.free
    threshold = problem.solver.policy.threshold
    solution = _unpadded(fitted.solution, fitted.estimation.padding)
    estimated = fitted.estimation.problem
    stochastic = not isinstance(estimated.likelihood, OutputError)
    of = estimated.model if stochastic else model
    known = estimated.likelihood.knows_noise(fitted.estimation.free)
    estimate = Estimate.of(solution, of, free, used, threshold, known)
    start = _declared_start(problem, estimate)
    return Side(model, dataclasses.replace(estimate, start=start), predictions, rms)


def _declared_start(problem: LoopProblem, estimate: Estimate) -> Float[Array, " parameter"]:
    """Return the values of the declared model, absent effects and, for parameters of the noise, the
    start of the last fit, in place of the values from which the search refitted last.
    """
    declared = dict(zip(problem.columns.names, problem.initial_values, strict=True))
    last = zip(estimate.names, np.asarray(estimate.start), strict=True)
    return to_device(np.array([declared.get(name, start) for name, start in last], float))


def _noise(best: LoopFit, outcome: Outcome, used: Record) -> dict[str, float]:
    """Return the standard deviation of the noise by channel.

    Where effects are missing, the residual is more than noise, and its white part is taken.
    """
    variance = np.diagonal(np.asarray(best.noise_covariance))
    if not best.problem.likelihood.noise.is_known and outcome.leaves_more_than_noise:
        white = np.asarray(white_noise_variance(best.solution.residuals, used.mask))
        variance = np.minimum(white, variance)
    return dict(zip(used.outputs, map(float, np.sqrt(variance)), strict=True))


@fast_compile_jit
def _unpadded(solution: Fit, padding: Padding) -> Fit:
    """Return a fit without its padding (jitted)."""
    own, count = padding.own, padding.shared
    keep = np.r_[np.arange(count), solution.parameters.shared.size]
    block = solution.information.own
    # the rows of a padding column, which has no sensitivity, are zero and stand last
    block = OwnBlock(
        block.jacobian[..., :own, :own],
        block.coupling[..., :own, :count],
        block.rhs[..., :own],
        block.inverse[..., :own, :own],
        block.undetermined[..., :own],
    )
    factor = triangle(solution.information.factor[:, keep])
    profile = solution.information.profile
    profile = Profile(profile.shared[:, :count], profile.own[..., :own], profile.count)
    information = Information(factor, block, profile)
    unknown = np.r_[np.arange(own), padding.own_width + np.arange(count)]
    return dataclasses.replace(
        solution,
        parameters=Parameters(
            solution.parameters.shared[:count], solution.parameters.rows[:, :own]
        ),
        covariance=solution.covariance[:count, :count],
        own_covariance=solution.own_covariance[:, :own, :own],
        robust_covariance=solution.robust_covariance[:count, :count],
        robust_dof=solution.robust_dof[:count],
        robust_own=solution.robust_own[:, :own][..., unknown],
        shared_on_bound=solution.shared_on_bound[:count],
        own_on_bound=solution.own_on_bound[:, :own],
        information=information,
        spectrum=spectrum(information.triangle, information.rhs),
    )
