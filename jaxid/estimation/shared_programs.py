"""Evaluation and estimate of a case by programs that other cases share.

`estimate` compiles the model into its iteration, once for each number of free parameters. Here the
program of the model has columns for a few more parameters than are free, so that cases with the
same model and records of the same shapes share it, whichever of the parameters are free.
"""

from .._foundation.compiler import fast_compile_jit
from .._foundation.types import Array, Float
from ..models.free import Parameters
from .estimate import Case, fit_problem
from .host_iteration import evaluate_by_programs, fit_by_steps
from .likelihoods import OutputError
from .problem import Linearised, Problem
from .result import Estimate
from .solver import GaussNewton, solver_or_default

# The columns of the program are a multiple of this number (chosen).
WIDTH_STEP = 16


def evaluate(case: Case, parameters: Parameters) -> tuple[Float[Array, ""], Linearised]:
    """Return the cost and the linearised problem of a case at some parameters."""
    if not _kept(case.problem):
        return _evaluate(case.problem, parameters)
    return evaluate_by_programs(case.problem, parameters, _padding(case.problem))


def estimate_case(
    case: Case, solver: GaussNewton | None = None, begin: Parameters | None = None
) -> Estimate:
    """Return the estimate of a case, the same as by `estimate`.

    Args:
        case: from `checked_case`.
        solver: options of the iteration.
        begin: initial parameters, by default those of the case.
    """
    solver, problem = solver_or_default(solver), case.problem
    begin = begin or case.start(solver)
    # on the host a chord needs residuals as rows
    by_steps = not solver.chord or isinstance(problem.likelihood, OutputError)
    if not (by_steps and _kept(problem)):
        return case.estimate(fit_problem(problem, begin, solver), solver)
    fit = fit_by_steps(problem, begin, solver, padding=_padding(problem))
    return case.estimate(fit, solver)


def _kept(problem: Problem) -> bool:
    """Return True if the sensitivities of all records are kept in memory at once."""
    return problem.batch == problem.records.n_cases


def _padding(problem: Problem) -> int:
    """Return the number of columns by which the program of the model is wider than the problem."""
    positions = problem.positions
    return -(positions.rows.size + positions.shared.size) % WIDTH_STEP


@fast_compile_jit
def _evaluate(problem: Problem, parameters: Parameters):
    """Return the cost and the linearised problem, in one program."""
    return problem.evaluate(parameters)
