"""Convergence where residuals are large: Gauss-Newton is slow, and old sensitivities mislead.

With known noise of one size, `y = (a, a + C a^2)` and `z = (-1, 1)` the cost is least at `a = 0`,
where both residuals have size one, and a Gauss-Newton step leaves the share C of the error. With
the sensitivities of a point `a` kept, the steps end at `C a`.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.types import Array
from jaxid.data import record
from jaxid.estimation import GaussNewton, OutputError, estimate
from jaxid.models import AbstractModel, FixedNoise, free

CURVATURE, DEVIATION = 0.9, 0.01
# Of two samples of two outputs with a slope of one.
STANDARD_ERROR = DEVIATION / np.sqrt(4.0)


class Bent(AbstractModel):
    """A static model of one parameter with two outputs, one of them curved."""

    a: Array
    states, inputs, outputs = (), ("u",), ("straight", "bent")

    def rhs(self, t, x, u):
        return jnp.zeros(0)

    def output(self, t, x, u):
        return jnp.stack([self.a, self.a + CURVATURE * self.a**2])

    def initial_state(self, record):
        return jnp.zeros(0)


@pytest.mark.parametrize("chord", [True, False])
@pytest.mark.parametrize("distance", [0.5, 5.0, 50.0])
def test_the_end_is_within_the_error_that_a_step_leaves(distance, chord):
    z = np.array([[-1.0, 1.0], [-1.0, 1.0]])
    known = record(np.arange(2.0), np.zeros((2, 1)), z, inputs=["u"], outputs=["straight", "bent"])
    model = Bent(jnp.array(distance * STANDARD_ERROR))
    noise = OutputError(FixedNoise(jnp.full(2, DEVIATION**2)))
    solver = GaussNewton(tolerance=1e-2, chord=chord)
    found = estimate(model, free(model, "a"), known, noise, solver=solver)
    assert bool(found.successful)
    # A step of one tolerance leaves C / (1 - C) tolerances.
    left = solver.tolerance * CURVATURE / (1.0 - CURVATURE)
    assert abs(float(found.values[0])) < 1.5 * left * STANDARD_ERROR
