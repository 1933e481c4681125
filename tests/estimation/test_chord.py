"""Steps with old sensitivities: where they end, and how large damped ones are.

Where residuals are large, Gauss-Newton is slow, and old sensitivities mislead. With known noise of
one size, `y = (a, a + C a^2)` and `z = (-1, 1)` the cost is least at `a = 0`, where both residuals
have size one, and a Gauss-Newton step leaves the share C of the error. With the sensitivities of a
point `a` kept, the steps end at `C a`.
"""

import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

from jaxid._foundation.types import Array
from jaxid.data import record
from jaxid.estimation import Damp, GaussNewton, OutputError, estimate
from jaxid.models import AbstractModel, FixedNoise, free

CURVATURE, DEVIATION = 0.9, 0.01
# Of two samples of two outputs with a slope of one.
STANDARD_ERROR = DEVIATION / np.sqrt(4.0)


class Bent(AbstractModel):
    """A static model of one parameter with two outputs, one of them curved."""

    a: Array
    states, inputs, outputs = (), ("u",), ("straight", "bent")

    def rhs(self, t, x, u):
        return x

    def output(self, t, x, u):
        return jnp.stack([self.a, self.a + CURVATURE * self.a**2])


def fitted(distance, solver):
    """Estimate from a distance of some standard errors."""
    z = np.array([[-1.0, 1.0], [-1.0, 1.0]])
    known = record(np.arange(2.0), np.zeros((2, 1)), z, inputs=["u"], outputs=["straight", "bent"])
    model = Bent(jnp.array(distance * STANDARD_ERROR))
    noise = OutputError(FixedNoise(jnp.full(2, DEVIATION**2)))
    return estimate(model, free(model, "a"), known, noise, solver=solver)


def assert_ended(found, solver):
    """A step of one tolerance leaves C / (1 - C) tolerances."""
    left = solver.tolerance * CURVATURE / (1.0 - CURVATURE)
    assert bool(found.successful)
    assert abs(float(found.values[0])) < 1.5 * left * STANDARD_ERROR


@pytest.mark.parametrize("chord", [True, False])
@pytest.mark.parametrize("distance", [0.5, 5.0, 50.0])
def test_the_end_is_within_the_error_that_a_step_leaves(distance, chord):
    solver = GaussNewton(tolerance=1e-2, chord=chord)
    assert_ended(fitted(distance, solver), solver)


def test_a_search_without_a_state_serves_damped_steps():
    solver = GaussNewton(Damp(), search=optx.LearningRate(1.0), tolerance=1e-2, chord=True)
    assert_ended(fitted(5.0, solver), solver)


class Rise(AbstractModel):
    """A static model: `y = gain (1 - exp(-rate u))`, along whose slow rise the product is known."""

    gain: Array
    rate: Array
    states, inputs, outputs = (), ("u",), ("y",)

    def rhs(self, t, x, u):
        return x

    def output(self, t, x, u):
        return jnp.stack([self.gain * (1.0 - jnp.exp(-self.rate * u[0]))])


def test_damped_steps_keep_their_size_where_sensitivities_are_renewed():
    """From size one again at each renewal they needed 98 steps in place of 23."""
    u = np.linspace(0.1, 3.0, 30)
    z = 5.0 * (1.0 - np.exp(-0.1 * u))
    known = record(np.arange(30.0), u[:, None], z[:, None], inputs=["u"], outputs=["y"])
    model, noise = Rise(jnp.array(1.0), jnp.array(1.0)), OutputError(FixedNoise(jnp.array([1e-6])))
    chosen = free(model, "gain", "rate", bounds={"rate": (1e-3, 10.0)})
    steps = []
    for chord in (False, True):
        solver = GaussNewton(Damp(), tolerance=1e-2, chord=chord)
        found = estimate(model, chosen, known, noise, solver=solver)
        assert bool(found.successful)
        np.testing.assert_allclose(found.values, [5.0, 0.1], rtol=1e-3)
        steps.append(int(found.iterations))
    assert steps[1] < 2 * steps[0]
