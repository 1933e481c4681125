"""What noise of measured inputs does to an estimate that takes them as exact: the Cramer-Rao bound does not know of it."""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.checks import require, require_known
from .._foundation.concrete import require_value
from .._foundation.types import Array, Float
from ..data.record import Record
from ..models.base import AbstractModel
from ..models.free import Parameters
from .likelihoods import AbstractLikelihood
from .problem import Problem
from .result import Estimate


def input_noise_covariance(
    model: AbstractModel,
    found: Estimate,
    records: Record,
    likelihood: AbstractLikelihood,
    noise: Mapping[str, Float[Array, ""] | float],
) -> Float[Array, "parameter parameter"]:
    r"""Covariance that white noise of the inputs adds to the shared parameters, to first order.

        theta - theta_true = C sum_i S_i' R^-1 ( e_i - G_i n ),    added = K diag(sigma^2) K',    K = -C sum_i S_i' R^-1 G_i

    Here C is the Cramer-Rao bound, S the sensitivities with what the records' own unknowns can imitate taken out, n the
    noise of every input sample and G how the outputs follow it. K has a row for each parameter, so that it comes from
    as many reverse passes, not from one pass for each sample.

    Noise that a model integrates (a gyro's, an accelerometer's) becomes a random walk of its outputs: the longer the record,
    the more of the whole error it is. It adds to the bound, which itself holds what the residuals show of it, so that the
    sum is a little too large rather than too small.

    Args:
        model: as given to `estimate`.
        found: what `estimate` gave, of one case.
        records: the stack of which it did.
        likelihood: as given to `estimate`.
        noise: standard deviation of the white noise of each sample, by input [its unit]; others are exact.

    Returns:
        To be added to `found.covariance`.

    Raises:
        InputError: for a name that is no input, a standard deviation that is negative, or nothing shared to be judged.
    """
    require_known("input (in `noise`)", noise, model.inputs)
    require(bool(found.names), "No parameter is shared by the records, so there is no covariance to add to.")
    for name, sigma in noise.items():
        require_value(
            sigma, lambda s: s >= 0, f"The noise of {name!r} is {{}}. Give a standard deviation, zero or more."
        )
    problem = Problem.of(model, found.free, records, likelihood)
    sigma = jnp.array([noise.get(name, 0.0) for name in model.inputs], float)
    return added_covariance(problem, found.parameters, found.covariance, sigma)


@eqx.filter_jit
def added_covariance(
    problem: Problem,
    parameters: Parameters,
    covariance: Float[Array, "parameter parameter"],
    sigma: Float[Array, " input"],
) -> Float[Array, "parameter parameter"]:
    """The pure inside of `input_noise_covariance`.

    Args:
        problem: what was solved.
        parameters: its solution.
        covariance: of the shared parameters.
        sigma: standard deviation of the white noise of each input.
    """
    linearised = problem.linearise(parameters)
    weights = problem.projected(linearised) @ jnp.where(jnp.isfinite(covariance), covariance, 0.0)

    def estimated(u):
        y = eqx.tree_at(lambda one: one.records.u, problem, u).outputs(parameters)
        return jnp.einsum("ctjp,ctj->p", weights, problem.whiten(linearised.v, y))

    followed = jax.jacrev(estimated)(problem.records.u)
    return jnp.einsum("pcti,i,qcti->pq", followed, sigma**2, followed)
