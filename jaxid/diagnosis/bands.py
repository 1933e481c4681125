"""Histories of a fit (states, outputs, signals) with their standard deviations."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.checks import require_known
from .._foundation.compiler import fast_compile_jit
from .._foundation.types import Array, Float
from ..data.record import Record
from ..estimation.coloured_errors import colour_ratio
from ..estimation.estimate import as_stack, check_channels
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.problem import Problem
from ..estimation.result import Estimate
from ..models.base import AbstractModel
from ..models.free import Parameters
from ..models.free_model import FreeModel
from ..sensitivity.information import covariance_of_unknowns
from ..sensitivity.jacobian import value_and_jacobian


class Band(eqx.Module):
    """A history and its standard deviation, each of shape (case, time).

    Attributes:
        value: history computed by the model.
        deviation: its standard deviation, from that of the parameters.
    """

    value: Float[Array, "case time"]
    deviation: Float[Array, "case time"]


class Bands(eqx.Module):
    """Histories of a fit with the standard deviations that follow from those of its parameters.

    Attributes:
        t: time, shape (case, time) [s].
        states, outputs, signals: by name.
        measured: the outputs, with the measurement noise in their deviation: the band of a
            repeated measurement.
    """

    t: Float[Array, "case time"]
    states: dict[str, Band]
    outputs: dict[str, Band]
    measured: dict[str, Band]
    signals: dict[str, Band]


def prediction_bands(
    fit: Estimate,
    records: Record | Sequence[Record],
    likelihood: AbstractLikelihood,
    signals: Sequence[str] = (),
    *,
    coloured: bool = False,
) -> Bands:
    r"""Return the histories of a fit on its records with their standard deviations.

        sigma_c^2 = diag( dc/dtheta M^-1 dc/dtheta' )       of signals (6.4), states (6.5, 4.13)
        sigma_y^2 = diag( dy/dtheta M^-1 dy/dtheta' ) + R   of outputs (6.6, 4.14)

    with `dc/dtheta` along the whole trajectory, so that the effect of an uncertain parameter on the
    state is included, and with the records' own unknowns (initial state, biases) among the
    parameters. With process noise (`FilterError`) the histories are the smoother's, and
    `dc/dx P dc/dx'` is added, with the covariance P of its states. The deviations assume a correct
    model and, unless they are `coloured`, white residuals. A direction that the data do not
    determine is treated as known; `Estimate.weak_directions` names it.

    Args:
        fit: from `estimate`, on one record or several.
        records: the records of the fit, in the same order.
        likelihood: the likelihood of the fit.
        signals: names of the model's signals, such as a coefficient.
        coloured: take the errors corrected for the colour of the residuals.

    Raises:
        InputError: if channels differ or a signal does not exist.
    """
    records = as_stack(records)
    check_channels(fit.model, records)
    problem, model = Problem.of(fit.model, fit.free, records, likelihood), fit.model
    known = jax.eval_shape(
        model.signals, records.t[0, 0], jnp.zeros(len(model.states)), records.u[0, 0]
    )
    require_known("signal", signals, known)
    covariance = jnp.where(jnp.isfinite(fit.covariance), fit.covariance, 0.0)
    own = fit.information.own.joint_covariance(covariance)
    if coloured:
        ratio = colour_ratio(fit.standard_errors, fit.corrected_errors)
        covariance, own = covariance * ratio[:, None] * ratio[None], fit.corrected_own
    histories = _histories(problem, fit.parameters, (own, covariance), tuple(signals))
    first, last = len(model.states), len(model.states) + len(model.outputs)
    states = _by_name(model.states, histories[..., :first])
    outputs = _by_name(model.outputs, histories[..., first:last])
    others = _by_name(tuple(signals), histories[..., last:])
    noise = dict(zip(model.outputs, jnp.diagonal(fit.noise), strict=True))
    measured = {
        name: Band(band.value, jnp.sqrt(band.deviation**2 + noise[name]))
        for name, band in outputs.items()
    }
    return Bands(records.t, states, outputs, measured, others)


def _by_name(names, histories) -> dict[str, Band]:
    """Return the history of each name, of values and deviations of shape (2, case, time, name)."""
    return {name: Band(*histories[..., k]) for k, name in enumerate(names)}


@fast_compile_jit
def _histories(
    problem: Problem,
    parameters: Parameters,
    covariances: tuple[Float[Array, "case own unknown"], Float[Array, "parameter parameter"]],
    names: tuple[str, ...],
):
    """Values and deviations of all states, outputs and signals, shape (2, case, time, name)."""
    joint, likelihood = covariance_of_unknowns(*covariances), problem.likelihood

    def one_record(own, covariance, case):
        flat, record = case
        family = FreeModel(problem.model, flat, problem.positions)

        def histories(theta):
            model, initial_state = family(theta)
            solution, _ = likelihood.smoothed(model, record, initial_state)
            others = _signals(model, record, solution.x, names)
            return jnp.concatenate([solution.x, solution.y, others], axis=-1)

        theta = jnp.concatenate([own, parameters.shared])
        value, S = value_and_jacobian(histories, theta)
        variance = jnp.einsum("tkp,pq,tkq->tk", S, covariance, S)
        model, initial_state = family(theta)
        solution, P = likelihood.smoothed(model, record, initial_state)
        if P is not None:
            slopes = _slopes(model, record, solution.x, names)
            variance = variance + jnp.einsum("tki,tij,tkj->tk", slopes, P, slopes)
        return value, jnp.sqrt(jnp.maximum(variance, 0.0))

    return jnp.stack(jax.vmap(one_record)(parameters.rows, joint, problem.cases()))


def _signals(model: AbstractModel, record: Record, x, names: tuple[str, ...]):
    """Return the signals along the states of one record, shape (time, name)."""
    if not names:
        return jnp.zeros((x.shape[0], 0))
    signals = jax.vmap(model.signals)(record.t, x, record.u)
    return jnp.stack([signals[name] for name in names], axis=-1)


def _slopes(model: AbstractModel, record: Record, x, names: tuple[str, ...]):
    """Return the derivatives of all histories by the state, shape (time, name, state)."""

    def histories(t, x, u):
        signals = model.signals(t, x, u)
        return jnp.concatenate([x, model.output(t, x, u), *(signals[name][None] for name in names)])

    return jax.vmap(jax.jacfwd(histories, argnums=1))(record.t, x, record.u)
