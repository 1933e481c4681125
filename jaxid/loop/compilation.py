"""Compilation of the programs of a search: at once before it, and ahead of its refits."""

from collections import OrderedDict
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

# Chosen: fits whose programs are compiled ahead; their number bounds the memory.
AHEAD = 4


def compile_programs(problem: LoopProblem) -> None:
    """Compile the programs of the declared fit, of all columns, of its linear model, and of a
    prediction of the check records at once.
    """
    model = problem.model_at(problem.initial_values, ())
    start = _begin(problem, Hypothesis())
    motion = LinearMotion(problem, (), problem.initial_values, start.rows(start.parameters))
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

    It yields a function that waits for the programs of one of the hypotheses, in the same order;
    some may be passed over. It does nothing where one program serves all sets of effects.
    """
    if not problem.uses_reduced_model:
        yield lambda _: None
        return
    left, ahead = list(reversed(hypotheses)), OrderedDict()
    with ThreadPoolExecutor(max_workers=1) as executor:

        def compile_next() -> None:
            if left:
                following = left.pop()
                ahead[following.key] = executor.submit(_compile, problem, following)

        def wait_for(hypothesis: Hypothesis) -> None:
            while left and hypothesis.key not in ahead:
                compile_next()
            while ahead and next(iter(ahead)) != hypothesis.key:  # others were passed over
                ahead.popitem(last=False)[1].cancel()
            compile_next()
            if hypothesis.key in ahead:
                ahead.pop(hypothesis.key).result()

        for _ in range(AHEAD):
            compile_next()
        try:
            yield wait_for
        finally:
            executor.shutdown(cancel_futures=True)


def _compile(problem: LoopProblem, hypothesis: Hypothesis) -> None:
    compile_together(_programs_of(_begin(problem, hypothesis)))


def _begin(problem: LoopProblem, hypothesis: Hypothesis) -> Estimation:
    """Return the estimation problem of a hypothesis at the declared values."""
    return estimation_of(problem, hypothesis, problem.initial_values, {}, {})


def _programs_of(start: Estimation) -> list[tuple[EvictingJit, tuple]]:
    """Return the programs of a fit by output error, with their arguments; of others none."""
    if not isinstance(start.problem.likelihood, OutputError):
        return []
    case = FlatProblem.of(start.problem)
    return [
        (PROGRAMS.outputs, case.outputs_arguments(start.parameters)),
        (PROGRAMS.sensitivities, case.sensitivities_arguments(start.parameters)),
    ]
