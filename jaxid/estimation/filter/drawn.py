r"""Records drawn from the model of a filter.

    x_0 ~ N(x0, P0),    x_(i+1) = step(x_i) + q_i,    q_i ~ N(0, Qd_i)
    z_i = y(x_i) + e_i,    e_i ~ N(0, diag(sensor^2))

with the steps and the covariances `Qd` of the filter. For a linear model the innovations of such a
record are white, with the covariance B of the filter.
"""

import jax

from ..._foundation.types import Array, Float
from ...data.record import Record
from ...models.stochastic import StochasticModel
from ...simulation.hold import AbstractHold
from .backward_pass import square_factor
from .kalman import filter_signals, initial_moments, predicted


def drawn(
    model: StochasticModel,
    record: Record,
    initial_state: Float[Array, " state"],
    hold: AbstractHold,
    substeps: int,
    *,
    steady: bool,
    key: Array,
) -> Float[Array, "time output"]:
    """Return measurements of one record, drawn from the model with its noises.

    Args:
        model: the model with its noises.
        record: times and inputs.
        initial_state, hold, substeps, steady: as in `kalman_filter`.
        key: random key.
    """
    samples, steps = filter_signals(model, record, hold, substeps)
    mean, P = initial_moments(model, record, initial_state, hold, substeps, steady)
    first, others, sensors = jax.random.split(key, 3)
    begin = mean + square_factor(P) @ jax.random.normal(first, mean.shape)
    white = jax.random.normal(others, (record.t.size, mean.size))
    noise = jax.random.normal(sensors, record.z.shape) * model.sensor_deviations()[None]

    def interval(x, now):
        sample, steps, q, e = now
        y = model.output(sample.t, x, sample.u)
        later, _, Q = predicted(model, x, steps)
        return later + square_factor(Q) @ q, y + e

    return jax.lax.scan(interval, begin, (samples, steps, white, noise))[1]
