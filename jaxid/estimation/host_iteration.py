"""`fit_by_steps`: a fit whose iteration runs on the host, between programs of the model.

`fit_problem` compiles the model into the iteration. Here the model is in two programs, its outputs
and their sensitivities, which serve all fits and predictions of a model. One step of the iteration
takes their results as arrays; it is compiled once for each shape, whatever the model.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.compiler import fast_compile_jit
from .._foundation.host import to_device
from .._foundation.types import Array, Bool, Float
from ..data.record import Record
from ..models.base import AbstractModel
from ..models.free import Parameters, Positions, flat_vectors
from ..models.noise import AbstractNoise
from ..simulation.solution import Solution
from .estimate import Fit, fit_of
from .likelihoods import AbstractLikelihood, OutputError
from .problem import Limits, Problem
from .solver import GaussNewton, State, minimiser_of

Outputs = Float[Array, "case time output"]
Columns = Float[Array, "case time output column"]


class ModelPrograms(NamedTuple):
    """The programs of a model.

    Attributes:
        outputs: function of a model, the flat vector of each record, the records and a likelihood:
            the outputs at every sample.
        sensitivities: function of the same, of positions in the flat vector and of the leaves in
            which they are (`Positions.leaves`): the outputs and their derivatives by the elements
            at these positions.
    """

    outputs: Callable[..., Outputs]
    sensitivities: Callable[..., tuple[Outputs, Columns]]


class FlatProblem(NamedTuple):
    """A problem whose parameters stand in one flat vector per record.

    Attributes:
        problem: the problem.
        flat: flat vector of the model's parameters and the initial state, for each record.
    """

    problem: Problem
    flat: Float[np.ndarray, "case flat"]

    @classmethod
    def of(cls, problem: Problem) -> "FlatProblem":
        """Return the flat problem of a problem."""
        return cls(problem, np.array(flat_vectors(problem.model, problem.records)))

    @property
    def at(self) -> np.ndarray:
        """Positions of the free parameters, those per record first."""
        positions = self.problem.positions
        return np.concatenate([np.asarray(positions.rows), np.asarray(positions.shared)])

    def filled(self, parameters: Parameters) -> Float[np.ndarray, "case flat"]:
        """Return the flat vectors with the given values of the free parameters."""
        flat, rows = self.flat.copy(), np.asarray(parameters.rows)
        shared = np.broadcast_to(np.asarray(parameters.shared), (len(rows), parameters.shared.size))
        values = np.concatenate([rows, shared], axis=1)
        inside = self.at < flat.shape[1]
        flat[:, self.at[inside]] = values[:, inside]
        return flat

    def outputs_arguments(self, parameters: Parameters) -> tuple:
        """Return the arguments of `ModelPrograms.outputs`."""
        problem = self.problem
        flat = to_device(self.filled(parameters))
        return problem.model, flat, problem.records, simulating(problem.likelihood)

    def sensitivities_arguments(self, parameters: Parameters) -> tuple:
        """Return the arguments of `ModelPrograms.sensitivities`."""
        at = to_device(self.at)
        return (*self.outputs_arguments(parameters), at, self.problem.positions.leaves)


def simulating(likelihood: AbstractLikelihood) -> AbstractLikelihood:
    """Return a likelihood for simulation: output error does not need its noise model, without which
    problems with estimated and with known noise share their programs.
    """
    if isinstance(likelihood, OutputError):
        return OutputError(hold=likelihood.hold, stepper=likelihood.stepper)
    return likelihood


class Evaluation(NamedTuple):
    """Outputs of a model at its parameters, and their sensitivities."""

    y: Outputs
    S: Columns


class _NoModel(AbstractModel):
    """A model without states, inputs, outputs and parameters, in place of one already evaluated."""

    states: tuple[str, ...] = eqx.field(static=True, default=())
    inputs: tuple[str, ...] = eqx.field(static=True, default=())
    outputs: tuple[str, ...] = eqx.field(static=True, default=())

    def rhs(self, t, x, u):
        return jnp.zeros(0)

    def output(self, t, x, u):
        return jnp.zeros(0)

    def initial_state(self, record):
        return jnp.zeros(0)


class _Evaluated(AbstractLikelihood):
    """A likelihood of known outputs and sensitivities, which stand in a record as its inputs."""

    noise: AbstractNoise

    def solve(self, model, record, initial_state):
        y, _ = self._parts(record)
        return Solution(record.t, jnp.zeros((record.t.size, 0)), y, jnp.all(jnp.isfinite(y)))

    def sensitivities(self, family, theta, record):
        return self._parts(record)

    def _parts(self, record: Record):
        y, S = jnp.split(record.u, [record.z.shape[-1]], axis=-1)
        return y, S.reshape(*y.shape, -1)

    def check(self, model, records):
        self.noise.check(records.mask, records.outputs)

    def check_times(self, t):
        """Accept all sample times: nothing is simulated."""


class _Arrays(NamedTuple):
    """Arrays of a problem that a step uses besides its evaluation."""

    t: Float[Array, "case time"]
    z: Float[Array, "case time output"]
    mask: Bool[Array, "case time output"]
    noise: AbstractNoise
    limits: Limits

    def problem(self, evaluation: Evaluation) -> Problem:
        """Return the problem whose outputs and sensitivities are those of an evaluation."""
        y, S = evaluation
        known = jnp.concatenate([y, S.reshape(*y.shape[:2], -1)], axis=-1)
        names = ("",) * y.shape[-1]
        records = Record(self.t, known, self.z, self.mask, {}, (), names, (), names, ())
        rows, shared = self.limits.lower.rows.shape[1], self.limits.lower.shared.size
        positions = Positions(jnp.arange(shared), jnp.arange(rows), ())
        return Problem(_NoModel(), positions, records, _Evaluated(self.noise), self.limits)


class Iteration(NamedTuple):
    """The end of an iteration.

    Attributes:
        arrays: arrays of the problem.
        parameters: the best parameters.
        state: last state of the solver.
        evaluation: the last evaluation.
    """

    arrays: "_Arrays"
    parameters: Parameters
    state: State
    evaluation: Evaluation


def fit_by_steps(
    problem: Problem,
    begin: Parameters,
    solver: GaussNewton,
    programs: ModelPrograms,
    S: Columns | None = None,
) -> Fit:
    """Return the fit of a problem, as `fit_problem` does, with the iteration on the host.

    The arguments are those of `minimise_by_steps`.
    """
    end = minimise_by_steps(problem, begin, solver, programs, S)
    return _fit(end.arrays, end.parameters, end.state, solver, end.evaluation)


def minimise_by_steps(
    problem: Problem,
    begin: Parameters,
    solver: GaussNewton,
    programs: ModelPrograms,
    S: Columns | None = None,
) -> Iteration:
    """Return the end of an iteration on the host.

    Args:
        problem: the estimation problem.
        begin: the initial parameters.
        solver: options of the iteration.
        programs: programs of the model.
        S: sensitivities at the initial parameters, used by a solver with `chord`; None if unknown.
    """
    case, records = FlatProblem.of(problem), problem.records
    arrays = _Arrays(records.t, records.z, records.mask, problem.likelihood.noise, problem.limits)
    shape = (*records.z.shape, begin.rows.shape[1] + begin.shared.size)
    evaluation = Evaluation(records.z, to_device(np.full(shape, np.nan)) if S is None else S)
    y, state = begin, _begin(arrays, begin, solver, evaluation)
    for _ in range(solver.max_steps):
        if not solver.chord or bool(state.renew):
            evaluation = Evaluation(
                *programs.sensitivities(*case.sensitivities_arguments(state.trial))
            )
        else:
            outputs = programs.outputs(*case.outputs_arguments(state.trial))
            evaluation = Evaluation(outputs, state.linearised.S)
        y, state, done = _step(arrays, y, solver, state, evaluation)
        if bool(done):
            break
    return Iteration(arrays, y, state, evaluation)


def _objective(y, problem):
    """Stand for the objective: the minimiser reads its shape only."""
    return jnp.zeros(()), None


@fast_compile_jit
def _begin(arrays: _Arrays, begin: Parameters, solver: GaussNewton, evaluation: Evaluation):
    """Return the first state of the iteration."""
    problem = arrays.problem(evaluation)
    options = {"S": evaluation.S if solver.chord else None}
    minimiser = minimiser_of(problem, solver)
    return _strong(minimiser.init(_objective, begin, problem, options, None, None, frozenset()))


@fast_compile_jit
def _step(arrays: _Arrays, y: Parameters, solver: GaussNewton, state, evaluation: Evaluation):
    """Return the best parameters and the state after one step, and whether it is the last."""
    problem = arrays.problem(evaluation)
    minimiser = minimiser_of(problem, solver)
    y, state, _ = minimiser.step(_objective, y, problem, {}, state, frozenset())
    done, _ = minimiser.terminate(_objective, y, problem, {}, state, frozenset())
    return _strong((y, state, done))


def _strong(tree):
    """Return a tree without weak types, with which the next step would be compiled again."""
    dynamic, static = eqx.partition(tree, eqx.is_array)
    return eqx.combine(jax.tree.map(lambda leaf: jnp.asarray(leaf, leaf.dtype), dynamic), static)


@fast_compile_jit
def _fit(arrays: _Arrays, y: Parameters, state, solver: GaussNewton, evaluation: Evaluation) -> Fit:
    """Return the fit at the end of the iteration."""
    return fit_of(arrays.problem(evaluation), y, state, solver)
