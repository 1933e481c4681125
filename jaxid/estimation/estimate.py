"""`estimate`: maximum likelihood, from a model and its records to values that can be defended."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer

from .._foundation.checks import InputError, require, require_float64
from .._foundation.results import RESULTS
from .._foundation.types import Array, Bool, Float, Int
from ..data.record import Record
from ..data.stack import stack
from ..models.base import AbstractModel, canonical
from ..models.free import Free, Parameters, start
from ..sensitivity.information import Information
from ..sensitivity.spectrum import Spectrum, spectrum
from ..simulation.simulate import explain_divergence
from .coloured import score_covariance
from .likelihoods import AbstractLikelihood
from .problem import Problem
from .result import Estimate
from .solver import GaussNewton, minimise


class Fit(eqx.Module):
    """What a fit leaves behind, as arrays only: the inside of an `Estimate`, without a name in it."""

    parameters: Parameters
    cost: Float[Array, ""]
    information: Information
    spectrum: Spectrum
    covariance: Float[Array, "parameter parameter"]
    own_covariance: Float[Array, "case own own"]
    coloured: Float[Array, "parameter parameter"]
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

    by Gauss-Newton (4.19) on square-root information, with R re-estimated at each iteration where it is unknown.

    Args:
        model: the model; its values are the start, and stay where nothing is free.
        free: which parameters are free, made by `free(...)`.
        records: one record, several, or a stack.
        likelihood: how the misfit is measured, such as `OutputError()`.
        solver: how to iterate.
        throw: raise where the iteration fails; otherwise the status tells.

    Returns:
        Values with standard errors and all that judges them. Under `vmap` every case has its own status.

    Raises:
        InputError: when channels of model and records differ, the noise model does not suit the gaps, or JAX is in 32 bit;
            with `throw`, also when the simulation diverges at the start or the iteration does not converge.
    """
    require_float64()
    records = as_stack(records)
    check_channels(model, records)
    model, free = canonical(model), canonical(free)
    if not isinstance(records.t, Tracer):
        likelihood.check(model, records)
        check_samples(records)
    problem = Problem.of(model, free, records, likelihood)
    solver = solver or GaussNewton()
    fit = fit_problem(problem, start(model, problem.positions, problem.records), solver)
    found = Estimate.of(fit, model, free, records, solver.policy.threshold)
    if throw and not bool(jnp.all(found.successful)):
        raise failure(problem, fit, found)
    return found


@eqx.filter_jit
def fit_problem(
    problem: Problem,
    begin: Parameters,
    solver: GaussNewton,
    S: Float[Array, "case time output column"] | None = None,
) -> Fit:
    """The pure inside of `estimate`: arrays in, arrays out, compiled once for each shape; arguments as `minimise` takes them."""
    parameters, state = minimise(problem, begin, solver, S)
    linearised, policy = state.linearised, solver.policy
    information, v = linearised.information, linearised.v
    found = (
        spectrum(information.triangle, information.rhs, problem.limits.scale) if begin.shared.size else _no_spectrum()
    )
    covariance = found.covariance(policy.threshold) if begin.shared.size else jnp.zeros((0, 0))
    shared = problem.projected(linearised)
    limits = problem.limits
    on_bound = jax.tree.map(lambda x, low, high: (x <= low) | (x >= high), parameters, limits.lower, limits.upper)
    noise = problem.likelihood.noise.cholesky(v, problem.records.mask)
    return Fit(
        parameters=parameters,
        cost=state.cost,
        information=information,
        spectrum=found,
        covariance=covariance,
        own_covariance=information.own.covariance(jnp.where(jnp.isfinite(covariance), covariance, 0.0)),
        coloured=_coloured(problem, shared, v, covariance),
        noise=noise @ noise.T,
        residuals=v,
        shared_on_bound=on_bound.shared,
        own_on_bound=on_bound.rows,
        result=_result(state, jnp.any(on_bound.shared) | jnp.any(on_bound.rows)),
        iterations=state.accepted,
        costs=state.costs,
        decrements=state.decrements,
    )


def _coloured(problem: Problem, S, v, covariance):
    """Covariance corrected for the colour that the residuals show, `C B C`; that of white residuals where it is larger."""
    finite = jnp.where(jnp.isfinite(covariance), covariance, 0.0)
    corrected = finite @ score_covariance(S, problem.whiten(v, v)) @ finite
    inflation = jnp.sqrt(
        jnp.maximum(jnp.diagonal(corrected) / jnp.where(jnp.diagonal(finite) > 0, jnp.diagonal(finite), 1.0), 1.0)
    )
    return covariance * inflation[:, None] * inflation[None]


def _result(state, on_bound) -> RESULTS:
    result = RESULTS.where(on_bound, RESULTS.at_bound, RESULTS.successful)
    result = RESULTS.where(state.converged, result, RESULTS.steps_exhausted)
    result = RESULTS.where(state.stuck & ~state.converged, RESULTS.no_descent, result)
    return RESULTS.where(state.diverged, RESULTS.start_diverges, result)


def _no_spectrum() -> Spectrum:
    return Spectrum(jnp.zeros(0), jnp.zeros((0, 0)), jnp.zeros(0), jnp.zeros(0))


def as_stack(records: Record | Sequence[Record]) -> Record:
    """One record or several as a stack."""
    if isinstance(records, Record):
        return records if records.is_stack else jax.tree.map(lambda leaf: leaf[None], records)
    require(len(records) > 0, "There is no record to estimate from. Give at least one.")
    return stack(list(records))


def check_channels(model: AbstractModel, records: Record) -> None:
    """Refuse records whose channels are not the model's, in the model's order.

    Raises:
        InputError: it names the channels of both.
    """
    for kind in ("inputs", "outputs"):
        wanted, found = getattr(model, kind), getattr(records, kind)
        if wanted != found:
            raise InputError(
                f"The model's {kind} are ({', '.join(wanted)}), the records' are ({', '.join(found)}). "
                "Name and order the record's channels as the model's; `model.prepared(record)` takes them from one that holds "
                "more, and a measured state that is an input here from the outputs."
            )


def check_samples(records: Record) -> None:
    """Refuse records in which an output has no valid sample at all.

    Raises:
        InputError: it names the output.
    """
    seen = jnp.any(records.mask, axis=(0, 1))
    for name, valid in zip(records.outputs, seen, strict=True):
        require(
            bool(valid), f"The output {name!r} has no valid sample in any record. Leave it out of model and records."
        )


def failure(problem: Problem, fit: Fit, found: Estimate) -> InputError:
    """The error for a fit that failed: its status, and for a diverging start the time and the state."""
    if bool(jnp.any(fit.result == RESULTS.start_diverges)):
        return divergence(problem.model, found.free, problem.records, problem.likelihood)
    return InputError(str(found.status))


def divergence(model: AbstractModel, free: Free, records: Record, likelihood: AbstractLikelihood) -> InputError:
    """The error for a model whose simulation diverges at its starting values: record, time, state and parameters."""
    problem = Problem.of(model, free, records, likelihood)
    begin = start(model, problem.positions, records)
    solution = problem.solve(begin)
    case = int(jnp.argmin(solution.finite))
    told = explain_divergence(jax.tree.map(lambda leaf: leaf[case], solution), model, f"record {case}")
    values = ", ".join(f"{name} = {float(value):.4g}" for name, value in zip(free.shared, begin.shared, strict=True))
    return InputError(f"{told} The parameters were {values}.")
