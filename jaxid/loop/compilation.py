"""Compilation of the programs of a search: at once before it, and ahead of its refits."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

from .._foundation.evicting_jit import EvictingJit, compile_together
from ..diagnosis.free_form import linear_models
from ..estimation.likelihoods import OutputError
from ..estimation.model_programs import PROGRAMS, FlatProblem
from .estimation_problem import Estimation, estimation_of
from .hypothesis import Hypothesis
from .linear_motion import LinearMotion
from .problem import LoopProblem

# Chosen: compiled fits that are kept. At most as many are added in one round, and those of a
# large model then leave half of the memory maps of a process free.
MAX_COMPILED_FITS = 48
# Counted: programs of one kind in a study that fits all sets of effects by one program.
PROGRAMS_OF_A_STUDY = 4


def compile_programs(problem: LoopProblem) -> None:
    """Compile the programs of the declared fit, of all columns, of its linear model, and of a
    prediction of the check records at once.
    """
    _make_room(PROGRAMS_OF_A_STUDY)
    model = problem.model_at(problem.initial_values, ())
    start = _begin(problem, Hypothesis())
    motion = LinearMotion(problem, (), problem.initial_values, start.parameters.rows)
    columns = next(motion.column_arguments(problem.columns.names))
    compile_together(
        [
            *_programs_of(start),
            (PROGRAMS.sensitivities, columns),
            (linear_models, motion.linear_arguments),
            *problem.predictor.programs(model, problem.check),
        ]
    )


@contextmanager
def compiled_ahead(
    problem: LoopProblem, hypotheses: Sequence[Hypothesis]
) -> Iterator[Callable[[Hypothesis], None]]:
    """Compile the programs of fits, in order and in another thread, while earlier fits run.

    It yields a function that waits for the programs of one of the hypotheses. It does nothing where
    one program serves all sets of effects.
    """
    if not problem.uses_reduced_model:
        yield lambda _: None
        return
    _make_room(len(hypotheses))
    with ThreadPoolExecutor(max_workers=1) as executor:
        compiled = {
            hypothesis.key: executor.submit(_compile, problem, hypothesis)
            for hypothesis in hypotheses
        }
        try:
            yield lambda hypothesis: compiled[hypothesis.key].result()
        finally:
            executor.shutdown(cancel_futures=True)


def _make_room(count: int) -> None:
    """Release all programs if a number of further ones would make too many."""
    for program in (*PROGRAMS, linear_models):
        program.make_room(count, MAX_COMPILED_FITS)


def _compile(problem: LoopProblem, hypothesis: Hypothesis) -> None:
    compile_together(_programs_of(_begin(problem, hypothesis)))


def _begin(problem: LoopProblem, hypothesis: Hypothesis) -> Estimation:
    """Return the estimation problem of a hypothesis at the declared values."""
    return estimation_of(problem, hypothesis, problem.initial_values, {}, None)


def _programs_of(start: Estimation) -> list[tuple[EvictingJit, tuple]]:
    """Return the programs of a fit by output error, with their arguments; of others none."""
    if not isinstance(start.problem.likelihood, OutputError):
        return []
    case = FlatProblem.of(start.problem)
    return [
        (PROGRAMS.outputs, case.outputs_arguments(start.parameters)),
        (PROGRAMS.sensitivities, case.sensitivities_arguments(start.parameters)),
    ]
