"""How well a fit knows the histories that it says: states, outputs and signals with their standard deviations."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.checks import require_known
from .._foundation.types import Array, Float
from ..data.record import Record
from ..estimation.estimate import as_stack, check_channels
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Problem
from ..estimation.result import Estimate
from ..models.free import Parameters
from ..sensitivity.information import Information
from ..sensitivity.jacobian import value_and_jacobian


class Band(eqx.Module):
    """A history and its standard deviation, each of shape (case, time).

    Attributes:
        value: what the model says.
        deviation: its standard deviation, from that of the parameters.
    """

    value: Float[Array, "case time"]
    deviation: Float[Array, "case time"]


class Bands(eqx.Module):
    """Histories of a fit with the standard deviations that follow from those of its parameters.

    Attributes:
        t: time, shape (case, time) [s].
        states, outputs, signals: by name.
        measured: the outputs with the noise of the measurement in their deviation: what a repeated measurement would show.
    """

    t: Float[Array, "case time"]
    states: dict[str, Band]
    outputs: dict[str, Band]
    measured: dict[str, Band]
    signals: dict[str, Band]


def bands(
    fit: Estimate, records: Record | Sequence[Record], likelihood: AbstractLikelihood, signals: Sequence[str] = ()
) -> Bands:
    r"""Standard deviations in time of what a fit says of the records that it was fitted to.

        sigma_c^2 = diag( dc/dtheta M^-1 dc/dtheta' )       of signals (6.4), states (6.5, 4.13)
        sigma_y^2 = diag( dy/dtheta M^-1 dy/dtheta' ) + R   of outputs (6.6, 4.14)

    with `dc/dtheta` along the whole trajectory, so that an uncertain parameter counts for where it takes the state, too, and with
    the records' own unknowns (initial state, biases) among the parameters. The deviations are those of white residuals and of
    a model that is right; a direction that the data do not determine counts as known, and `Estimate.weak_directions` names it.

    Args:
        fit: from `estimate`, of one case or several.
        records: those it was fitted to, in their order.
        likelihood: that of the fit.
        signals: names of the model's signals, such as a coefficient.

    Raises:
        InputError: when channels differ or a signal does not exist.
    """
    records = as_stack(records)
    check_channels(fit.model, records)
    problem, model = Problem.of(fit.model, fit.free, records, likelihood), fit.model
    known = jax.eval_shape(model.signals, records.t[0, 0], jnp.zeros(len(model.states)), records.u[0, 0])
    require_known("signal", signals, known)
    found = _histories(problem, fit.parameters, fit.information, fit.covariance, tuple(signals))
    states, outputs, others = (
        _by_name(names, *pair) for names, pair in zip((model.states, model.outputs, tuple(signals)), found, strict=True)
    )
    noise = dict(zip(model.outputs, jnp.diagonal(fit.noise), strict=True))
    measured = {name: Band(band.value, jnp.sqrt(band.deviation**2 + noise[name])) for name, band in outputs.items()}
    return Bands(records.t, states, outputs, measured, others)


def _by_name(names, values, deviations) -> dict[str, Band]:
    return {name: Band(values[..., k], deviations[..., k]) for k, name in enumerate(names)}


@eqx.filter_jit
def _histories(problem: Problem, parameters: Parameters, information: Information, covariance, names: tuple[str, ...]):
    """Values and deviations of states, outputs and signals, each of shape (case, time, name)."""
    count = problem.positions.rows.size
    joint = _joint_covariance(information, covariance)

    def one(own, covariance, case):
        def histories(theta):
            solution, model = problem.solve_one(theta[:count], theta[count:], case)
            seen = jax.vmap(model.signals)(solution.t, solution.x, case[1].u)
            others = jnp.stack([seen[name] for name in names], axis=-1) if names else jnp.zeros((solution.t.size, 0))
            return jnp.concatenate([solution.x, solution.y, others], axis=-1)

        value, S = value_and_jacobian(histories, jnp.concatenate([own, parameters.shared]))
        return value, jnp.sqrt(jnp.maximum(jnp.einsum("tkp,pq,tkq->tk", S, covariance, S), 0.0))

    both = jax.vmap(one)(parameters.rows, joint, problem.cases())
    ends = (len(problem.model.states), len(problem.model.states) + len(problem.model.outputs))
    return tuple(zip(*(jnp.split(array, ends, axis=-1) for array in both), strict=True))


def _joint_covariance(information: Information, shared: Float[Array, "parameter parameter"]):
    """Covariance of each record's own unknowns together with the shared ones, `d_own = inverse (rhs - coupling d_shared)`."""
    shared = jnp.where(jnp.isfinite(shared), shared, 0.0)
    inverse, coupling = information.own.inverse, information.own.coupling
    across = -inverse @ coupling @ shared
    own = inverse @ inverse.mT + inverse @ coupling @ shared @ coupling.mT @ inverse.mT
    below = jnp.broadcast_to(shared, (across.shape[0], *shared.shape))
    return jnp.concatenate(
        [jnp.concatenate([own, across], axis=-1), jnp.concatenate([across.mT, below], axis=-1)], axis=-2
    )
