"""`GaussNewton`: options of the iteration; the whole iteration, and single steps of it."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx

from .._foundation.checks import require
from .._foundation.types import Array, Bool, Float
from ..models.free import Parameters
from .descent import SpectrumDescent
from .minimiser import SMALLEST_STEP, Minimiser, State
from .problem import Problem
from .spectrum_policy import AbstractPolicy, Clip

# Chosen, for the iteration with approximate derivatives: length of the full step at which it ends
# [standard errors], and share of a step below which it ends, three halvings.
NEAR, FEW_HALVINGS = 0.1, 2.0**-3


class GaussNewton(eqx.Module):
    """Options of the Gauss-Newton iteration.

    Args:
        policy: the treatment of weak eigenvalues; the report found clipping adequate in most cases.
        search: a search of optimistix; by default `policy.search()`.
        tolerance: the iteration ends when the full step is shorter than this [standard errors].
        least_fall: the iteration also ends when an accepted step lowers the cost by less than this
            (zero: never), with `Damp` one that is hardly damped. Where a model has corners, steps
            stay short, and the last thousandth of a unit of log-likelihood is not worth them.
        max_steps: largest number of evaluations of the likelihood.
        chord: reuse the sensitivities for more than one step. A trial is then simulated for its
            residuals alone, at a small part of the cost of the sensitivities. Sensitivities from
            more than 100 tolerances away, or from so far that new ones would change the length of
            the step by more than the tolerance (as their last renewal did, for its distance), are
            computed again when a step is refused, when the step remaining after it is longer than a
            quarter of the previous one, or before the iteration ends. This compiles one more
            simulation, and under `vmap` it saves nothing. (The chord method between Newton's steps:
            V. E. Shamanskii, Ukrainian Mathematical Journal 19, 1967; C. T. Kelley, Iterative
            Methods for Linear and Nonlinear Equations, SIAM 1995, section 5.4.)
    """

    policy: AbstractPolicy = eqx.field(default_factory=Clip)
    search: optx.AbstractSearch | None = None
    tolerance: float = eqx.field(static=True, default=1e-6)
    least_fall: float = eqx.field(static=True, default=0.0)
    max_steps: int = eqx.field(static=True, default=200)
    chord: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        require(self.max_steps >= 1, f"max_steps is {self.max_steps}; it must be at least 1.")
        require(self.tolerance > 0, f"tolerance is {self.tolerance}; it must be positive.")


def solver_or_default(solver: GaussNewton | None) -> GaussNewton:
    """Return a solver, by default the usual one.

    Args:
        solver: options of the iteration.

    Raises:
        InputError: if it is something else, such as the class.
    """
    require(
        solver is None or isinstance(solver, GaussNewton),
        f"`solver` is {solver!r}. Give options of the iteration, such as "
        "`jaxid.GaussNewton(max_steps=50)`.",
    )
    return solver or GaussNewton()


def minimise(problem: Problem, begin: Parameters, solver: GaussNewton) -> tuple[Parameters, State]:
    """Return the best parameters of a problem and the last state of the solver.

    A likelihood with an approximation is minimised twice, each time in at most `max_steps` steps:
    with the derivatives of the approximation, until a full step is shorter than `NEAR` standard
    errors or lowers the cost no more; then with its own. The state is of the second part.

    Args:
        problem: the estimation problem.
        begin: the initial parameters.
        solver: options of the iteration.
    """
    approximate = problem.likelihood.approximation()
    if approximate is not None:
        first = eqx.tree_at(lambda problem: problem.likelihood, problem, approximate)
        rough = dataclasses.replace(solver, tolerance=NEAR, chord=False)
        begin, _ = _minimise(first, begin, minimiser_of(first, rough, FEW_HALVINGS))
    return _minimise(problem, begin, minimiser_of(problem, solver))


def _minimise(problem: Problem, begin: Parameters, minimiser: Minimiser):
    """Return the best parameters and the last state of a minimiser."""
    solution = optx.minimise(
        lambda y, problem: jnp.zeros(()),  # for its shape; the minimiser evaluates the problem
        minimiser,
        begin,
        args=problem,
        max_steps=minimiser.max_steps,
        throw=False,
    )
    return solution.value, solution.state


def minimiser_of(
    problem: Problem, solver: GaussNewton, smallest_step: float = SMALLEST_STEP
) -> Minimiser:
    """Return the minimiser with the options of a solver, for the limits of a problem.

    Args:
        problem: the estimation problem.
        solver: options of the iteration.
        smallest_step: share of a step below which the search ends.
    """
    return Minimiser(  # pyright: ignore[reportCallIssue]  (as in effects/library.py)
        SpectrumDescent(
            solver.policy,
            problem.limits.scale,
            problem.limits.lower.shared,
            problem.limits.upper.shared,
        ),
        solver.search or solver.policy.search(),
        solver.tolerance,
        solver.least_fall,
        solver.max_steps,
        solver.chord,
        smallest_step,
    )


class Step(NamedTuple):
    """The end of one step.

    Attributes:
        parameters: the best parameters.
        state: state of the solver.
        done: True if the iteration ends with this step.
    """

    parameters: Parameters
    state: State
    done: Bool[Array, ""]


def first_state(
    problem: Problem,
    begin: Parameters,
    solver: GaussNewton,
    S: Float[Array, "case time sensitive column"] | None = None,
) -> State:
    """Return the state before the first step.

    Args:
        problem, begin, solver: as for `minimise`.
        S: sensitivities at the initial parameters, kept by a solver with `chord`; None if unknown.
    """
    minimiser = minimiser_of(problem, solver)
    options = {"S": S if solver.chord else None}
    return strong(minimiser.init(_objective, begin, problem, options, None, None, frozenset()))


def one_step(problem: Problem, parameters: Parameters, solver: GaussNewton, state: State) -> Step:
    """Return the best parameters and the state after one step, and whether it is the last.

    Loops other than optimistix's use it: on the host between two evaluations of a model, and over
    many problems at once.

    Args:
        problem: the estimation problem.
        parameters: the best parameters before the step.
        solver: options of the iteration, whose `max_steps` is left to the caller.
        state: state before the step.
    """
    minimiser = minimiser_of(problem, solver)
    y, state, _ = minimiser.step(_objective, parameters, problem, {}, state, frozenset())
    done, _ = minimiser.terminate(_objective, y, problem, {}, state, frozenset())
    return Step(*strong((y, state, done)))


def strong(tree):
    """Return a tree without weak types, with which the next step would be compiled again."""
    dynamic, static = eqx.partition(tree, eqx.is_array)
    return eqx.combine(jax.tree.map(lambda leaf: jnp.asarray(leaf, leaf.dtype), dynamic), static)


def _objective(y, problem):
    """Stand for the objective: the minimiser reads its shape only."""
    return jnp.zeros(()), None
