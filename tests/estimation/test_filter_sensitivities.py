"""Derivatives of the filter of a nonlinear model against forward mode through the filter."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import Augmented, FilterError, FirstOrder
from jaxid._foundation.types import Array
from jaxid.data import record
from jaxid.effects import InputDelay
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.filter.kalman import inverse_cholesky
from jaxid.estimation.problem import Problem
from jaxid.models import AbstractModel, free
from jaxid.models.base import canonical
from jaxid.models.free import initial_parameters
from jaxid.models.free_model import FreeModel
from jaxid.sensitivity.jacobian import value_and_jacobian
from jaxid.simulation.steppers import RK4


class Pendulum(AbstractModel):
    """A pendulum whose damping is a table, driven by a torque and by a gust that depends on it."""

    stiffness: Array
    damping: Array
    table: Array
    gust: tuple[str, ...] = eqx.field(static=True, default=())
    states, outputs = ("angle", "rate"), ("sine", "force", "rate")

    @property
    def inputs(self):
        return ("torque", *self.gust)

    def rhs(self, t, x, u):
        angle, rate = x
        force = jnp.sum(u[1:]) * (1.0 + 0.3 * jnp.sin(angle))
        own = jnp.interp(angle, jnp.linspace(-3.0, 3.0, self.table.size), self.table)
        pull = self.stiffness * jnp.sin(angle) + (self.damping + own) * rate * jnp.abs(rate)
        return jnp.stack([rate, jnp.tanh(u[0]) * jnp.cos(angle) - pull + self.damping * force])

    def output(self, t, x, u):
        sine = jnp.sin(x[0])
        return jnp.stack([sine, self.stiffness * sine * jnp.cos(x[0]) + u[0] * x[1] ** 2, x[1]])

    def with_disturbance_inputs(self):
        return Pendulum(self.stiffness, self.damping, self.table, gust=("gust",))


PENDULUM = Pendulum(jnp.array(4.0), jnp.array(0.3), 0.1 * jnp.cos(jnp.arange(40.0)))
DELAYED = Augmented(PENDULUM, (InputDelay("torque", jnp.array(0.03)),))
PHYSICS = ("stiffness", "damping", "table[17]")
CASES = {
    "white gust through the torque, delay, two steps": (
        DELAYED,
        free(DELAYED, *PHYSICS, "delay of input torque.gain", per_record=("initial_state",)),
        FilterError({"gust": 0.4}, stepper=RK4(2)),
    ),
    "gust with memory, random start": (
        PENDULUM,
        free(PENDULUM, *PHYSICS[:2]),
        FilterError({"gust": FirstOrder(0.5, 1.0), "rate": 0.2}, initial={"angle": 0.1}),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_derivatives_of_nonlinear_model_equal_forward_mode(case):
    """Uneven samples, a third of them missing; more samples than one block."""
    model, chosen, likelihood = CASES[case]
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.uniform(0.05, 0.1, 40))
    z = np.stack([np.sin(2 * t), np.cos(3 * t), 2 * np.cos(2 * t)], 1)
    z[rng.uniform(size=z.shape) < 0.3] = np.nan
    torque = 1.3 * np.sin(3 * t)[:, None]
    records = as_stack(record(t, torque, z, inputs=("torque",), outputs=model.outputs))
    wide, chosen = likelihood.prepared(canonical(model), canonical(chosen), records)
    problem = Problem.of(wide, chosen, records, likelihood)
    begin = initial_parameters(problem.model, problem.positions, records)
    flat, one = jax.tree.map(lambda leaf: leaf[0], problem.cases())
    family = FreeModel(problem.model, flat, problem.positions)
    theta = jnp.concatenate([begin.rows[0], begin.shared])

    def innovations(theta):
        model, x0 = family(theta)
        filtered = likelihood.filter(model, one, x0)
        return jnp.concatenate([filtered.v, filtered.B.reshape(t.size, -1)], axis=-1)

    value, derivative = jax.jit(lambda theta: value_and_jacobian(innovations, theta))(theta)
    inverse = inverse_cholesky(value[:, 3:].reshape(-1, 3, 3))
    dB = np.asarray(derivative[:, 3:]).reshape(t.size, 3, 3, -1)
    first, second = np.triu_indices(3)
    white = np.einsum("tij,tjkp,tlk->tilp", inverse, dB, inverse)[:, first, second]
    weight = np.where(first == second, np.sqrt(0.5), 1.0)[None, :, None]
    expected = [-np.einsum("tij,tjp->tip", inverse, derivative[:, :3]), -weight * white]
    expected = np.concatenate(expected, axis=1)
    _, rows = jax.jit(lambda theta: likelihood.sensitivities(family, theta, one))(theta)
    scale = np.abs(expected).max(axis=(0, 1))
    np.testing.assert_allclose(np.asarray(rows) / scale, expected / scale, atol=1e-12)
