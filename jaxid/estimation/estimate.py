"""`estimate`: maximum-likelihood estimates of the parameters of a model from records."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._foundation.checks import InputError, require, require_float64
from .._foundation.compiler import fast_compile_jit
from .._foundation.device import require_threads
from .._foundation.host import on_host
from .._foundation.results import RESULTS
from .._foundation.types import Array, Bool, Float, Int
from ..data.record import Record
from ..data.stack import stack
from ..models.base import AbstractModel, canonical
from ..models.equation_shapes import check_equations
from ..models.free import Free, Parameters, initial_parameters
from ..sensitivity.information import Information, OwnBlock
from ..sensitivity.spectrum import Spectrum, spectrum
from ..simulation.simulate import explain_divergence
from ..simulation.solution import Solution
from .argument_checks import check_arguments, check_free, require_records
from .coloured_errors import coloured_variances
from .likelihoods import AbstractLikelihood, OutputError
from .minimiser import State
from .problem import Problem
from .result import Estimate
from .shooting import shot
from .solver import GaussNewton, minimise, solver_or_default

INFINITE_LIKELIHOOD = (
    "The simulation is finite at the starting values, and its likelihood is not: the covariance of "
    "the residuals is singular. Leave out one of two equal channels, or give the noise, as in "
    "`OutputError(FixedNoise(R))`, where the model fits a channel without any error."
)


class Fit(eqx.Module):
    """Result of a fit as arrays only: the numbers of an `Estimate`, without names."""

    parameters: Parameters
    cost: Float[Array, ""]
    information: Information
    spectrum: Spectrum
    covariance: Float[Array, "parameter parameter"]
    own_covariance: Float[Array, "case own own"]
    robust_covariance: Float[Array, "parameter parameter"]
    robust_dof: Float[Array, " parameter"]
    robust_own: Float[Array, "case own unknown"]
    noise: Float[Array, "output output"]
    residuals: Float[Array, "case time output"]
    shared_on_bound: Bool[Array, " parameter"]
    own_on_bound: Bool[Array, "case own"]
    result: RESULTS
    iterations: Int[Array, ""]
    costs: Float[Array, " step"]
    decrements: Float[Array, " step"]


def estimate(
    model: AbstractModel,
    free: Free,
    records: Record | Sequence[Record],
    likelihood: AbstractLikelihood,
    *,
    solver: GaussNewton | None = None,
    throw: bool = False,
) -> Estimate:
    """Estimate the free parameters of a model by maximum likelihood.

        theta = argmin J(theta),    J = 1/2 sum_i ( v_i' R^-1 v_i + log det R )     (Eq. 4.2, 4.4)

    by Gauss-Newton (4.19) on square-root information. An unknown R is re-estimated at each
    iteration.

    Args:
        model: the model; its values are the start of the free parameters and the fixed values of
            all others.
        free: which parameters are free, made by `free(...)`.
        records: one record, several records, or a stack.
        likelihood: the likelihood, such as `OutputError()`.
        solver: options of the iteration.
        throw: raise if the iteration fails; otherwise the failure stands in the status.

    Returns:
        Values with standard errors and diagnostics. Under `vmap` every case has its own status.

    Raises:
        InputError: when channels of model and records differ, the noise model does not suit the
            gaps, a time base has a hole that the likelihood's stepper cannot cross, the records lie
            on more CPU devices than XLA's pool of threads serves, or JAX is in 32 bit; with
            `throw`, also when the simulation diverges at the start or the iteration does not
            converge.
    """
    case = checked_case(model, free, records, likelihood)
    solver = solver_or_default(solver)
    fit = fit_problem(case.problem, case.start(solver), solver)
    result = case.estimate(fit, solver)
    if throw and not bool(jnp.all(result.successful)):
        raise failure(case.problem, fit, result)
    return result


class Case(NamedTuple):
    """An estimation problem after all checks, with its names.

    Attributes:
        problem: the problem.
        model, free: model and free parameters, with those of the likelihood.
        records: a stack, with names.
    """

    problem: Problem
    model: AbstractModel
    free: Free
    records: Record

    @property
    def begin(self) -> Parameters:
        """The initial parameters."""
        return initial_parameters(self.model, self.problem.positions, self.problem.records)

    def start(self, solver: GaussNewton) -> Parameters:
        """Return the parameters from which an iteration starts: the initial ones, or with
        `OutputError(shooting=...)` joined from pieces of the records.
        """
        likelihood = self.problem.likelihood
        if isinstance(likelihood, OutputError) and likelihood.shooting is not None:
            return shot(self.model, self.free, self.records, likelihood, solver)
        return self.begin

    def estimate(self, fit: Fit, solver: GaussNewton) -> Estimate:
        """Return the estimate of a fit of the problem by a solver."""
        threshold, known = solver.policy.threshold, self.problem.likelihood.knows_noise(self.free)
        return Estimate.of(fit, self.model, self.free, self.records, threshold, known)


def checked_case(
    model: AbstractModel,
    free: Free,
    records: Record | Sequence[Record],
    likelihood: AbstractLikelihood,
) -> Case:
    """Return the problem of `estimate` after all checks.

    The arguments and errors are those of `estimate`.
    """
    require_float64()
    records = as_stack(records)
    check_arguments(model, records, likelihood)
    check_free(free)
    check_channels(model, records)
    model, free = canonical(model), canonical(free)
    check_known(model, records, likelihood)
    model, free = canonical(likelihood.prepared(model, free, records))
    return Case(Problem.of(model, free, records, likelihood), model, free, records)


def check_known(model: AbstractModel, records: Record, likelihood: AbstractLikelihood) -> None:
    """Check the records as far as their values are known: under `jit` some may be traced.

    The checks turn arrays into Python numbers. Under `jit` JAX stages the operations on concrete
    arrays as well, so they are evaluated at compile time.

    Raises:
        InputError: when the noise model does not suit the gaps, a time base has a hole that the
            likelihood's stepper cannot cross, an output has no valid sample, or the records lie on
            more CPU devices than their threads serve.
    """
    if isinstance(records.t, Tracer):
        return
    require_threads(records.t.devices() if isinstance(records.t, jax.Array) else ())
    with jax.ensure_compile_time_eval():
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((records.mask, likelihood))):
            check_sampling(model, records, likelihood)
        else:
            likelihood.check(model, records)
            check_sampling(model, records, likelihood)
            check_samples(records)


@fast_compile_jit
def fit_problem(problem: Problem, begin: Parameters, solver: GaussNewton) -> Fit:
    """Return the fit of a problem: the jitted core of `estimate`, compiled once for each shape.

    The arguments are those of `minimise`.
    """
    return fit_of(problem, *minimise(problem, begin, solver), solver)


def fit_of(problem: Problem, parameters: Parameters, state: State, solver: GaussNewton) -> Fit:
    """Return the fit at the end of an iteration.

    Args:
        problem: the estimation problem.
        parameters: the best parameters.
        state: last state of the solver.
        solver: options of the iteration.
    """
    linearised, policy = state.linearised, solver.policy
    information, v = linearised.information, linearised.v
    svd = (
        spectrum(information.triangle, information.rhs, problem.limits.scale)
        if parameters.shared.size
        else _no_spectrum()
    )
    covariance = svd.covariance(policy.threshold) if parameters.shared.size else jnp.zeros((0, 0))
    limits = problem.limits
    on_bound = jax.tree.map(
        lambda x, low, high: (x <= low) | (x >= high), parameters, limits.lower, limits.upper
    )
    model, _ = problem.model_of(parameters, 0)
    robust = _robust(problem, parameters, linearised, covariance, svd.square_root(policy.threshold))
    return Fit(
        parameters=parameters,
        cost=state.cost,
        information=information,
        spectrum=svd,
        covariance=covariance,
        own_covariance=information.own.covariance(covariance, svd, policy.threshold),
        robust_covariance=robust.covariance,
        robust_dof=robust.dof,
        robust_own=robust.own,
        noise=problem.likelihood.measurement_covariance(model, v, problem.records.mask),
        residuals=problem.likelihood.residuals(v, problem.records.mask),
        shared_on_bound=on_bound.shared,
        own_on_bound=on_bound.rows,
        result=_result(state, jnp.any(on_bound.shared) | jnp.any(on_bound.rows)),
        iterations=state.accepted,
        costs=state.costs,
        decrements=state.decrements,
    )


class _Robust(NamedTuple):
    """Covariance of the shared parameters corrected for the colour of the residuals, degrees of
    freedom, and the covariances of each record's own parameters with themselves and the shared
    ones.
    """

    covariance: Float[Array, "parameter parameter"]
    dof: Float[Array, " parameter"]
    own: Float[Array, "case own unknown"]


def _robust(problem: Problem, parameters: Parameters, linearised, covariance, half) -> _Robust:
    """Return the covariances corrected for the colour of the residuals.

    Variances that this would make smaller than under white residuals keep the latter value. The
    own part of a stack too large to keep its sensitivities is corrected by the shared one alone.
    """
    score = problem.score_spectrum(parameters, linearised, half)
    count, v = score.power.shape[1], linearised.v
    white, mask = problem.misfit(v)[..., :count], problem.row_mask[..., :count]
    variance, dof, products = coloured_variances(score, white, mask, problem.batch)
    plain = jnp.sum(half**2, axis=1)
    ratio = variance / jnp.where(plain > 0, plain, 1.0)
    least = problem.likelihood.noise.white_power(white, mask)
    inflation = jnp.sqrt(jnp.maximum(jnp.where(plain > 0, ratio, 1.0), least))
    robust, own = covariance * inflation[:, None] * inflation[None], linearised.information.own
    if products is None:
        finite = jnp.where(jnp.isfinite(robust), robust, 0.0)
        return _Robust(robust, dof, own.joint_covariance(finite))
    return _Robust(robust, dof, _robust_own(own, half, products, least))


def _robust_own(own: OwnBlock, half, products, least) -> Float[Array, "case own unknown"]:
    """Return the covariances of own parameters from `ColouredVariances.products`.

    d_own = inverse (Q_own'v - coupling d_shared),    d_shared = half Q_shared'v
    """
    n, zeros = own.rhs.shape[-1], jnp.zeros((own.rhs.shape[0], half.shape[0], own.rhs.shape[-1]))
    above = jnp.concatenate([own.inverse, -own.inverse @ own.coupling @ half], axis=-1)
    below = jnp.concatenate([zeros, jnp.broadcast_to(half, (len(zeros), *half.shape))], axis=-1)
    turned = jnp.concatenate([above, below], axis=-2)
    white = jnp.sum(turned**2, axis=-1)
    joint = turned @ products @ turned.mT
    ratio = jnp.diagonal(joint, axis1=-2, axis2=-1) / jnp.where(white > 0, white, 1.0)
    positive = jnp.where(ratio > 0, ratio, 1.0)
    scale = jnp.sqrt(jnp.maximum(ratio, least) / positive)
    return (joint * scale[..., None] * scale[..., None, :])[:, :n]


def _result(state, on_bound) -> RESULTS:
    result = RESULTS.where(on_bound, RESULTS.at_bound, RESULTS.successful)
    result = RESULTS.where(state.converged, result, RESULTS.steps_exhausted)
    result = RESULTS.where(state.stuck & ~state.converged, RESULTS.no_descent, result)
    return RESULTS.where(state.diverged, RESULTS.start_diverges, result)


def _no_spectrum() -> Spectrum:
    return Spectrum(jnp.zeros(0), jnp.zeros((0, 0)), jnp.zeros(0), jnp.zeros(0))


def as_stack(records: Record | Sequence[Record]) -> Record:
    """Return one record or a sequence of records as a stack."""
    if isinstance(records, Record):
        return records if records.is_stack else jax.tree.map(_with_case_axis, records)
    require_records(records)
    require(len(records) > 0, "There is no record to estimate from. Give at least one.")
    return stack(list(records))


@on_host
def _with_case_axis(xp, leaf):
    return xp.expand_dims(leaf, 0)


def check_channels(model: AbstractModel, records: Record) -> None:
    """Check that records have the model's channels in its order, and the shapes of the model.

    Raises:
        InputError: with the channels of both, or with the method of the model that returns a wrong
            shape.
    """
    for kind in ("inputs", "outputs"):
        expected, recorded = getattr(model, kind), getattr(records, kind)
        if expected != recorded:
            raise InputError(
                f"The model's {kind} are ({', '.join(expected)}), the records' are "
                f"({', '.join(recorded)}). "
                "Name and order the record's channels as the model's: `columns` of `read_csv` "
                "names the columns of a file. `model.prepared(record)` "
                "selects them from a record with more channels, and copies a measured state that "
                "is an input of this model from the outputs."
            )
    check_equations(model)


def check_sampling(model: AbstractModel, records: Record, likelihood: AbstractLikelihood) -> None:
    """Check that the likelihood and, for a model with states, its stepper can use the sample times.

    Raises:
        InputError: with the records and the rows.
    """
    if isinstance(records.t, Tracer):
        return
    likelihood.check_times(records.t)
    stepper = getattr(likelihood, "stepper", None)
    if model.states and stepper is not None:
        stepper.check(records.t, records.names)


def check_samples(records: Record) -> None:
    """Check that every output has a valid sample in at least one record.

    Raises:
        InputError: with the name of the output.
    """
    observed = np.any(np.asarray(records.mask), axis=(0, 1))
    for name, valid in zip(records.outputs, observed, strict=True):
        require(
            bool(valid),
            f"The output {name!r} has no valid sample in any record. Leave it out of "
            "model and records.",
        )


def failure(problem: Problem, fit: Fit, result: Estimate) -> InputError:
    """Return the error for a failed fit: its status, or for a diverging start time and state."""
    if bool(jnp.any(fit.result == RESULTS.start_diverges)):
        return divergence(problem.model, result.free, problem.records, problem.likelihood)
    return InputError(str(result.status))


def divergence(
    model: AbstractModel, free: Free, records: Record, likelihood: AbstractLikelihood
) -> InputError:
    """Return the error for a model whose simulation, or else its likelihood, is not finite at the
    initial parameters.

    It contains the record, the time, the state, the parameters and the initial state.
    """
    problem = Problem.of(model, free, records, likelihood)
    begin = initial_parameters(model, problem.positions, records)
    solution = _solved(problem, begin)
    if bool(jnp.all(solution.finite)):
        return InputError(INFINITE_LIKELIHOOD)
    case = int(np.argmin(solution.finite))
    message = explain_divergence(
        jax.tree.map(lambda leaf: leaf[case], solution), model, f"record {case}"
    )
    first = np.asarray(solution.x)[case, 0]
    values, states = (
        ", ".join(f"{name} = {value:.4g}" for name, value in zip(names, numbers, strict=True))
        for names, numbers in ((free.shared, begin.shared.tolist()), (model.states, first.tolist()))
    )
    return InputError(f"{message} The parameters were {values}; the initial state was {states}.")


@fast_compile_jit
def _solved(problem: Problem, parameters: Parameters) -> Solution:
    """Return the simulation of every record (jitted)."""
    return problem.solve(parameters)
