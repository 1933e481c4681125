"""Experiment points against textbook designs and Table 5.2 of the report."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.design.measures import Determinant, Trace, curve_width
from jaxid.design.polynomials.experiment_points import at_most, candidates, optimal_points

ALPHA = np.linspace(0.0, 30.0, 3001)  # deg
# The stability augmentation, on beyond 20 deg, makes standard deviations three times larger.
DEVIATION = np.where(ALPHA > 20.0 + 1e-9, 3.0, 1.0)


def powers(count):
    """Return the regressors of a polynomial with this number of coefficients."""
    return lambda x: x[:, None] ** jnp.arange(count)[None]


def quartic(alpha):
    return powers(5)(alpha / 30.0)


WIDTH = curve_width(quartic, 0.0, 30.0)


@pytest.fixture(scope="module")
def schedule():
    return candidates(ALPHA, quartic, deviation=DEVIATION)


@pytest.fixture(scope="module")
def optimum(schedule):
    return optimal_points(schedule, WIDTH, total=100.0)


@pytest.fixture(scope="module")
def limited(schedule):
    return at_most(schedule, WIDTH, 5)


def test_flight_test_schedule_equals_independent_computation(optimum):
    design = optimum
    np.testing.assert_allclose(design.points, [0, 4.2, 12.6, 20, 27.8, 30], atol=0.05)
    assert 1.0 - 1e-9 <= design.certificate < 1.001
    np.testing.assert_allclose(jnp.sum(design.times), 100.0, rtol=1e-12)


def test_five_points_are_those_of_the_report(schedule, limited):
    design = limited
    np.testing.assert_allclose(design.points, [0, 4.5, 13, 20, 30], atol=1.5)
    report = np.searchsorted(ALPHA, [0, 4.5, 13, 20, 30])
    rows = np.asarray(schedule.rows)[report, 0]
    shares = np.array([12.5, 36.1, 28.2, 15.9, 7.3]) / 100.0
    assert design.value < WIDTH.cost(np.sqrt(shares)[:, None] * rows)


def test_five_points_cost_more_than_the_optimum(optimum, limited):
    assert optimum.value < limited.value < 1.01 * optimum.value
    assert limited.certificate > 1.01


@pytest.mark.parametrize("degree", range(1, 7))
def test_polynomial_d_optimum_has_legendre_points(degree):
    """The ends, and the roots of the derivative of the Legendre polynomial, with equal shares
    (Guest, Annals of Mathematical Statistics 29, 1958).
    """
    grid = candidates(np.linspace(-1, 1, 2001), powers(degree + 1))
    design = optimal_points(grid, Determinant())
    inner = np.polynomial.legendre.Legendre.basis(degree).deriv().roots()
    np.testing.assert_allclose(design.points, [-1, *np.sort(inner.real), 1], atol=3e-3)
    np.testing.assert_allclose(design.shares, 1 / (degree + 1), atol=2e-3)
    assert design.certificate < 1.001


def test_line_a_optimum_has_shares_of_closed_form():
    """y = a + b x on [0, 1], variances of both: shares sqrt(2) to 1 at the ends."""
    grid = candidates(np.linspace(0, 1, 101), powers(2))
    design = optimal_points(grid, Trace([1.0, 1.0]))
    np.testing.assert_allclose(design.points, [0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(design.shares, np.array([2**0.5, 1]) / (2**0.5 + 1), atol=1e-5)


def test_infeasible_region_is_left_out():
    x = np.linspace(-1, 1, 2001)
    grid = candidates(x, powers(3), feasible=np.abs(x) > 0.2)
    design = optimal_points(grid, Determinant())
    assert np.all(np.abs(np.asarray(design.points)) > 0.2)
    assert design.certificate < 1.001


def test_cost_acts_as_a_variance_and_divides_the_time():
    x = np.linspace(0, 1, 101)
    cost = np.where(x > 0.5, 4.0, 1.0)

    by_cost = optimal_points(candidates(x, powers(2), cost=cost), Trace([1.0, 1.0]), total=10.0)
    by_deviation = optimal_points(candidates(x, powers(2), deviation=cost**0.5), Trace([1.0, 1.0]))
    np.testing.assert_allclose(by_cost.points, by_deviation.points)
    np.testing.assert_allclose(by_cost.shares, by_deviation.shares)
    spent = by_cost.times * np.where(np.asarray(by_cost.points) > 0.5, 4.0, 1.0)
    np.testing.assert_allclose(jnp.sum(spent), 10.0)


def test_impossible_experiments_are_refused():
    with pytest.raises(InputError, match="No candidate point is feasible"):
        candidates(ALPHA, quartic, feasible=ALPHA > 40)
    with pytest.raises(InputError, match="do not determine all parameters"):
        optimal_points(candidates(np.array([0.0, 1.0]), quartic), Determinant())
    with pytest.raises(InputError, match="4 points cannot determine 5 coefficients"):
        at_most(candidates(ALPHA, quartic), Determinant(), 4)
