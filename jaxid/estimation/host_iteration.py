"""`fit_by_steps`: a fit whose iteration runs on the host, between programs of the model.

`fit_problem` compiles the model into the iteration. Here the model is in two programs, its outputs
and their sensitivities, which serve all fits and predictions of a model. One step of the iteration
takes their results as arrays; it is compiled once for each shape, whatever the model.
"""

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
from ..models.free import Parameters, Positions
from ..models.noise import AbstractNoise, InnovationNoise
from ..simulation.solution import Solution
from .estimate import Fit, fit_of
from .likelihoods import AbstractLikelihood
from .limits import Limits
from .minimiser import State
from .model_programs import PROGRAMS, FlatProblem
from .problem import Linearised, Problem
from .solver import GaussNewton, first_state, one_step

Outputs = Float[Array, "case time output"]
Columns = Float[Array, "case time output column"]


class Evaluation(NamedTuple):
    """Residuals of a model at its parameters, zero at missing samples, and its sensitivities."""

    v: Outputs
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
    """A likelihood of known rows and sensitivities, which stand in a record as its inputs.

    Attributes:
        noise: the noise model.
        of: the likelihood that has evaluated them.
        sensitive: number of rows that have sensitivities.
    """

    noise: AbstractNoise
    of: AbstractLikelihood
    sensitive: int = eqx.field(static=True)

    def solve(self, model, record, initial_state):
        v = self.of.residuals(self.rows(model, record, initial_state), record.mask)
        y = jnp.where(record.mask, record.z, 0.0) - v
        return Solution(record.t, jnp.zeros((record.t.size, 0)), y, jnp.all(jnp.isfinite(y)))

    def rows(self, model, record, initial_state):
        return self._split(record)[0]

    def _split(self, record: Record) -> tuple[Array, Array]:
        """Return the rows and the flat sensitivities."""
        count = self.row_mask(record.mask).shape[-1]
        return record.u[:, :count], record.u[:, count:]

    def row_mask(self, mask):
        return self.of.row_mask(mask)

    def n_sensitive(self, n_outputs):
        return self.sensitive

    def residuals(self, rows, mask):
        return self.of.residuals(rows, mask)

    def sensitivities(self, family, theta, record):
        rows, S = self._split(record)
        return rows, S.reshape(rows.shape[0], self.sensitive, theta.size)

    def measurement_covariance(self, model, rows, mask):
        if isinstance(self.noise, InnovationNoise):
            # R of a filter is a parameter of its model, which is unknown here.
            return jnp.full((mask.shape[-1], mask.shape[-1]), jnp.nan)
        return super().measurement_covariance(model, rows, mask)

    def check(self, model, records):
        self.noise.check(records.mask, records.outputs)

    def check_times(self, t):
        """Accept all sample times: nothing is simulated."""


class _Arrays(NamedTuple):
    """The parts of a problem, without its model, that a step uses besides an evaluation."""

    t: Float[Array, "case time"]
    z: Float[Array, "case time output"]
    mask: Bool[Array, "case time output"]
    likelihood: AbstractLikelihood
    limits: Limits

    @classmethod
    def of(cls, problem: Problem) -> "_Arrays":
        """Return the parts of a problem."""
        records = problem.records
        return cls(records.t, records.z, records.mask, problem.likelihood, problem.limits)

    def problem(self, evaluation: Evaluation) -> Problem:
        """Return the problem whose rows and sensitivities are those of an evaluation."""
        v, S = evaluation
        known = jnp.concatenate([v, S.reshape(*v.shape[:2], -1)], axis=-1)
        outputs = ("",) * self.z.shape[-1]
        inputs = ("",) * known.shape[-1]
        records = Record(self.t, known, self.z, self.mask, {}, inputs, outputs, (), (), ())
        rows, shared = self.limits.lower.rows.shape[1], self.limits.lower.shared.size
        positions = Positions(jnp.arange(shared), jnp.arange(rows), ())
        evaluated = _Evaluated(self.likelihood.noise, self.likelihood, S.shape[2])
        return Problem(_NoModel(), positions, records, evaluated, self.limits)


class Iteration(NamedTuple):
    """The end of an iteration.

    Attributes:
        arrays: arrays of the problem.
        parameters: the best parameters.
        state: last state of the solver.
        evaluation: the last evaluation.
    """

    arrays: _Arrays
    parameters: Parameters
    state: State
    evaluation: Evaluation


def fit_by_steps(
    problem: Problem,
    begin: Parameters,
    solver: GaussNewton,
    S: Columns | None = None,
    padding: int = 0,
) -> Fit:
    """Return the fit of a problem, as `fit_problem` does, with the iteration on the host.

    The arguments are those of `minimise_by_steps`.
    """
    end = minimise_by_steps(problem, begin, solver, S, padding)
    return _fit(end.arrays, end.parameters, end.state, solver, end.evaluation)


def minimise_by_steps(
    problem: Problem,
    begin: Parameters,
    solver: GaussNewton,
    S: Columns | None = None,
    padding: int = 0,
) -> Iteration:
    """Return the end of an iteration on the host.

    Args:
        problem: the estimation problem.
        begin: the initial parameters.
        solver: options of the iteration.
        S: sensitivities at the initial parameters, for a solver with `chord`; None if unknown.
            That solver needs a likelihood whose rows are the residuals.
        padding: columns by which the program of the sensitivities is wider than this problem, so
            that problems with other numbers of free parameters use the same one.
    """
    case, records, arrays = FlatProblem.of(problem), problem.records, _Arrays.of(problem)

    def evaluated(at: Parameters, S: Columns | None) -> Evaluation:
        if S is None or not np.all(np.isfinite(np.asarray(S))):
            return _evaluation(case, at, padding)
        _, y = PROGRAMS.outputs(*case.outputs_arguments(at))
        return Evaluation(_residuals(records, y), S)

    evaluation = evaluated(_within(problem.limits, begin), S)
    y, state = begin, _begin(arrays, begin, solver, evaluation)
    for _ in range(solver.max_steps - 1):
        y, state, done = _step(arrays, y, solver, state, evaluation)
        if bool(done):
            return Iteration(arrays, y, state, evaluation)
        keep = solver.chord and not bool(state.renew)
        evaluation = evaluated(state.trial, state.linearised.S if keep else None)
    y, state, _ = _step(arrays, y, solver, state, evaluation)
    return Iteration(arrays, y, state, evaluation)


def evaluate_by_programs(
    problem: Problem, parameters: Parameters, padding: int = 0
) -> tuple[Float[Array, ""], Linearised]:
    """Return the cost and the linearised problem, as `Problem.evaluate` does, by the program of the
    sensitivities.

    Args:
        problem: the estimation problem.
        parameters: values of the free parameters.
        padding: as for `minimise_by_steps`.
    """
    evaluation = _evaluation(FlatProblem.of(problem), parameters, padding)
    return _evaluate(_Arrays.of(problem), parameters, evaluation)


def _evaluation(case: FlatProblem, parameters: Parameters, padding: int) -> Evaluation:
    """Return residuals and sensitivities by the program of the model, without padding columns."""
    v, S = PROGRAMS.sensitivities(*case.sensitivities_arguments(parameters, padding))
    return Evaluation(v, to_device(np.asarray(S)[..., :-padding]) if padding else S)


def _within(limits: Limits, parameters: Parameters) -> Parameters:
    """Return parameters within their bounds, computed on the host."""

    def clip(value, low, high):
        return to_device(np.clip(np.asarray(value), np.asarray(low), np.asarray(high)))

    return jax.tree.map(clip, parameters, limits.lower, limits.upper)


def _residuals(records: Record, y: Outputs) -> Outputs:
    """Return the residuals of known outputs, computed on the host."""
    z, mask = np.asarray(records.z), np.asarray(records.mask)
    return to_device(np.where(mask, z - np.asarray(y), 0.0))


@fast_compile_jit
def _evaluate(arrays: _Arrays, parameters: Parameters, evaluation: Evaluation):
    """Return the cost and the linearised problem of an evaluation."""
    return arrays.problem(evaluation).evaluate(parameters)


@fast_compile_jit
def _begin(arrays: _Arrays, begin: Parameters, solver: GaussNewton, evaluation: Evaluation):
    """Return the first state of the iteration."""
    return first_state(arrays.problem(evaluation), begin, solver, evaluation.S)


@fast_compile_jit
def _step(arrays: _Arrays, y: Parameters, solver: GaussNewton, state, evaluation: Evaluation):
    """Return the best parameters and the state after one step, and whether it is the last."""
    return one_step(arrays.problem(evaluation), y, solver, state)


@fast_compile_jit
def _fit(arrays: _Arrays, y: Parameters, state, solver: GaussNewton, evaluation: Evaluation) -> Fit:
    """Return the fit at the end of the iteration."""
    return fit_of(arrays.problem(evaluation), y, state, solver)
