"""Estimates from many starts: minima known in closed form, failures, refusals."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid._foundation.types import Array
from jaxid.batches import multi_start
from jaxid.data import record
from jaxid.estimation import OutputError
from jaxid.models import AbstractModel, FixedNoise, free

NOISE = OutputError(FixedNoise(jnp.array([0.01])))
TILT = 0.3


class DoubleWell(AbstractModel):
    """A static model whose cost, `50 sum (z - y)^2` with z = 0, has two minima in `a`."""

    a: Array
    b: Array
    states, inputs, outputs = (), ("u",), ("y",)

    def rhs(self, t, x, u):
        return jnp.zeros(0)

    def output(self, t, x, u):
        well = (self.a**2 - 1.0) * u[0] + TILT * (self.a - 1.0) * (1.0 - u[0])
        return jnp.stack([well + (self.b - 2.0) * u[0] * (1.0 - 2.0 * u[0])])

    def initial_state(self, record):
        return jnp.zeros(0)


@pytest.fixture(scope="module")
def known():
    u = np.array([0.0, 1.0, 0.5, 1.0, 0.0, 0.5])
    t = np.arange(6.0)
    return record(t, u[:, None], np.zeros((6, 1)), inputs=["u"], outputs=["y"])


def cost(a, b, u):
    well = (a**2 - 1.0) * u + TILT * (a - 1.0) * (1.0 - u)
    return 50.0 * np.sum((well + (b - 2.0) * u * (1.0 - 2.0 * u)) ** 2)


def test_both_minima_are_found_the_lowest_first(known):
    model = DoubleWell(jnp.array(-0.8), jnp.array(1.0))
    chosen = free(model, "a", "b", bounds={"a": (-2.0, 2.0)})
    result = multi_start(model, chosen, known, NOISE, starts=12, seed=3)
    assert len(result.minima) == 2
    lowest, other = result.minima
    np.testing.assert_allclose(lowest.values, [1.0, 2.0], atol=1e-6)
    np.testing.assert_allclose(result.estimate.values, [1.0, 2.0], atol=1e-6)
    assert lowest.starts + other.starts == 12
    assert other.values[0] < 0 < other.cost - lowest.cost
    # At the other minimum the cost is stationary too.
    u, (a, b), h = np.array([0.0, 1.0, 0.5, 1.0, 0.0, 0.5]), other.values, 1e-6
    slopes = (cost(a + h, b, u) - cost(a - h, b, u), cost(a, b + h, u) - cost(a, b - h, u))
    np.testing.assert_allclose(np.array(slopes) / (2 * h), 0.0, atol=1e-3)
    difference = cost(a, b, u) - cost(1.0, 2.0, u)
    np.testing.assert_allclose(other.cost - lowest.cost, difference, rtol=1e-6)
    assert "starts" in str(result)


def test_starts_without_end_are_counted(known):
    model = DoubleWell(jnp.array(1.1), jnp.array(1.0))
    chosen = free(model, "a", "b")
    starts = np.array([[1.1, 1.0], [1e200, 1.0]])  # its square overflows
    result = multi_start(model, chosen, known, NOISE, starts=starts)
    assert sum(result.failures.values()) == 1
    assert sum(minimum.starts for minimum in result.minima) == 1


def test_last_iteration_starts_at_best_end_in_parameters_of_records(known):
    """From the value of the model, -0.8, `a` takes eleven iterations; a test of the end takes one
    or two.
    """
    model = DoubleWell(jnp.array(-0.8), jnp.array(1.0))
    chosen = free(model, "b", per_record=("a",))
    result = multi_start(model, chosen, known, NOISE, starts=np.int64(2))
    np.testing.assert_allclose(result.estimate.cost, result.minima[0].cost, rtol=1e-9)
    assert result.estimate.iterations <= 2
    np.testing.assert_array_equal(result.estimate.start, result.minima[0].values)


def test_no_minimum_is_refused(known):
    model = DoubleWell(jnp.array(1.1), jnp.array(1.0))
    chosen = free(model, "a", "b")
    with pytest.raises(InputError, match="`starts` is 0"):
        multi_start(model, chosen, known, NOISE, starts=0)
