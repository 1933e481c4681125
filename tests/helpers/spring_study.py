"""A small study for the report's tests: a spring that is stiffer than declared when it is stretched
far.
"""

import functools

import jax.numpy as jnp
import numpy as np

from jaxid._foundation.types import Array
from jaxid.data import record
from jaxid.effects.augmented import Augmented
from jaxid.effects.equation import Term
from jaxid.effects.sensor import SensorBias
from jaxid.estimation.likelihoods import OutputError
from jaxid.models import AbstractModel
from jaxid.models.free import free
from jaxid.simulation.simulate import simulate
from jaxid.study import close_loop

NOISE = {"x": 0.02, "tilt": 0.006}  # standard deviations [m, rad]
HOSTILE = '<b>slow</b> & "../up"'  # a name of a test set that must do no harm
STEP, SAMPLES = 0.1, 200


class Spring(AbstractModel):
    """A mass on a spring that tilts as it moves: `dv/dt = u - k x - c v`."""

    k: Array
    c: Array
    states, inputs, outputs = ("x", "v"), ("force",), ("x", "tilt")

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1]])

    def output(self, t, x, u):
        return jnp.stack([x[0], 0.3 * x[0]])

    def units(self):
        return {"k": "1/s^2", "c": "1/s"}


@functools.cache
def make_study(seed=1974):
    """A study of six records that finds the planted cubic term."""
    truth = Augmented(Spring(jnp.array(1.5), jnp.array(0.2)), (Term("v", "x^3", jnp.array(-0.6)),))
    rng, units = np.random.default_rng(seed), {"force": "N", "x": "m", "tilt": "rad"}
    t = STEP * np.arange(SAMPLES)

    def fly(name):
        u = np.convolve(rng.normal(size=SAMPLES), np.ones(8) / 2.5, "same")[:, None]
        blank = record(
            t, u, np.zeros((SAMPLES, 2)), inputs=("force",), outputs=("x", "tilt"), units=units
        )
        y = np.asarray(simulate(truth, blank.t, blank.u, jnp.zeros(2)).y)
        z = y + rng.normal(size=y.shape) * np.array(list(NOISE.values()))
        z[:3, 1] = np.nan
        return record(t, u, z, inputs=("force",), outputs=("x", "tilt"), units=units, name=name)

    train, check = (fly("a"), fly("b")), (fly("c"),)
    test = {"quick": (fly("d"), fly("e")), HOSTILE: fly("f <script>")}
    model = Spring(jnp.array(1.0), jnp.array(0.1))
    effects = (Term("v", "x^3"), Term("v", "x^2"), SensorBias("x"))
    return close_loop(
        model,
        free(model, "k", "c"),
        OutputError(),
        train=train,
        check=check,
        test=test,
        effects=effects,
        window=20,
    )
