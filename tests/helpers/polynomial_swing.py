"""A pendulum identified as a polynomial, with pseudo-measurements."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxid
from jaxid import FixedNoise, OutputError, identify
from jaxid.models import AbstractModel, Polynomial
from jaxid.models.pseudo_measurements import PseudoMeasurements
from jaxid.study import IdentifyOptions

SIGMA = {"x": 0.002, "v": 0.005, "vdot": 0.02}
TERMS = ("x", "v", "force")


class Swing(AbstractModel):
    """x' = v, v' = stiffness(x, v, force)."""

    stiffness: Polynomial
    scale: jax.Array  # of the accelerometer
    gain: jax.Array
    states, inputs, outputs = ("x", "v"), ("force",), ("x", "v")

    def rhs(self, t, x, u):
        return jnp.stack([x[1], self.stiffness({"x": x[0], "v": x[1], "force": u[0]})])

    def output(self, t, x, u):
        return x

    def signals(self, t, x, u):
        known = {"x": x[0], "v": x[1], "force": u[0]}
        return known | {"stiffness": self.stiffness(known)}

    def pseudo_measurements(self, record):
        z = {name: record.channel(name) for name in (*record.inputs, *record.outputs)}
        signals = {name: z[name] for name in TERMS}
        valid = jnp.all(record.mask, axis=-1)
        responses = {"stiffness": self.gain * z["vdot"] / self.scale}
        return PseudoMeasurements(record.t, responses, signals, valid, (("stiffness", TERMS),))

    def without(self, responses):
        return self


def swing(terms):
    return Swing(Polynomial(terms), jnp.ones(()), jnp.ones(()))


def truth(x, v, force):
    return force - 0.4 * v - 1.5 * np.sin(1.5 * x)


class Pendulum(AbstractModel):
    """The true motion."""

    states, inputs, outputs = ("x", "v"), ("force",), ("x", "v")

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - 0.4 * x[1] - 1.5 * jnp.sin(1.5 * x[0])])

    def output(self, t, x, u):
        return x


def flown(seed, rows=400):
    """A record and the true response at its samples."""
    rng = np.random.default_rng(seed)
    t = 0.05 * np.arange(rows)
    force = np.repeat(1.2 * rng.normal(size=(rows // 20, 1)), 20, axis=0)
    x = np.asarray(jaxid.simulate(Pendulum(), t, force, np.array([0.1, 0.0])).x)
    true = truth(x[:, 0], x[:, 1], force[:, 0])
    z = np.column_stack([x, true]) + rng.normal(size=(rows, 3)) * np.array([*SIGMA.values()])
    return jaxid.record(t, force, z, inputs=("force",), outputs=tuple(SIGMA)), true


def identified(record):
    options = IdentifyOptions(terms={"stiffness": TERMS}, keep=("stiffness",), share=0.0)
    likelihood = OutputError(FixedNoise([SIGMA["x"] ** 2, SIGMA["v"] ** 2]))
    return identify(swing({}), record, options=options, likelihood=likelihood)
