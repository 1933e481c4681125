"""Four estimation problems of simulated systems, three of them with parameters that the data cannot
tell apart.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxid import AbstractModel, Record, record, simulate
from jaxid._foundation.types import Array

STEP, SAMPLES = 0.05, 200  # s


class DynamicProblem(NamedTuple):
    """Estimate the free parameters of a model from a record.

    Attributes:
        model: the model at the standard start.
        free: names of its free parameters.
        record: simulated from other values, with white noise of the given size.
        noise: standard deviation of each output.
    """

    model: AbstractModel
    free: tuple[str, ...]
    record: Record
    noise: tuple[float, ...]


class ProductGain(AbstractModel):
    """A first-order lag whose gain is a product of two parameters.

    dx/dt = -p x + a b u
    """

    p: Array
    a: Array
    b: Array
    states, inputs, outputs = ("x",), ("u",), ("x",)

    def rhs(self, t, x, u):
        return -self.p * x + self.a * self.b * u

    def output(self, t, x, u):
        return x


class ShortPeriodWithDownwash(AbstractModel):
    """The short period with a derivative by the rate of w, which is a sum of the other terms.

    dw/dt = Zw w + V q,    dq/dt = Mw w + Mq q + Mwdot dw/dt + Md elevator
    """

    Zw: Array
    Mw: Array
    Mq: Array
    Mwdot: Array
    Md: Array
    states, inputs, outputs = ("w", "q"), ("elevator",), ("w", "q")

    def rhs(self, t, x, u):
        w_rate = self.Zw * x[0] + 50.0 * x[1]
        moment = self.Mw * x[0] + self.Mq * x[1] + self.Mwdot * w_rate
        return jnp.stack([w_rate, moment + self.Md * u[0]])

    def output(self, t, x, u):
        return x


class Pendulum(AbstractModel):
    """A driven pendulum at large angles, whose simulation leaves the record where it turns over.

    d2x/dt2 = -stiffness sin(x) - damping dx/dt + torque u
    """

    stiffness: Array
    damping: Array
    torque: Array
    states, inputs, outputs = ("x", "v"), ("u",), ("x",)

    def rhs(self, t, x, u):
        force = self.torque * u[0] - self.stiffness * jnp.sin(x[0]) - self.damping * x[1]
        return jnp.stack([x[1], force])

    def output(self, t, x, u):
        return x[:1]


class TwoLags(AbstractModel):
    """Two lags in series with two gains. The output is the same if the lags change places, and
    depends on the product of the gains only.

    dx/dt = (gain u - x) / first,    dy/dt = (scale x - y) / second
    """

    first: Array
    second: Array
    gain: Array
    scale: Array
    states, inputs, outputs = ("x", "y"), ("u",), ("y",)

    def rhs(self, t, x, u):
        return jnp.stack(
            [(self.gain * u[0] - x[0]) / self.first, (self.scale * x[0] - x[1]) / self.second]
        )

    def output(self, t, x, u):
        return x[1:]


def _problem(truth: AbstractModel, start: AbstractModel, free, size: float) -> DynamicProblem:
    """Return the problem of a truth, with noise of this share of each output's deviation."""
    t = STEP * np.arange(SAMPLES)
    u = np.sign(np.sin(1.1 * t) + 0.5 * np.sin(2.9 * t))[:, None]
    still = np.zeros(len(truth.states))
    y = np.asarray(simulate(truth, t, u, initial_state=still).y)
    noise = size * np.std(y, axis=0)
    z = y + noise * np.asarray(jax.random.normal(jax.random.key(1974), y.shape))
    flown = record(t, u, z, inputs=truth.inputs, outputs=truth.outputs)
    return DynamicProblem(start, free, flown, tuple(map(float, noise)))


def dynamic_problems() -> dict[str, DynamicProblem]:
    """Return the problems by name."""
    short_period = ("Zw", "Mw", "Mq", "Mwdot", "Md")
    return {
        "gain as a product": _problem(
            ProductGain(1.5, 2.0, 3.0), ProductGain(1.0, 1.0, 1.0), ("p", "a", "b"), 0.02
        ),
        "over-parameterised aircraft": _problem(
            ShortPeriodWithDownwash(-1.0, -0.1, -1.0, -0.01, -8.0),
            ShortPeriodWithDownwash(-1.5, -0.05, -0.5, -0.02, -5.0),
            short_period,
            0.02,
        ),
        "pendulum": _problem(
            Pendulum(4.0, 0.3, 1.5),
            Pendulum(3.0, 0.2, 1.0),
            ("stiffness", "damping", "torque"),
            0.02,
        ),
        "two lags": _problem(
            TwoLags(0.4, 1.0, 2.0, 1.5),
            TwoLags(0.5, 0.8, 1.0, 1.0),
            ("first", "second", "gain", "scale"),
            0.02,
        ),
    }
