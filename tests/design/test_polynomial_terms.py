"""Terms of a polynomial coefficient against known polynomials, regressions and experiments."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import AbstractModel, free
from jaxid._foundation.checks import InputError
from jaxid.design import (
    equal_time,
    equation_error_information,
    half_ranges,
    polynomial_terms,
    sinusoid,
    visited,
)

# Cm(alpha), alpha in rad about 0.24: of the magnitude of a fighter near the stall (our choice).
CUBIC = np.array([0.02, -0.6, -1.5, 9.0])
DEVIATION = 0.01


def test_equal_time_gives_the_legendre_polynomials():
    terms = polynomial_terms(equal_time(-1.0, 1.0, 100), np.ones(4), 1.0)
    expected = [[1, 0, 0, 0], [0, 1, 0, 0], [-1 / 3, 0, 1, 0], [0, -3 / 5, 0, 1]]  # Eq. C.65
    np.testing.assert_allclose(terms.polynomials, expected, atol=1e-14)
    # int_-1^1 P_i^2 dx / 2 times 100 samples
    np.testing.assert_allclose(
        terms.standard_errors**-2, 100.0 * np.array([1, 1 / 3, 4 / 45, 4 / 175]), rtol=1e-12
    )


def test_a_sinusoid_gives_the_chebyshev_polynomials():
    terms = polynomial_terms(sinusoid(-1.0, 1.0, 100), np.ones(4), 1.0)
    expected = [[1, 0, 0, 0], [0, 1, 0, 0], [-1 / 2, 0, 1, 0], [0, -3 / 4, 0, 1]]
    np.testing.assert_allclose(terms.polynomials, expected, atol=1e-14)
    phase = 2.0 * np.pi * (np.arange(100) + 0.5) / 100
    same = polynomial_terms(visited(np.cos(phase)), np.ones(4), 1.0)
    np.testing.assert_allclose(same.standard_errors, terms.standard_errors, rtol=1e-2)


def test_terms_and_curve_equal_ordinary_least_squares():
    alpha = 0.24 + 0.1 * np.random.default_rng(3).standard_normal(80)
    terms = polynomial_terms(visited(alpha), CUBIC, DEVIATION)
    x = (2.0 * alpha - alpha.min() - alpha.max()) / np.ptp(alpha)
    P = np.vander(x, 4, increasing=True) @ terms.polynomials.T
    np.testing.assert_allclose(P.T @ P, np.diag(np.sum(P**2, axis=0)), atol=1e-12)
    np.testing.assert_allclose(P @ terms.values, np.polyval(CUBIC[::-1], alpha), rtol=1e-11)
    regressors = np.vander(alpha, 4, increasing=True)
    covariance = DEVIATION**2 * np.linalg.inv(regressors.T @ regressors)
    at = np.array([0.1, 0.24, 0.4])
    rows = np.vander(at, 4, increasing=True)
    expected = np.sqrt(np.einsum("ij,jk,ik->i", rows, covariance, rows))
    np.testing.assert_allclose(terms.curve_error(at), expected, rtol=1e-7)
    # Of the highest term alone: the error of its coefficient by the power of alpha.
    highest = terms.standard_errors[-1] / terms.visited.half_range**3
    np.testing.assert_allclose(highest, np.sqrt(covariance[-1, -1]), rtol=1e-7)


class Static(AbstractModel):
    """A rate that is a polynomial in the state."""

    c0: jnp.ndarray
    c1: jnp.ndarray
    c2: jnp.ndarray
    states, inputs, outputs = ("x",), ("u",), ("x",)

    def rhs(self, t, x, u):
        return self.c0 + self.c1 * x + self.c2 * x**2 + u


def test_terms_equal_the_equation_error_of_a_simulated_model():
    c = np.array([0.1, -0.6, 0.4])
    model = Static(*map(jnp.array, c))
    t = np.arange(100) * 0.1
    x = 0.3 + 0.2 * np.sin(t)
    information = equation_error_information(
        model, free(model, "c0", "c1", "c2"), t, x[:, None], np.zeros((100, 1)), {"x": 0.05}
    )
    terms = polynomial_terms(visited(x), c, 0.05)
    highest = terms.standard_errors[2] / terms.visited.half_range**2
    np.testing.assert_allclose(information.standard_errors[2], highest, rtol=1e-8)
    at_zero = terms.curve_error(np.zeros(1))
    np.testing.assert_allclose(information.standard_errors[0], at_zero[0], rtol=1e-8)


@pytest.mark.parametrize("distribution", [equal_time, sinusoid])
def test_the_highest_term_needs_the_amplitude_of_the_closed_form(distribution):
    experiment = distribution(0.14, 0.34, 200)
    result = half_ranges(experiment, CUBIC, DEVIATION, level=3.0)
    norm = {equal_time: 4 / 175, sinusoid: 1 / 32}[distribution]  # mean square of P_3
    closed = (3.0 * DEVIATION / (9.0 * np.sqrt(200 * norm))) ** (1 / 3)
    np.testing.assert_allclose(result[3], closed, rtol=1e-10)


def test_each_term_reaches_the_level_at_its_amplitude_and_at_no_smaller_one():
    experiment = equal_time(0.14, 0.34, 200)
    result = half_ranges(experiment, CUBIC, DEVIATION)
    assert result[0] == 0.0
    for degree in (1, 2, 3):
        t = [
            polynomial_terms(experiment.scaled(h), CUBIC, DEVIATION).t_ratios[degree]
            for h in np.linspace(1e-3, 1.0, 50) * result[degree]
        ]
        np.testing.assert_allclose(abs(t[-1]), 3.0, rtol=1e-9)
        assert np.all(np.abs(t[:-1]) < 3.0)


def test_a_term_that_is_zero_needs_an_infinite_amplitude():
    result = half_ranges(equal_time(-1.0, 1.0, 100), [0.0, 1.0, 0.0], 0.1)
    assert np.all(np.isinf(result[[0, 2]]))
    np.testing.assert_allclose(result[1], 3.0 * 0.1 / np.sqrt(100 / 3), rtol=1e-12)


def test_flown_experiments_scatter_as_predicted():
    half = half_ranges(sinusoid(0.14, 0.34, 200), CUBIC, DEVIATION)[3]
    alpha = 0.24 + half * np.sin(2.0 * np.pi * np.arange(200) / 50.0)
    terms = polynomial_terms(visited(alpha), CUBIC, DEVIATION)
    noise = DEVIATION * np.random.default_rng(0).standard_normal((4000, 200))
    y = np.polyval(CUBIC[::-1], alpha) + noise
    x = (alpha - 0.24) / terms.visited.half_range
    P = np.vander(x, 4, increasing=True) @ terms.polynomials.T
    estimates = np.linalg.lstsq(P, y.T)[0]
    t = estimates / terms.standard_errors[:, None]
    np.testing.assert_allclose(np.mean(t, axis=1), terms.t_ratios, atol=4.0 / np.sqrt(4000))
    np.testing.assert_allclose(np.std(t, axis=1), 1.0, atol=4.0 / np.sqrt(8000))
    assert abs(terms.t_ratios[3] - 3.0) < 0.05


def test_order_is_the_highest_shown_degree():
    small = polynomial_terms(equal_time(0.22, 0.26, 200), CUBIC, DEVIATION)
    large = polynomial_terms(equal_time(0.04, 0.44, 200), CUBIC, DEVIATION)
    assert (small.order(), large.order()) == (1, 3)
    assert len(str(large).splitlines()) == 6


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: visited(np.ones(10)), "positive width"),
        (lambda: visited(np.array([0.0, np.nan])), "without NaN"),
        (lambda: equal_time(0.0, 1.0, 0), "at least one sample"),
        (lambda: polynomial_terms(equal_time(0.0, 1.0, 9), [1.0], 0.0), "positive one"),
        (lambda: polynomial_terms(equal_time(0.0, 1.0, 9), [np.nan], 1.0), "finite numbers"),
        (
            lambda: polynomial_terms(visited(np.array([0.0, 1.0, 0.0])), np.ones(3), 1.0),
            "2 different values",
        ),
        (lambda: half_ranges(equal_time(0.0, 1.0, 9), [1.0], 1.0, level=0.0), "level of t"),
    ],
)
def test_refusals(wrong, message):
    with pytest.raises(InputError, match=message):
        wrong()
