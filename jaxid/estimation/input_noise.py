"""Covariance that noise of measured inputs adds to an estimate.

The Cramer-Rao bound assumes exact inputs and does not contain it.
"""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.checks import require, require_known
from .._foundation.traced_checks import require_value
from .._foundation.types import Array, Float
from ..data.record import Record
from ..models.base import AbstractModel
from ..models.free import Parameters
from .likelihoods import AbstractLikelihood
from .problem import Problem
from .result import Estimate


def input_noise_covariance(
    model: AbstractModel,
    result: Estimate,
    records: Record,
    likelihood: AbstractLikelihood,
    noise: Mapping[str, Float[Array, ""] | float],
) -> Float[Array, "parameter parameter"]:
    r"""Return the covariance that white input noise adds to the shared parameters, to first order.

        theta - theta_true = C sum_i S_i' R^-1 ( e_i - G_i n ),
        added = K diag(sigma^2) K',    K = -C sum_i S_i' R^-1 G_i

    Here C is the Cramer-Rao bound, S the sensitivities without the part that the unknowns of each
    record can reproduce, n the noise of every input sample and G the derivative of the outputs by
    it. K has a row for each parameter, so that it needs one reverse pass per parameter and not one
    pass per sample.

    Noise that a model integrates (of a gyro or an accelerometer) becomes a random walk of the
    outputs: its share of the total error grows with the length of the record. The bound already
    contains the part of this noise that appears in the residuals, so that the sum is slightly too
    large rather than too small.

    Args:
        model: as given to `estimate`.
        result: the estimate, of one case.
        records: the stack from which it was made.
        likelihood: as given to `estimate`.
        noise: standard deviation of the white noise of each sample, by input [its unit]; other
            inputs are exact.

    Returns:
        The covariance to be added to `result.covariance`, shape (parameter, parameter).

    Raises:
        InputError: as `check_input_noise`, or for an estimate without shared parameters.
    """
    check_input_noise(model, likelihood, noise)
    require(
        bool(result.names),
        "No parameter is shared by the records, so there is no covariance to add to.",
    )
    problem = Problem.of(model, result.free, records, likelihood)
    sigma = jnp.array([noise.get(name, 0.0) for name in model.inputs], float)
    return added_covariance(problem, result.parameters, result.covariance, sigma)


def check_input_noise(
    model: AbstractModel,
    likelihood: AbstractLikelihood,
    noise: Mapping[str, Float[Array, ""] | float],
) -> None:
    """Check that the effect of input noise on an estimate can be computed.

    The arguments are those of `input_noise_covariance`.

    Raises:
        InputError: for a likelihood that corrects the states by the measurements, a name that is no
            input, or a negative standard deviation.
    """
    require(
        likelihood.simulates,
        f"The noise of measured inputs is added to estimates from a simulation, and "
        f"{type(likelihood).__name__} corrects the states by the measurements. Use OutputError().",
    )
    require_known("input (in `noise`)", noise, model.inputs)
    for name, sigma in noise.items():
        require_value(
            sigma,
            lambda s: s >= 0,
            f"The noise of {name!r} is {{}}. Give a standard deviation, zero or more.",
        )


@eqx.filter_jit
def added_covariance(
    problem: Problem,
    parameters: Parameters,
    covariance: Float[Array, "parameter parameter"],
    sigma: Float[Array, " input"],
) -> Float[Array, "parameter parameter"]:
    """Return the added covariance: the jitted core of `input_noise_covariance`.

    Args:
        problem: the estimation problem.
        parameters: its solution.
        covariance: of the shared parameters.
        sigma: standard deviation of the white noise of each input.
    """
    linearised = problem.informed(*problem.sensitivities(parameters), parameters)
    weights = problem.projected(linearised) @ jnp.where(jnp.isfinite(covariance), covariance, 0.0)

    def estimated(u):
        y = eqx.tree_at(lambda tree: tree.records.u, problem, u).outputs(parameters)
        return jnp.einsum("ctjp,ctj->p", weights, problem.whiten(linearised.v, y))

    gains = jax.jacrev(estimated)(problem.records.u)
    return jnp.einsum("pcti,i,qcti->pq", gains, sigma**2, gains)
