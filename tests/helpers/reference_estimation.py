"""An independent estimator in NumPy and SciPy, and the systems that the ladder tests share.

Of jaxid there is nothing in it but the model classes and records that the tests hand to jaxid.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy import optimize

from jaxid._foundation.types import Array
from jaxid.data import record
from jaxid.models import AbstractModel


class Pendulum(AbstractModel):
    """A damped pendulum under a torque: angle and rate are measured."""

    stiffness: Array
    damping: Array
    torque: Array
    states, inputs, outputs = ("angle", "rate"), ("moment",), ("angle", "rate")

    def rhs(self, t, x, u):
        return jnp.stack(
            [x[1], -self.stiffness * jnp.sin(x[0]) - self.damping * x[1] + self.torque * u[0]]
        )

    def output(self, t, x, u):
        return x


class Lag(AbstractModel):
    """A first-order lag: `dx/dt = -p x + b u`, `y = x`."""

    p: Array
    b: Array
    states, inputs, outputs = ("x",), ("u",), ("x",)

    def rhs(self, t, x, u):
        return -self.p * x + self.b * u

    def output(self, t, x, u):
        return x


def pendulum_rhs(x, u, theta):
    stiffness, damping, torque = theta
    return np.array([x[1], -stiffness * np.sin(x[0]) - damping * x[1] + torque * u])


def lag_rhs(x, u, theta):
    return np.array([-theta[0] * x[0] + theta[1] * u])


def rk4(rhs, t, u, x0, theta):
    """The classical Runge-Kutta method, one step a sample, straight lines between the input's
    samples; also complex.
    """
    x = np.zeros((len(t), *np.shape(x0)), np.result_type(x0, theta, float))
    x[0] = x0
    for i, h in enumerate(np.diff(t)):
        middle = (u[i] + u[i + 1]) / 2
        k1 = rhs(x[i], u[i], theta)
        k2 = rhs(x[i] + h / 2 * k1, middle, theta)
        k3 = rhs(x[i] + h / 2 * k2, middle, theta)
        k4 = rhs(x[i] + h * k3, u[i + 1], theta)
        x[i + 1] = x[i] + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def complex_step(function, theta):
    """Value and derivative without differences: `Im f(theta + i h) / h` (Squire & Trapp, SIAM
    Review 40(1), 1998).

    The function is evaluated for all parameters at once, each step a column of its argument.
    """
    step = 1e-30
    value = function(theta[:, None] + 1j * step * np.eye(len(theta)))
    return value.real[..., 0], value.imag / step


class Reference(NamedTuple):
    theta: np.ndarray
    errors: np.ndarray
    R: np.ndarray
    cost: float


def estimate_by_scipy(predict, z, start, covariance):
    """Maximum likelihood with R concentrated out, by SciPy.

    Args:
        predict: from columns of theta to the outputs of all records, one below the other,
            (sample, output, column).
        z: measured, NaN where missing.
        start: of theta.
        covariance: from residuals (sample, output), zero where missing, and valid samples to R.
    """
    valid = ~np.isnan(z)

    def parts(theta):
        y, S = complex_step(predict, theta)
        v = np.where(valid, z - y, 0.0)
        R = covariance(v, valid)
        return v, np.where(valid[..., None], S, 0.0), R, np.linalg.inv(R)

    def gradient(theta):
        v, S, _, W = parts(theta)
        return -np.einsum("ijp,jk,ik->p", S, W, v)

    def fisher(theta):
        _, S, _, W = parts(theta)
        return np.einsum("ijp,jk,ikq->pq", S, W, S)

    def cost(theta):
        v, _, R, W = parts(theta)
        # half of it, channel by channel
        log_det = np.sum(valid @ np.log(np.diagonal(np.linalg.cholesky(R))))
        return 0.5 * np.einsum("ij,jk,ik", v, W, v) + log_det

    near = optimize.minimize(cost, start, jac=gradient, method="BFGS", options={"gtol": 1e-3}).x
    root = optimize.root(gradient, near, jac=fisher, method="hybr", options={"xtol": 1e-14})
    assert np.max(np.abs(root.fun) * np.sqrt(np.diagonal(np.linalg.inv(fisher(root.x))))) < 1e-7
    return Reference(
        root.x,
        np.sqrt(np.diagonal(np.linalg.inv(fisher(root.x)))),
        parts(root.x)[2],
        cost(root.x),
    )


def pendulum_records(rng, gaps, correlation=0.6):
    """Two records of unequal length, with gaps in single channels if `gaps` is True."""
    made = []
    for n, x0 in ((160, (0.4, 0.0)), (110, (-0.2, 1.0))):
        t = 0.05 * np.arange(n)
        u = 2.0 * np.sin(0.9 * t + rng.uniform()) + (t > 2.0) - (t > 3.5)
        L = np.linalg.cholesky([[1.0, correlation], [correlation, 1.0]]) * np.array(
            [[0.02], [0.06]]
        )
        z = (
            rk4(pendulum_rhs, t, u, np.array(x0), np.array([4.0, 0.3, 1.5]))
            + rng.normal(size=(n, 2)) @ L.T
        )
        if gaps:
            z[20:35, 0] = np.nan
            z[rng.uniform(size=n) < 0.1, 1] = np.nan
        made.append((t, u, z))
    return made


def as_records(made, model):
    names = {"inputs": model.inputs, "outputs": model.outputs}
    return [record(*signals, name=f"r{i}", **names) for i, signals in enumerate(made)]
