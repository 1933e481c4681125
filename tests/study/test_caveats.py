"""Caveats of a study: products and ratios that are determined although their parameters are not."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxid
from jaxid._foundation.types import Array
from jaxid.study.caveats import known_combinations
from jaxid.study.wording import combination_words

SIGMA = 0.01
U = np.linspace(0.0, 0.3, 200)
TRUE = {"a": 0.5, "b": 2.0}


class Curve(jaxid.AbstractModel):
    """A static curve of two parameters that bends little: `y = a b^power u (1 + a u / 100)`."""

    a: Array
    b: Array
    power: float
    states, inputs, outputs = (), ("u",), ("y",)

    def rhs(self, t, x, u):
        return x

    def output(self, t, x, u):
        return self.a * self.b**self.power * u * (1.0 + 0.01 * self.a * u)


def fitted(power, size=1.0):
    """Estimate of both parameters from a record whose input is larger by a factor."""
    model = Curve(jnp.array(TRUE["a"]), jnp.array(TRUE["b"]), power)
    noise = SIGMA * np.random.default_rng(4).normal(size=U.size)
    clean = model.output(0.0, jnp.zeros(0), size * U)
    record = jaxid.record(
        np.arange(U.size) * 0.1,
        (size * U)[:, None],
        (clean + noise)[:, None],
        inputs=("u",),
        outputs=("y",),
    )
    return jaxid.estimate(model, jaxid.free(model, "a", "b"), record, jaxid.OutputError())


@pytest.mark.parametrize("power", [1.0, -1.0])
def test_only_a_combination_is_determined(power):
    estimate = fitted(power)
    (found,) = known_combinations(estimate, {"a"})
    assert (found.first, found.second, found.power) == ("a", "b", power)
    true = TRUE["a"] * TRUE["b"] ** power
    assert abs(found.value - true) < 4.0 * found.standard_error
    columns = np.column_stack([U, U**2])  # a slope, and a curvature that is as good as unknown
    of_slope = SIGMA * np.sqrt(np.linalg.inv(columns.T @ columns)[0, 0])
    np.testing.assert_allclose(found.standard_error, of_slope, rtol=0.2)
    words = combination_words(*found)
    assert ("product of a and b" if power > 0 else "ratio of a and b") in words


def test_parameters_that_are_determined_have_no_combination():
    assert known_combinations(fitted(1.0, size=1000.0), {"a"}) == []


def test_parameters_of_the_declared_model_alone_are_left_to_the_estimate():
    assert known_combinations(fitted(1.0), {"c"}) == []
