"""The spring on which the loop is tried."""

import jax.numpy as jnp
import numpy as np

from jaxid import AbstractModel, record, simulate
from jaxid._foundation.types import Array
from jaxid.effects import Augmented

SIGMA = 0.02


class Spring(AbstractModel):
    """`dv/dt = force - k x - c v`, with the position seen."""

    k: Array
    c: Array
    states, inputs, outputs = ("x", "v"), ("force",), ("x",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1]])

    def output(self, t, x, u):
        return x[:1]


def fly(seed, *effects, samples=300):
    """One record of the spring with some effects, and the noise in it."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(samples)
    u = np.convolve(rng.normal(size=samples), np.ones(8) / 2.5, "same")[:, None]
    present = tuple(effect for effect in effects if effect is not None)
    truth = Augmented(Spring(1.5, 0.2), present) if present else Spring(1.5, 0.2)
    y = np.asarray(simulate(truth, t, u, jnp.zeros(len(truth.states))).y)
    noise = SIGMA * rng.normal(size=y.shape)
    return record(t, u, y + noise, inputs=("force",), outputs=("x",), name=f"record {seed}"), noise
