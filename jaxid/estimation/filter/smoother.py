"""`smooth_states`: states and disturbances of records, given all their samples."""

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
from ..estimate import as_stack, check_channels, check_sampling
from ..problem import Problem
from ..result import Estimate
from .backward_pass import smooth_filtered
from .filter_error import FilterError


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
        InputError: if channels differ, the likelihood is no filter or cannot use the sample times,
            or the estimate has per-record parameters of another number of records.
    """
    require_float64()
    require(
        isinstance(likelihood, FilterError),
        f"The states are smoothed by the filter, and the likelihood is {type(likelihood).__name__}."
        " Give the `FilterError(...)` of the estimate.",
    )
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
    check_sampling(model, records, likelihood)
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
