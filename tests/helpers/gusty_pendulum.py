"""A pendulum in gusts: estimation problems of a nonlinear model with process noise."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxid import Augmented, FilterError, FirstOrder
from jaxid._foundation.types import Array
from jaxid.data import record
from jaxid.effects import InputDelay
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.problem import Problem
from jaxid.models import AbstractModel, free
from jaxid.models.base import canonical
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
    "coloured noise of a sensor": (
        PENDULUM,
        free(PENDULUM, *PHYSICS[:2]),
        FilterError({"rate": 0.2}, {"force": (0.1, FirstOrder(0.3, 0.4))}),
    ),
}


def pendulum_problem(case):
    """Uneven samples, a third of them missing; more samples than one block."""
    model, chosen, likelihood = CASES[case]
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.uniform(0.05, 0.1, 40))
    z = np.stack([np.sin(2 * t), np.cos(3 * t), 2 * np.cos(2 * t)], 1)
    z[rng.uniform(size=z.shape) < 0.3] = np.nan
    torque = 1.3 * np.sin(3 * t)[:, None]
    records = as_stack(record(t, torque, z, inputs=("torque",), outputs=model.outputs))
    wide, chosen = likelihood.prepared(canonical(model), canonical(chosen), records)
    return Problem.of(wide, chosen, records, likelihood), len(CASES[case][1].shared)
