"""A spring with a measured position and speed, on which the search over hypotheses is tried.

All problems share shapes and library, so that they share their compiled programs.
"""

import jax.numpy as jnp
import numpy as np

from jaxid import AbstractModel, OutputError, free, record, simulate
from jaxid._foundation.types import Array
from jaxid.effects import (
    Augmented,
    InputDelay,
    InputLag,
    SensorBias,
    SensorDelay,
    SensorScale,
    Term,
)
from jaxid.loop import LoopProblem

STEP, SAMPLES = 0.1, 200
NOISE = np.array([0.02, 0.03])  # standard deviations [m, m/s]
LIBRARY = (
    *(Term("v", product) for product in ("x^2", "x^3", "v^3")),
    *(SensorBias("v"), SensorDelay("x"), SensorDelay("v"), SensorScale("v")),
    *(InputDelay("force"), InputLag("force")),
)


class Spring(AbstractModel):
    """`dv/dt = force - k x - c v`; position and speed are measured."""

    k: Array
    c: Array
    states, inputs, outputs = ("x", "v"), ("force",), ("x", "v")

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1]])

    def output(self, t, x, u):
        return x


TRUTH = Spring(jnp.array(1.5), jnp.array(0.2))


def fly(seed, *effects, truth=TRUTH, size=1.0, memory=0.0, gust=0.0, gust_time=1.0):
    """Return one record of the spring with some effects.

    Args:
        seed: of the force and the noise.
        effects: effects that the truth has as well.
        truth: the model without them.
        size: factor of the force.
        memory: autocorrelation of the sensor noise from sample to sample.
        gust, gust_time: standard deviation and correlation time [s] of a force that no signal has.
    """
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(SAMPLES)
    u = size * np.convolve(rng.normal(size=SAMPLES), np.ones(8) / 2.5, "same")
    model = Augmented(truth, effects) if effects else truth
    push = gust * correlated(rng, (SAMPLES, 1), np.exp(-STEP / gust_time))[:, 0]
    y = np.asarray(simulate(model, t, (u + push)[:, None], jnp.zeros(len(model.states))).y)
    z = y + NOISE * correlated(rng, y.shape, memory)
    return record(t, u[:, None], z, inputs=("force",), outputs=("x", "v"), name=f"record {seed}")


def correlated(rng, shape, memory):
    """Return noise of unit variance with a memory, along the first axis."""
    white = rng.normal(size=shape)
    for k in range(1, shape[0]):
        white[k] = memory * white[k - 1] + np.sqrt(1.0 - memory**2) * white[k]
    return white


def problem(seed, *effects, library=LIBRARY, likelihood=None, **setting):
    """Return a problem whose declared model lacks some effects, of two records and a check."""
    flown = [fly(10 * seed + k, *effects, **setting) for k in range(3)]
    model = Spring(jnp.array(1.2), jnp.array(0.15))
    chosen = free(model, "k", "c", per_record=("initial_state",))
    likelihood = likelihood or OutputError()
    return LoopProblem.of(model, library, chosen, likelihood, flown[:2], flown[2:], window=20)
