"""`close_loop`: find the effects that a model lacks, add them, report the error before and
after.
"""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are
# not.
# pyright: reportCallIssue=false

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_float64
from .._foundation.memory import release_compiled_programs_if_needed
from ..data.record import Record
from ..data.stack import split_at, stack, unstack
from ..diagnosis.validation import check_window
from ..effects.base import Effect
from ..estimation.estimate import (
    as_stack,
    check_channels,
    check_samples,
    check_sampling,
    divergence,
)
from ..estimation.filter.filter_error import FilterError
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.solver import GaussNewton
from ..loop.problem import starting_states
from ..loop.thresholds import INSEPARABLE
from ..models.base import AbstractModel
from ..models.free import Free
from .assembly import Findings, StudyRecords, assemble_study
from .candidates import candidates, require_absent
from .fit import Fitted
from .judge import Judge
from .options import LoopOptions
from .search import Search
from .study import Study
from .verdict import conclude, not_borne_out
from .way import Way
from .workbench import Workbench

# The tolerance is in standard errors; a decision needs no smaller one. Effects with corners make
# the solver reject steps, hence the number of steps.
SOLVER = GaussNewton(tolerance=1e-2, least_fall=1e-3, max_steps=100, chord=True)
Records = Record | Sequence[Record]


def close_loop(
    model: AbstractModel,
    free: Free,
    likelihood: AbstractLikelihood,
    *,
    train: Records,
    check: Records | None = None,
    test: Records | Mapping[str, Records] | None = None,
    effects: Sequence[Effect] | None = None,
    window: int | None = None,
    options: LoopOptions | None = None,
    solver: GaussNewton | None = None,
    progress: Callable[[str], None] | None = None,
) -> Study:
    """Find the effects that a model lacks, add them, and report the error before and after.

    The declared model is estimated and every candidate effect is scored. The best candidates are
    refitted with all parameters together, and the best of those that predict the `check` records
    better is added. Effects that have become insignificant are removed. This is repeated until no
    candidate helps. The `test` records decide nothing: they are only reported.

    Args:
        model: the declared model; its values are the starting values.
        free: its free parameters.
        likelihood: measure of the misfit.
        train: records to fit.
        check: records that decide; without them the last third of each training record, which is
            used for fitting in the final estimate.
        test: records that are reported, or several such sets by name; without them the check
            records are reported.
        effects: candidates; by default the general ones and those of the model.
        window: samples at the start of each check and test record in which its initial state is
            fitted, left out of the error; None starts them at `model.initial_state`.
        options: levels and limits.
        solver: the Gauss-Newton solver.
        progress: function that receives a short text at every step.

    Returns:
        The study: verdict, effects, rounds, and the model before and after.

    Raises:
        InputError: if channels differ, a record is too short to be cut or for the window, an
            effect's name occurs twice, its gain is not zero or the model holds it already, the
            check records have no valid sample, or JAX is in 32 bit.
    """
    require_float64()
    progress, options = progress or (lambda _: None), options or LoopOptions()
    records = _split(train, check, test, window)
    library = _checked_library(model, free, likelihood, records, effects, window)

    release_compiled_programs_if_needed()
    workbench = Workbench(model, free, library, likelihood, records.fitted, solver or SOLVER)
    progress("compilation of the model with its candidates")
    workbench.compile((records.check, *records.tests.values()), window)
    progress("estimate of the declared model")
    declared = workbench.set_shapes(_declared_fit(workbench))
    progress("location of the residual")
    where = {"before": workbench.localise(declared)}
    judge = Judge(workbench, records.check, records.tests, window, options)
    search = Search(judge, progress)
    path, other = search.run(declared)
    findings = _concluded(search, path, declared, where)
    if records.complete is not None:
        progress("estimate on the complete training records")
        findings = _refitted_on_complete_records(findings, search, records, test is not None)
    progress("prediction of the test records")
    return assemble_study(findings, search, records, other)


def _split(train: Records, check: Records | None, test, window: int | None) -> StudyRecords:
    """The records of a study as stacks; without check records the training records are cut."""
    train, complete = as_stack(train), None
    if check is None:
        complete = train
        train, check = _cut_last_third(train, window)
    check = as_stack(check)
    return StudyRecords(train, complete, check, _tests(test, check))


def _checked_library(
    model: AbstractModel,
    free: Free,
    likelihood: AbstractLikelihood,
    records: StudyRecords,
    effects: Sequence[Effect] | None,
    window: int | None,
) -> tuple[Effect, ...]:
    """The candidate effects, after all checks of the input."""
    predicted = (records.check, *records.tests.values())
    everything = (records.fitted, *predicted)
    for stacked in everything:
        check_channels(model, stacked)
        check_sampling(model, stacked, likelihood)
    check_samples(records.fitted)
    require(
        not isinstance(likelihood, FilterError),
        "A study fits by output error and finds random forces in the residual. Use OutputError(); "
        "then estimate the model found with FilterError.",
    )
    likelihood.check(model, records.fitted)
    library = candidates(model, free, *everything) if effects is None else tuple(effects)
    require_absent(library, model)
    for effect in library:
        for stacked in everything:
            effect.check(np.asarray(stacked.t))
    if window is not None:
        for stacked in predicted:
            check_window(model, stacked, window, len(starting_states(free, model, model)))
    require(
        bool(np.any(np.asarray(records.check.mask)[:, window or 0 :])),
        "No output of the check records has a valid sample after the window. Give other records, "
        "or leave `check` out.",
    )
    return library


def _concluded(search: Search, path: Way, declared: Fitted, where) -> Findings:
    """Finish the fits of the search and draw the conclusion."""
    workbench = search.bench
    final, rounds = workbench.finish(path.fitted), path.rounds
    declared = workbench.finish(declared) if final.effects else final
    after = workbench.localise(final, like=where["before"]) if final.effects else where["before"]
    where = where | {"after": after}
    conclusion = conclude(search, rounds, declared, final, where)
    if conclusion.outcome.is_noise_alone:
        # The noise model alone explains the residual, so the added effects are discarded.
        final, where["after"] = declared, where["before"]
    alternatives = tuple(
        effect for effect in conclusion.contenders if effect.chi_square < INSEPARABLE
    )
    residual_reports = {
        "before": workbench.analyse_residual(declared),
        "after": workbench.analyse_residual(final),
    }
    return Findings(
        declared,
        final,
        (declared, final),
        rounds,
        alternatives,
        where,
        residual_reports,
        conclusion,
    )


def _refitted_on_complete_records(
    findings: Findings, search: Search, records: StudyRecords, has_tests: bool
) -> Findings:
    """Refit both models on the complete training records, whose last third was the check."""
    workbench, where, residual_reports = (
        search.bench,
        dict(findings.where),
        dict(findings.residual_reports),
    )
    declared, final, dropped = _fitted_on_complete_records(
        search, findings.declared, findings.final, records.used
    )
    last = findings.rounds[-1]
    last = dataclasses.replace(last, dropped=(*last.dropped, *dropped))
    conclusion, alternatives = findings.conclusion, findings.alternatives
    if dropped:
        conclusion = not_borne_out(conclusion, final.effects, dropped)
        alternatives = tuple(
            effect for effect in alternatives if set(effect.instead_of) <= set(final.effects)
        )
        where["after"], residual_reports["after"] = where["before"], residual_reports["before"]
        if final.effects:
            on_search_records = _fit_on(workbench, records.fitted, final)
            where["after"] = workbench.localise(on_search_records, like=where["before"])
            residual_reports["after"] = workbench.analyse_residual(on_search_records)
    # Without test records the last third is reported, which the refit has used for fitting.
    predicting = (declared, final) if has_tests else findings.predicting
    rounds = (*findings.rounds[:-1], last)
    return Findings(
        declared, final, predicting, rounds, alternatives, where, residual_reports, conclusion
    )


def _declared_fit(workbench: Workbench) -> Fitted:
    """Fit of the declared model; refused if its simulation diverges at the starting values."""
    declared = workbench.base()
    if not np.isfinite(declared.cost):
        raise divergence(
            workbench.model.model, workbench.free, workbench.records, workbench.likelihood
        )
    return declared


def _cut_last_third(train: Record, window: int | None) -> tuple[Record, Record]:
    """First two thirds of each record, and the complete records with only their last third valid.

    The check starts at the start of the record, so that it needs no initial state in the middle of
    a motion.
    """
    records = unstack(train)
    ends = [round(2 / 3 * record.t.shape[0]) for record in records]
    first = stack([split_at(record, end)[0] for record, end in zip(records, ends, strict=True)])
    row = jnp.arange(train.t.shape[1])[None]
    kept = (row >= jnp.array(ends)[:, None]) | (row < (window or 0))
    return first, eqx.tree_at(lambda record: record.mask, train, train.mask & kept[..., None])


class _CompleteFits(NamedTuple):
    """Fits on the complete training records.

    Attributes:
        declared: fit of the declared model.
        final: fit of the model with the effects that are kept.
        dropped: names of the effects that were removed.
    """

    declared: Fitted
    final: Fitted
    dropped: tuple[str, ...]


def _fitted_on_complete_records(
    search: Search, declared: Fitted, final: Fitted, records: Record
) -> _CompleteFits:
    """Both fits on the complete training records; effects that are insignificant there are removed.

    A model with effects starts from its own fit, so that its cost is not above that of the declared
    model.
    """
    declared = _fit_on(search.bench, records, declared)
    final = _fit_on(search.bench, records, final) if final.effects else declared
    final, dropped = search.prune(final, keep=0)
    return _CompleteFits(declared, search.bench.finish(final), dropped)


def _fit_on(workbench: Workbench, records: Record, fitted: Fitted) -> Fitted:
    """Repeat a fit on other training records, which become those of the workbench."""
    workbench.records = records.anonymous()
    rows = fitted.fit.parameters.rows
    return workbench.finish(workbench.fit(fitted.effects, fitted.values, rows))


def _tests(test, check: Record) -> dict[str, Record]:
    """Sets of records to report, by name."""
    if test is None:
        return {"check": check}
    if isinstance(test, Mapping):
        require(
            len(test) > 0, "`test` is empty. Give at least one set of records, or leave it out."
        )
        return {name: as_stack(records) for name, records in test.items()}
    return {"test": as_stack(test)}
