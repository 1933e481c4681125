"""The Gauss-Newton step with an estimated R is Newton's step of the concentrated cost."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import AbstractModel, GaussNewton, OutputError, estimate, free, record
from jaxid._foundation.types import Array
from jaxid.estimation.descent import profiled_step
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.problem import Problem
from jaxid.estimation.solver import minimise
from jaxid.models import DiagonalNoise, FixedNoise, FullNoise, Parameters
from jaxid.sensitivity.spectrum import spectrum


class TwoReadings(AbstractModel):
    """A constant state, read twice together with multiples of the input: linear in all unknowns."""

    a: Array
    b: Array
    states, inputs, outputs = ("x",), ("u",), ("y", "z")

    def rhs(self, t, x, u):
        return jnp.zeros(1)

    def output(self, t, x, u):
        return jnp.stack([x[0] + self.a * u[0], self.b * u[0] - 0.5 * x[0]])


def records(seed, disagreement):
    """Two records; the second reading contradicts the first by `disagreement`."""
    rng, t = np.random.default_rng(seed), 0.1 * np.arange(60)
    made = []
    for offset in (0.3, -0.2):
        u = rng.normal(size=60)
        y = np.stack([offset + 1.2 * u, 0.7 * u - 0.5 * offset + disagreement], axis=1)
        y = y + 0.1 * rng.normal(size=y.shape) @ np.array([[1.0, 0.4], [0.0, 0.8]])
        made.append(record(t, u[:, None], y, inputs=("u",), outputs=("y", "z")))
    return made


def start():
    return Parameters(jnp.array([1.1, 0.8]), jnp.zeros((2, 1)))


def problem_of(noise, disagreement, seed):
    model = TwoReadings(1.1, 0.8)
    chosen = free(model, "a", "b", per_record=("initial_state",))
    stack = as_stack(records(seed, disagreement))
    return Problem.of(model, chosen, stack, OutputError(noise))


def as_vector(parameters):
    return jnp.concatenate([parameters.shared, parameters.rows.reshape(-1)])


@eqx.filter_jit
def steps_near_minimum(problem):
    """Profiled step and Newton's step of the concentrated cost, at a point near the minimum."""
    least = minimise(problem, start(), GaussNewton())[0]
    at = Parameters(least.shared + 0.004, least.rows - 0.003)

    def cost(vector):
        return problem.cost(Parameters(vector[:2], vector[2:].reshape(2, 1)))

    vector = as_vector(at)
    newton = -jnp.linalg.solve(jax.hessian(cost)(vector), jax.grad(cost)(vector))
    information = problem.linearise(at).information
    svd = spectrum(information.triangle, information.rhs)
    return as_vector(profiled_step(information, svd, 1.0 / svd.singular_values)), newton


@pytest.mark.parametrize(
    "noise",
    [DiagonalNoise(), FullNoise(), FixedNoise([0.02, 0.01])],
    ids=lambda n: type(n).__name__,
)
def test_step_is_newtons_step_of_concentrated_cost(noise, seed):
    step, newton = steps_near_minimum(problem_of(noise, 0.05, seed))
    np.testing.assert_allclose(step, newton, rtol=1e-8, atol=1e-12)


class OneGain(AbstractModel):
    """Two readings of one multiple of the input."""

    a: Array
    states, inputs, outputs = (), ("u",), ("y", "z")

    def rhs(self, t, x, u):
        return x

    def output(self, t, x, u):
        return self.a * jnp.stack([u[0], u[0]])


def test_contradicting_channels_converge_quadratically(seed):
    """At the minimum the gradients of the two channels are opposite, and only their sum is zero.

    Without the curvature of R the iteration converges linearly: 43 steps for the seed 1974.
    """
    rng, t = np.random.default_rng(seed), 0.1 * np.arange(60)
    u = rng.normal(size=(60, 1))
    z = np.hstack([1.0 * u, 1.2 * u]) + 0.1 * rng.normal(size=(60, 2))
    readings = record(t, u, z, inputs=("u",), outputs=("y", "z"))
    model = OneGain(1.05)
    fit = estimate(model, free(model, "a"), readings, OutputError())
    assert bool(fit.successful), fit.status
    assert int(fit.iterations) <= 7
