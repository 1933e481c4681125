"""Measures of an information matrix against their definitions with the inverse matrix."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.design import measures

WEIGHTS = np.array([1.0, 4.0, 0.25])
COMBINATION = np.array([1.0, -2.0, 0.5])


def log_det(matrix):
    return np.linalg.slogdet(matrix)[1]


def quadratic(x):
    return x[:, None] ** jnp.arange(3)[None]


DEFINITIONS = {
    "D": (measures.Determinant(), log_det),
    "A": (measures.Trace(WEIGHTS), lambda P: np.trace(np.diag(WEIGHTS) @ P)),
    "c": (measures.Combination(COMBINATION), lambda P: COMBINATION @ P @ COMBINATION),
    "E": (measures.SmallestEigenvalue(), lambda P: np.log(np.linalg.eigvalsh(P)[-1])),
    "Ds": (measures.SubsetDeterminant([0, 2]), lambda P: log_det(P[np.ix_([0, 2], [0, 2])])),
}


@pytest.fixture
def rows(seed):
    return np.random.default_rng(seed).normal(size=(12, 3))


@pytest.mark.parametrize("name", DEFINITIONS)
def test_cost_equals_definition_by_covariance(name, rows):
    measure, definition = DEFINITIONS[name]
    np.testing.assert_allclose(
        measure.cost(rows), definition(np.linalg.inv(rows.T @ rows)), rtol=1e-10
    )


@pytest.mark.parametrize("name", DEFINITIONS)
def test_gain_equals_derivative_by_added_information(name, rows):
    measure, _ = DEFINITIONS[name]
    extra = np.array([[0.3, -1.0, 2.0], [1.0, 0.5, 0.2]])

    def cost(amount):
        return measure.cost(np.concatenate([rows, np.sqrt(amount) * extra]))

    h = 1e-5
    slope = (-3 * cost(0.0) + 4 * cost(h) - cost(2 * h)) / (2 * h)
    np.testing.assert_allclose(measure.gain(rows, extra), -slope, rtol=1e-6)


@pytest.mark.parametrize("name", DEFINITIONS)
def test_derivative_by_rows_equals_finite_differences(name, rows):
    measure, _ = DEFINITIONS[name]
    direction = np.cos(np.arange(36.0)).reshape(12, 3)
    h = 1e-6
    difference = (measure.cost(rows + h * direction) - measure.cost(rows - h * direction)) / (2 * h)
    slope = np.sum(measure.gradient(rows) * direction)
    np.testing.assert_allclose(slope, difference, rtol=1e-6)


def test_traced_measures_equal_those_on_the_host(rows):
    @jax.jit
    def traced(rows):
        return {name: (m.cost(rows), m.gradient(rows)) for name, (m, _) in DEFINITIONS.items()}

    for name, (cost, gradient) in traced(jnp.asarray(rows)).items():
        measure, _ = DEFINITIONS[name]
        np.testing.assert_allclose(cost, measure.cost(rows), rtol=1e-12)
        np.testing.assert_allclose(gradient, measure.gradient(rows), rtol=1e-9, atol=1e-12)


def test_curve_width_equals_mean_variance_of_curve(rows):
    measure = measures.curve_width(quadratic, -1.0, 2.0)
    x = np.linspace(-1.0, 2.0, 30001)
    basis = np.asarray(quadratic(jnp.asarray(x)))
    variance = np.einsum("ij,jk,ik->i", basis, np.linalg.inv(rows.T @ rows), basis)
    np.testing.assert_allclose(measure.cost(rows), np.trapezoid(variance, x) / 3.0, rtol=1e-7)


def test_curve_width_weighs_by_density(rows):
    upper = measures.curve_width(quadratic, 0.0, 1.0)
    both = measures.curve_width(quadratic, -1.0, 1.0, density=lambda x: 1.0 * (x > 0), nodes=200)
    np.testing.assert_allclose(both.cost(rows), 0.5 * upper.cost(rows), rtol=1e-3)


def test_badly_scaled_information_keeps_its_measure(rows):
    """Singular values over 1e10 apart, which the squared matrix would lose."""
    scale = np.array([1.0, 1e5, 1e-5])
    plain, scaled = (measures.Combination([0.0, 0.0, c]) for c in (1.0, 1e-5))
    np.testing.assert_allclose(plain.cost(rows), scaled.cost(rows * scale[None]), rtol=1e-8)


def test_bad_arguments_are_refused():
    with pytest.raises(InputError, match="weights must not be negative"):
        measures.Trace([1.0, -1.0])
    with pytest.raises(InputError, match="combination are zero"):
        measures.Combination([0.0, 0.0])
    with pytest.raises(InputError, match="range from 2 to 1 is empty"):
        measures.curve_width(quadratic, 2.0, 1.0)
