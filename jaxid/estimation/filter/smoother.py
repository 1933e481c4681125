r"""`smooth_states`: states and disturbances of records given all samples, with standard deviations.

Backwards through the filter of a record (Rauch, Tung & Striebel, AIAA Journal 3, 1965), with
triangular factors of all covariances, `P = F F'`:

    C_i = P(i|i) Phi_i' P(i+1|i)^-1
    x_s(i) = x(i|i) + C_i (x_s(i+1) - x(i+1|i))
    P_s(i) = (I - C_i Phi_i) P(i|i) (I - C_i Phi_i)' + C_i (Q_i + P_s(i+1)) C_i'

The last line is a sum of squares, so that its factor is the triangle of the stacked factors, and no
variance becomes negative. A singular `P(i+1|i)` is inverted on its range.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp

from ..._foundation.checks import require, require_float64, require_known
from ..._foundation.compiler import fast_compile_jit
from ..._foundation.types import Array, Float
from ...data.record import Record
from ...models.base import AbstractModel, canonical
from ...models.free import Free, Parameters
from ...models.free_model import FreeModel
from ..estimate import as_stack, check_channels
from ..problem import Problem
from ..result import Estimate
from .filter_error import FilterError
from .kalman import Filtered


class Smoothed(eqx.Module):
    """States and disturbances of records, given all samples of each record.

    Attributes:
        t: sample times [s].
        names: names of the states of the model, then of the disturbances with memory.
        values: smoothed states and disturbances.
        standard_deviations: their standard deviations, for known parameters of the model.
        covariance: their covariance at each sample.
    """

    t: Float[Array, "case time"]
    names: tuple[str, ...] = eqx.field(static=True)
    values: Float[Array, "case time state"]
    standard_deviations: Float[Array, "case time state"]
    covariance: Float[Array, "case time state state"]

    def signal(self, name: str) -> tuple[Float[Array, "case time"], Float[Array, "case time"]]:
        """Return the history of one state or disturbance, and its standard deviation.

        Raises:
            InputError: if there is no such state or disturbance.
        """
        require_known("state or disturbance", [name], self.names)
        at = self.names.index(name)
        return self.values[..., at], self.standard_deviations[..., at]


def smooth_states(
    model: AbstractModel | Estimate, records: Record | Sequence[Record], likelihood: FilterError
) -> Smoothed:
    """Return the states and disturbances of records, given all their samples.

        x_s(i) = E(x_i | z_1 ... z_N),    P_s(i) = cov(x_i | z_1 ... z_N)

    exact for a linear model; of a nonlinear one, for its linearisation along the filter.

    Args:
        model: an estimate by filter error, which has the noises and the initial states of its
            records; or a model, with the noises of `likelihood`.
        records: the records of the estimate; or, if it has no per-record parameters, any records.
        likelihood: the filter.

    Returns:
        Smoothed histories, with an axis for the records. Padding at the end of shorter records
        is extrapolated.

    Raises:
        InputError: if channels differ, or the estimate has per-record parameters of another number
            of records.
    """
    require_float64()
    records = as_stack(records)
    free, parameters = Free(()), Parameters(jnp.zeros(0), jnp.zeros((records.n_cases, 0)))
    if isinstance(model, Estimate):
        free, parameters = model.free, model.parameters
        require(
            not free.per_record or model.own.shape[0] == records.n_cases,
            f"The estimate has its own {', '.join(free.per_record)} for each of "
            f"{model.own.shape[0]} records, and there are {records.n_cases}. Give the records of "
            "the estimate, or estimate from these records first.",
        )
        if not free.per_record:
            parameters = Parameters(model.values, jnp.zeros((records.n_cases, 0)))
        model = model.model
    check_channels(model, records)
    likelihood.check(model, records)
    prepared, _ = likelihood.prepared(canonical(model), free, records)
    problem = Problem.of(prepared, free, records, likelihood)
    values, factor = smooth_stack(problem, parameters)
    covariance = factor @ jnp.swapaxes(factor, -1, -2)
    deviations = jnp.linalg.norm(factor, axis=-1)
    return Smoothed(records.t, prepared.states, values, deviations, covariance)


@fast_compile_jit
def smooth_stack(
    problem: Problem, parameters: Parameters
) -> tuple[Float[Array, "case time state"], Float[Array, "case time state state"]]:
    """Return smoothed states and factors of their covariances for a stack of records."""

    def of_case(own, case):
        flat, record = case
        assert isinstance(problem.likelihood, FilterError)
        family = FreeModel(problem.model, flat, problem.positions)
        model, initial_state = family(jnp.concatenate([own, parameters.shared]))
        return smooth_filtered(problem.likelihood.filter(model, record, initial_state))

    return jax.vmap(of_case)(parameters.rows, problem.cases())


def smooth_filtered(
    filtered: Filtered,
) -> tuple[Float[Array, "time state"], Float[Array, "time state state"]]:
    """Return smoothed states and the factors of their covariances for one record."""

    def back(later, now):
        x_later, F_later = later
        x, P, Phi, Q, x_next, P_next = now
        gain = P @ Phi.T @ _pseudoinverse(P_next)
        x_smooth = x + gain @ (x_later - x_next)
        parts = [(jnp.eye(x.size) - gain @ Phi) @ _factor(P), gain @ _factor(Q), gain @ F_later]
        triangle = jnp.linalg.qr(jnp.concatenate(parts, axis=1).T, mode="r").T
        return (x_smooth, triangle), (x_smooth, triangle)

    before = (filtered.x[:-1], filtered.P[:-1], filtered.Phi[:-1], filtered.Q[:-1])
    ahead = (filtered.x_predicted[1:], filtered.P_predicted[1:])
    last = (filtered.x[-1], _factor(filtered.P[-1]))
    _, (x, F) = jax.lax.scan(back, last, (*before, *ahead), reverse=True)
    return jnp.concatenate([x, last[0][None]]), jnp.concatenate([F, last[1][None]])


def _factor(P):
    """Return a square factor `F` with `F F' = P`, for a singular P too."""
    scale = _scale(P)
    values, vectors = jnp.linalg.eigh(P / scale[:, None] / scale[None])
    return scale[:, None] * vectors * jnp.sqrt(jnp.maximum(values, 0.0))[None]


def _pseudoinverse(P):
    scale = _scale(P)
    inverse = jnp.linalg.pinv(P / scale[:, None] / scale[None], hermitian=True)
    return inverse / scale[:, None] / scale[None]


def _scale(P):
    """Return the standard deviations of a covariance, one in place of zero."""
    deviations = jnp.sqrt(jnp.maximum(jnp.diagonal(P), 0.0))
    return jnp.where(deviations > 0.0, deviations, 1.0)
