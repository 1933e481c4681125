"""A first-order lag under random forces, and its records, exact in NumPy."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.linalg import expm

from jaxid._foundation.types import Array
from jaxid.data import record
from jaxid.models import AbstractModel

STEP, P, B = 0.1, 1.0, 2.0
SENSOR, FORCE, TIME = 0.05, 0.6, 0.8


class GustyLag(AbstractModel):
    """`dx/dt = -p x + b u + force + push`, measured with a slow error: `y = x + drift`."""

    p: Array
    b: Array
    disturbances: tuple[str, ...] = eqx.field(static=True, default=())
    states, outputs = ("x",), ("y",)

    @property
    def inputs(self):
        return ("u", *self.disturbances)

    def rhs(self, t, x, u):
        forces = u[1:3] if self.disturbances else jnp.zeros(2)
        return -self.p * x + self.b * u[:1] + jnp.sum(forces)

    def output(self, t, x, u):
        return x + u[3:] if self.disturbances else x

    def with_disturbance_inputs(self):
        return GustyLag(self.p, self.b, disturbances=("force", "push", "drift"))


def flights(draws, samples, seed):
    """Times, inputs and measurements of many records under a first-order force."""
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(samples)
    u = np.sign(np.sin(0.7 * t)) + 0.5 * np.sign(np.sin(1.9 * t))
    A = np.array([[-P, 1.0, B, 0.0], [0.0, -1.0 / TIME, 0.0, 0.0], [0, 0, 0, 1.0], [0, 0, 0, 0]])
    power = np.diag([0.0, 2.0 * FORCE**2 / TIME, 0.0, 0.0])
    block = expm(np.block([[-A, power], [np.zeros((4, 4)), A.T]]) * STEP)
    Phi = block[4:, 4:].T
    values, vectors = np.linalg.eigh((Phi @ block[:4, 4:])[:2, :2])
    factor = vectors * np.sqrt(np.maximum(values, 0.0))
    x = np.stack([np.zeros(draws), FORCE * rng.normal(size=draws)], 1)
    states, slopes = [], np.append(np.diff(u) / STEP, 0.0)
    for i in range(samples):
        states.append(x)
        driven = Phi[:2, 2] * u[i] + Phi[:2, 3] * slopes[i]
        x = x @ Phi[:2, :2].T + driven + rng.normal(size=(draws, 2)) @ factor.T
    states = np.stack(states, 1)
    z = states[..., :1] + SENSOR * rng.normal(size=(draws, samples, 1))
    return t, u[:, None], z, states


def as_record(t, u, z):
    return record(t, u, z, inputs=("u",), outputs=("y",))
