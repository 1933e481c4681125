"""`close_loop`: from the residual to the effect that the model lacks, and to the error before and after."""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are none.
# pyright: reportCallIssue=false

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_float64
from .._foundation.grid import is_uniform
from .._foundation.linalg import triangle
from .._foundation.memory import make_room
from ..data.record import Record
from ..data.stack import split_at, stack, unstack
from ..diagnosis.predictable import white_part
from ..diagnosis.validation import check_window
from ..estimation.estimate import Fit, as_stack, check_channels, check_samples, divergence
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.result import Estimate
from ..estimation.solver import GaussNewton
from ..models.augmented import not_in, taken_apart
from ..models.base import AbstractModel, canonical
from ..models.effects import Effect
from ..models.effects_parameter import ParameterDrift, not_free
from ..models.free import Free
from ..models.library import general_effects, uncertain_equations
from ..models.names import read
from ..models.noise import FixedNoise
from ..sensitivity.spectrum import spectrum
from .judge import Judge
from .options import LoopOptions
from .rivals import Rival
from .search import INSEPARABLE, Search
from .study import Side, Study
from .verdict import Conclusion, conclude, not_borne_out, not_carried_over, verdict
from .way import Way
from .workbench import Fitted, Workbench, starting_states

# Tolerance in standard errors: a decision needs no more. Effects bring corners, at which steps are refused.
SOLVER = GaussNewton(tolerance=1e-2, least_fall=1e-3, max_steps=100, chord=True)
# Outcomes in which what the last fit leaves is no estimate of the noise.
MORE_THAN_NOISE = ("proxies", "unexplained", "process noise")
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
    """Find what a model lacks, add it, and report the error before and after on records that were not used.

    Estimate; score every candidate effect; refit the best with all parameters together; keep the best of those that predict
    the `check` records better; drop what has become superfluous; again, until nothing helps. The `test` records decide
    nothing: they are only reported.

    Args:
        model: the declared model, whose values are the start.
        free: its free parameters.
        likelihood: how the misfit is measured.
        train: records to fit.
        check: records that decide; without them the last third of each training record, given back for the last estimate.
        test: records that are reported, or several such sets by name; without them the check records are reported.
        effects: candidates; by default the general ones and the model's own.
        window: samples at the start of each check and test record in which its initial state is fitted, left out of the
            error; None starts them at `model.initial_state`.
        options: levels and limits.
        solver: how to iterate.
        progress: is told what is going on, in a few words.

    Returns:
        What was found.

    Raises:
        InputError: when channels differ, a record is too short to be cut or for the window, an effect's name occurs twice, its
            gain is not zero or the model holds it already, the check records have no valid sample, or JAX is in 32 bit.
    """
    require_float64()
    progress, options, solver = progress or (lambda _: None), options or LoopOptions(), solver or SOLVER
    train = as_stack(train)
    whole = None
    if check is None:
        whole = train
        train, check = _carve(train, window)
    check = as_stack(check)
    tests = _tests(test, check)
    everything = (train, check, *tests.values())
    for records in everything:
        check_channels(model, records)
        likelihood.check_times(records.t)
    check_samples(train)
    likelihood.check(model, train)
    library = candidates(model, free, *everything) if effects is None else tuple(effects)
    _require_absent(library, model)
    for effect in library:
        for records in everything:
            effect.check(np.asarray(records.t))

    if window is not None:
        for records in (check, *tests.values()):
            check_window(model, records, window, len(starting_states(free, model, model)))
    require(
        bool(jnp.any(check.mask[:, window or 0 :])),
        "No output of the check records has a valid sample behind the window. Give others, or leave `check` out.",
    )

    make_room()
    bench = Workbench(model, free, library, likelihood, train, solver)
    progress("compilation of the model with its candidates")
    bench.compile((check, *tests.values()), window)
    progress("estimate of the declared model")
    declared = bench.set_shapes(_started(bench))
    progress("where the residual sits")
    where = {"before": bench.where(declared)}
    search = Search(Judge(bench, check, tests, window, options), progress)
    way, other = search.run(declared)
    found, rounds = bench.finish(way.fitted), way.rounds
    declared = bench.finish(declared) if found.effects else found
    where["after"] = bench.where(found, like=where["before"]) if found.effects else where["before"]
    conclusion = conclude(search, rounds, declared, found, where)
    if conclusion.outcome in ("process noise", "coloured noise"):  # it does without what was added
        found, where["after"] = declared, where["before"]
    rivals = tuple(one for one in conclusion.contenders if one.chi_square < INSEPARABLE)
    reading = {"before": bench.read(declared), "after": bench.read(found)}
    predicted = declared, found
    if whole is not None:
        progress("estimate on the whole of the training records")
        declared, found, dropped = _on_the_whole(bench, search, declared, found, whole)
        rounds = (*rounds[:-1], dataclasses.replace(rounds[-1], dropped=(*rounds[-1].dropped, *dropped)))
        if dropped:
            conclusion = not_borne_out(conclusion, found.effects, dropped)
            rivals = tuple(one for one in rivals if set(one.instead_of) <= set(found.effects))
            there = _on(bench, train, found) if found.effects else None
            where["after"] = bench.where(there, like=where["before"]) if there else where["before"]
            reading["after"] = bench.read(there) if there else reading["before"]
        if test is not None:  # else they are the last third, which the estimate on the whole has seen
            predicted = declared, found
    progress("prediction of the test records")
    used = train if whole is None else whole
    sides = (predicted[0], declared), (predicted[1], found)
    return _study(bench, search, sides, rounds, rivals, (where, reading), tests, used, conclusion, other)


def _started(bench: Workbench) -> Fitted:
    """The declared model's fit, refused where its simulation diverges at the start."""
    declared = bench.base()
    if not np.isfinite(declared.cost):
        raise divergence(bench.model.model, bench.free, bench.records, bench.likelihood)
    return declared


def candidates(model: AbstractModel, free: Free, *records: Record) -> tuple[Effect, ...]:
    """The default library: general effects for this model's channels, the model's own, and a drift of each free parameter.

    Args:
        model: the declared model.
        free: its free parameters.
        records: all that will be fitted and predicted; where one of them is sampled unevenly, no input can be band-limited.
    """
    equations = model.equations_with_terms()
    if equations is None:
        equations = uncertain_equations(canonical(model), np.asarray(free.positions(model).shared))
    general = general_effects(model, equations, uniform=all(is_uniform(np.asarray(one.t)) for one in records))
    own = not_in(model, (*general, *model.effects()))
    known, units = {effect.name for effect in own}, model.units()
    drifts = (ParameterDrift(name, unit=units.get(name, "")) for name in free.shared)
    others = not_in(model, (drift for drift in drifts if drift.name not in known))
    return not_free((*own, *others), free.shared + free.per_record)


def _carve(train: Record, window: int | None) -> tuple[Record, Record]:
    """The first two thirds of each record, and each whole record with only its last third to be predicted.

    The check runs on from the record's own start, so that it needs no initial state of its own in the middle of a motion.
    """
    records = unstack(train)
    ends = [round(2 / 3 * record.t.shape[0]) for record in records]
    first = stack([split_at(record, end)[0] for record, end in zip(records, ends, strict=True)])
    row = jnp.arange(train.t.shape[1])[None]
    kept = (row >= jnp.array(ends)[:, None]) | (row < (window or 0))
    return first, eqx.tree_at(lambda record: record.mask, train, train.mask & kept[..., None])


def _on_the_whole(bench: Workbench, search: Search, declared: Fitted, found: Fitted, whole: Record):
    """Both fits on the whole training records; what is superfluous there goes out, as no fit may end above one that it holds."""
    declared = _on(bench, whole, declared)
    found = _on(bench, whole, found) if found.effects else declared
    found, dropped = search.prune(found, keep=0)
    return declared, bench.finish(found), dropped


def _on(bench: Workbench, records: Record, fitted: Fitted) -> Fitted:
    """A fit's like on other training records, on which the bench stands from then on."""
    bench.records = records.anonymous()
    return bench.finish(bench.fit(fitted.effects, fitted.values, fitted.fit.parameters.rows))


def _require_absent(library: Sequence[Effect], model: AbstractModel) -> None:
    """A candidate that is there already would change the declared model."""
    known = {effect.name for effect in taken_apart(model)[1]}
    for effect in library:
        require(
            effect.name not in known, f"The declared model holds {effect.name!r} already. Leave this candidate out."
        )
        gain = float(read(effect, ("gain",))[0])
        require(
            gain == 0.0,
            f"The candidate {effect.name!r} has a gain of {gain:g}, and is to be absent until it comes in. Leave its gain out; "
            "what is known to be there belongs into the model: Augmented(model, (effect,)).",
        )


def _tests(test, check: Record) -> dict[str, Record]:
    """The sets to report, by name."""
    if test is None:
        return {"check": check}
    if isinstance(test, Mapping):
        require(len(test) > 0, "`test` is empty. Give at least one set of records, or leave it out.")
        return {name: as_stack(records) for name, records in test.items()}
    return {"test": as_stack(test)}


def _study(
    bench: Workbench,
    search: Search,
    sides,
    rounds,
    rivals: tuple[Rival, ...],
    diagnoses,
    tests,
    used: Record,
    conclusion: Conclusion,
    other: Way | None,
) -> Study:
    where, reading = diagnoses
    found = sides[1][1]
    before, after = (_side(bench, search, *side, tests, used) for side in sides)
    placed = {one.name: one for one in after.model.effects_in} if found.effects else {}  # with their values
    known = isinstance(bench.likelihood.noise, FixedNoise)
    noise = np.diagonal(np.asarray(found.fit.noise))
    if not known and conclusion.outcome in MORE_THAN_NOISE:
        noise = np.minimum(np.asarray(white_part(found.fit.residuals, used.mask)), noise)
    sentences = tuple(placed[name].sentence for name in found.effects)
    told = not_carried_over(before, after, found.effects, rounds, tests, used) if found.effects else ()
    words = verdict(conclusion, sentences, rivals, where["after"]), *told
    return Study(
        verdict=" ".join(words),
        outcome=conclusion.outcome,
        effects=found.effects,
        sentences=sentences,
        rounds=rounds,
        other_rounds=other.rounds if other else (),
        rivals=rivals,
        where=where,
        reading=reading,
        before=before,
        after=after,
        noise=dict(zip(used.outputs, map(float, np.sqrt(noise)), strict=True)),
        noise_known=known,
        likelihood=bench.likelihood,
        process_noise=conclusion.process_noise,
        coloured_noise=conclusion.coloured_noise,
        outputs=used.outputs,
        output_units=used.output_units,
        tests=tests,
    )


def _side(
    bench: Workbench, search: Search, predicted: Fitted, fitted: Fitted, tests: dict[str, Record], used: Record
) -> Side:
    """What a fit says, and what the fit that has not seen the tests predicts of them."""
    predictions = {name: bench.predict(predicted, test, search.judge.window) for name, test in tests.items()}
    rms = {name: dict(zip(used.outputs, map(float, one.rms), strict=True)) for name, one in predictions.items()}
    model, free = bench.model_and_free(fitted)
    return Side(
        model, Estimate.of(_unpadded(fitted), model, free, used, bench.solver.policy.threshold), predictions, rms
    )


def _unpadded(fitted: Fitted) -> Fit:
    """The fit without the columns that pad its width."""
    fit, count = fitted.fit, len(fitted.columns)
    keep = np.r_[np.arange(count), fit.parameters.shared.size]
    information = eqx.tree_at(
        lambda one: (one.factor, one.own.coupling),
        fit.information,
        (triangle(fit.information.factor[:, keep]), fit.information.own.coupling[..., :count]),
    )
    return eqx.tree_at(
        lambda one: (
            one.parameters.shared,
            one.covariance,
            one.coloured,
            one.shared_on_bound,
            one.information,
            one.spectrum,
        ),
        fit,
        (
            fit.parameters.shared[:count],
            fit.covariance[:count, :count],
            fit.coloured[:count, :count],
            fit.shared_on_bound[:count],
            information,
            spectrum(information.triangle, information.rhs),
        ),
    )
