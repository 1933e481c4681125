"""`close_loop`: find the effects that a model lacks, add them, report the error before and
after.
"""

from collections.abc import Callable, Mapping, Sequence

from .._foundation.checks import require_float64
from .._foundation.progress import text_progress
from ..data.record import INITIAL_STATE
from ..effects.base import Effect
from ..effects.channel_checks import check_candidates
from ..estimation.argument_checks import check_arguments, require_no_shooting
from ..estimation.estimate import check_channels, check_sampling
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.solver import GaussNewton
from ..loop.options import LoopOptions
from ..loop.problem import SEARCH_SOLVER, LoopProblem
from ..loop.search_effects import search_effects
from ..loop.wording import check_words
from ..models.base import AbstractModel
from ..models.free import Free
from .assembly import assemble_study
from .candidates import candidates
from .study import Study
from .study_records import Records, study_records


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
    progress: bool | Callable[[str], None] = True,
) -> Study:
    """Find the effects that a model lacks, add them, and report the error before and after.

    A hypothesis is a set of effects and a model of the noise. From the declared model on, changes
    of the hypothesis are ranked by the fall of chi-square in the linear model, refitted with all
    parameters together, and compared by the training records and the prediction of the `check`
    records. The search ends when no change is better. Its result passes a list of checks before its
    effects are called the cause. The `test` records decide nothing: they can only withdraw a cause,
    and are reported.

    Args:
        model: the declared model; its values are the starting values.
        free: its free parameters.
        likelihood: measure of the misfit.
        train: records to fit.
        check: records that decide; without them the last third of each training record, or the
            first where the last goes beyond the range of the rest and the initial state is free; it
            is used for fitting in the final estimate.
        test: records that are reported, or several such sets by name; without them the check
            records are reported.
        effects: candidates; by default the general ones and those of the model.
        window: samples at the start of each check and test record in which its initial state is
            fitted, left out of the error; None starts them at `model.initial_state`.
        options: levels and limits.
        solver: the Gauss-Newton solver; a fit that it does not finish continues with damped steps
            (`jaxid.spectrum.Damp`) and by turns.
        progress: True shows the step on a terminal or in a notebook, with the time that its refits
            may still take; False does not; or a function that receives a short text at every step.

    Returns:
        The study: verdict, effects, rounds, and the model before and after. Ctrl-C during the
        search gives a study of the best hypothesis so far.

    Raises:
        InputError: if channels or their units differ, a record has two uses or is too short to be
            cut or for the window, an effect's name occurs twice, its gain is not zero or the model
            holds it already, the likelihood is not output error with white noise, the check records
            have no valid sample, or JAX is in 32 bit.
    """
    require_float64()
    options = options or LoopOptions()
    starts = (f"{INITIAL_STATE}.{name}" for name in model.states)
    starts_free = set(starts) <= set(free.per_record)
    records = study_records(train, check, test, window, starts_free=starts_free)
    require_no_shooting(likelihood, "close_loop")
    everything = (records.fitted, records.check, *records.tests.values())
    for stacked in everything:
        check_arguments(model, stacked, likelihood)
        check_channels(model, stacked)
        check_sampling(model, stacked, likelihood)
    if effects is not None:
        check_candidates(model, effects)
    library = candidates(model, free, *everything) if effects is None else tuple(effects)
    problem = LoopProblem.of(
        model,
        library,
        free,
        likelihood,
        records.fitted,
        records.check,
        window=window,
        solver=solver or SEARCH_SOLVER,
    )
    tests = records.tests if records.has_tests else {}
    with text_progress(progress) as show:
        if records.beyond:
            show(check_words(records.beyond))
        result = search_effects(problem, test=tests, options=options, progress=show)
        return assemble_study(result, records, options, show)
