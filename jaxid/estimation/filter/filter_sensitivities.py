r"""Derivatives of the innovations of a filter and of their covariances with respect to parameters.

The filter runs once. Along its states the model is differentiated in parallel, in blocks of
samples: `update_derivatives` gives the update at a measurement, `prediction_derivatives` the step
after it, as linear functions of the derivatives of state and covariance before. After that these
follow a linear recursion of matrices, in which the model has no part:

    dx+ = N (dx + dP V' w) + Z_x dx + Z_p,    dP+ = N dP N' + Y_x dx + Y_p
    dx <- Phi dx+ + G,    dP <- Phi dP+ Phi' + C_x dx+ + C_p
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..._foundation.types import Array, Float
from ...data.record import Record
from ...models.free_model import FreeModel
from ...sensitivity.jacobian import value_and_jacobian
from ...sensitivity.linearisation import in_blocks
from ...simulation.hold import AbstractHold
from .filter_run import SAMPLES_TOGETHER, FilterRun, stochastic
from .innovation_rows import white_rows
from .kalman import initial_moments
from .matrix_derivatives import congruence, left_product
from .prediction_derivatives import Prediction, PredictionModel, differentiate_prediction
from .update_derivatives import (
    Update,
    differentiate_update,
    output_derivatives,
)


class FilterSensitivities(NamedTuple):
    """Result of a filter, with derivatives by the parameters.

    Attributes:
        v: innovations.
        B: their covariances.
        rows: derivatives of the rows of the information, from `white_rows`.
    """

    v: Float[Array, "time output"]
    B: Float[Array, "time output output"]
    rows: Float[Array, "time row parameter"]


def filter_sensitivities(
    family: FreeModel,
    theta: Float[Array, " parameter"],
    record: Record,
    hold: AbstractHold,
    substeps: int,
    *,
    steady: bool,
) -> FilterSensitivities:
    """Return the derivatives for one record; the arguments are those of `kalman_filter`.

    Args:
        family: the model and the initial state as functions of the parameters.
        theta: values of the parameters.
        record, hold, substeps, steady: as in `kalman_filter`.
    """
    leaves = family.leaves(theta)
    run = FilterRun.of(family, leaves, record, hold, substeps, steady=steady)
    filtered, measured, acting, inputs = run.filtered, run.measured, run.acting, run.inputs
    start, dR = _start(family, theta, record, hold, substeps, steady)
    at = record.t[0], run.initial_state, measured.u[0]
    outputs = output_derivatives(family, leaves, at, acting)
    moving = PredictionModel.of(family, leaves, at, acting)

    def block(carry, now):
        measured, d_samples, x, steps, d_stages = now
        update = differentiate_update(outputs, leaves, acting, measured, d_samples, dR)
        prediction = differentiate_prediction(moving, x, measured.P_after, steps, d_stages)
        return jax.lax.scan(_sample, carry, (update, prediction))

    now = (measured, inputs.d_samples, filtered.x, run.steps, inputs.d_stages)
    blocks = jax.tree.map(lambda leaf: in_blocks(leaf, SAMPLES_TOGETHER), now)
    _, rows = jax.lax.scan(block, start, blocks)
    rows = rows.reshape(-1, *rows.shape[2:])[: record.t.size]
    return FilterSensitivities(filtered.v, filtered.B, rows)


def _start(family, theta, record, hold, substeps, steady):
    """Return the derivatives of the state and of the covariance before the first sample, and of the
    variances of the sensors.
    """

    def begin(theta):
        model, x0 = stochastic(family, family.leaves(theta))
        moments = initial_moments(model, record, x0, hold, substeps, steady)
        return jnp.concatenate([part.reshape(-1) for part in moments])

    n = len(family.model.states)
    start = value_and_jacobian(begin, theta)[1]

    def variances(theta):
        return stochastic(family, family.leaves(theta))[0].sensor_deviations() ** 2

    _, dR = value_and_jacobian(variances, theta)
    return (start[:n], start[n:].reshape(n, n, theta.size)), dR


def _sample(carry, now: tuple[Update, Prediction]):
    """Return the derivatives after a sample and a step, and those of its rows."""
    dx, dP = carry
    update, prediction = now
    n, Phi = dx.shape[0], prediction.x.x
    dB = congruence(update.V, dP)
    rows = update.rows.along(dx) + white_rows(jnp.zeros_like(dB[0]), dB)
    own = update.moments.along(dx)
    turned = left_product(update.N, dP)
    dx = update.N[:n] @ (dx + turned[n]) + own[:n, n]
    dP = left_product(update.N[:n], jnp.swapaxes(turned[:n], 0, 1)) + own[:n, :n]
    dP = congruence(Phi, dP) + prediction.P.along(dx)
    return (prediction.x.along(dx), dP), rows
