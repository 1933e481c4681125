"""Noise with outliers: gradient, SciPy, limits, coverage, refusals."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiled_problem import linearise, residuals
from reference_estimation import Lag, lag_rhs, rk4
from scipy.optimize import minimize
from scipy.stats import binom

from jaxid._foundation.checks import InputError
from jaxid.data import record
from jaxid.estimation import OutputError, estimate
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.problem import Problem
from jaxid.models import DiagonalNoise, HuberNoise, Parameters, StudentNoise, free

P, B, X0, SIGMA, ROWS, DRAWS = 1.0, 2.0, 0.5, 0.1, 120, 400
MODEL = Lag(p=0.8, b=1.5)
FREE = free(MODEL, "p", "b")
NOISES = [StudentNoise(4.0), HuberNoise()]


def simulated():
    t = 0.1 * np.arange(ROWS)
    u = np.sign(np.sin(0.7 * t)) + 0.5 * np.sign(np.sin(1.9 * t))
    return t, u, rk4(lag_rhs, t, u, np.array([X0]), np.array([P, B]))[:, 0]


def measured(rng, draws):
    """Measured outputs: one sample of twenty is an outlier of 20 standard deviations."""
    deviation = np.where(rng.random((draws, ROWS)) < 0.05, 20 * SIGMA, SIGMA)
    return simulated()[2] + deviation * rng.normal(size=(draws, ROWS))


def as_record(z, missing=()):
    t, u, _ = simulated()
    z = np.array(z)
    z[list(missing)] = np.nan
    return record(t, u[:, None], z[:, None], inputs=["u"], outputs=["x"])


class Started(Lag):
    """The lag from a known initial state."""

    def initial_state(self, record):
        return jnp.array([X0])


@pytest.mark.parametrize("noise", NOISES)
def test_gradient_is_that_of_the_cost(noise, rng):
    known = as_stack(as_record(measured(rng, 1)[0], missing=(3, 50)))
    problem = Problem.of(Started(p=0.8, b=1.5), FREE, known, OutputError(noise))
    at = jnp.array([0.9, 1.7])

    def cost(shared):
        return problem.cost(Parameters(shared, jnp.zeros((1, 0))))

    linearised = linearise(problem, Parameters(at, jnp.zeros((1, 0))))
    gradient, _ = linearised.information.gradient()
    np.testing.assert_allclose(gradient, jax.jit(jax.jacfwd(cost))(at), rtol=1e-8)


@pytest.mark.parametrize("noise", NOISES)
def test_estimate_equals_scipy(noise, rng):
    """SciPy minimises over parameters and scale together, with outputs by a NumPy Runge-Kutta."""
    z = measured(rng, 1)[0]
    t, u, _ = simulated()

    def rho(r):
        if isinstance(noise, StudentNoise):
            return 0.5 * (noise.dof + 1) * np.log1p(r**2 / noise.dof)
        k = noise.threshold
        return np.where(np.abs(r) < k, 0.5 * r**2, k * np.abs(r) - 0.5 * k**2)

    def cost(x):
        y = rk4(lag_rhs, t, u, np.array([X0]), x[:2])[:, 0]
        return np.sum(rho((z - y) / np.exp(x[2])) + x[2])

    expected = minimize(
        cost, [0.8, 1.5, -1.0], tol=1e-12, method="Nelder-Mead", options={"maxiter": 2000}
    )
    fit = estimate(Started(p=0.8, b=1.5), FREE, as_record(z), OutputError(noise))
    np.testing.assert_allclose(fit.values, expected.x[:2], rtol=1e-5)
    np.testing.assert_allclose(np.sqrt(fit.noise[0, 0]), np.exp(expected.x[2]), rtol=1e-4)
    np.testing.assert_allclose(fit.cost, expected.fun, atol=1e-6)


@pytest.mark.parametrize("noise", [StudentNoise(1e9), HuberNoise(1e3)])
def test_normal_noise_is_the_limit(noise, rng):
    known = as_stack(as_record(measured(rng, 1)[0]))
    at = Parameters(jnp.array([0.9, 1.7]), jnp.zeros((1, 0)))
    factors, scales = [], []
    for chosen in (noise, DiagonalNoise()):
        problem = Problem.of(Started(p=0.8, b=1.5), FREE, known, OutputError(chosen))
        information = linearise(problem, at).information
        factors.append(np.abs(information.factor))  # the signs of its rows are free
        scales.append(chosen.cholesky(residuals(problem, at), known.mask))
    np.testing.assert_allclose(*factors, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(*scales, rtol=1e-6)


def estimates(z, noise):
    """Estimates from many records in one call."""
    template, model = as_record(simulated()[2]), Started(p=0.8, b=1.5)

    def single(z):
        known = eqx.tree_at(lambda node: node.z, template, z[:, None])
        return estimate(model, FREE, known, OutputError(noise))

    return eqx.filter_jit(eqx.filter_vmap(single))(z)


@pytest.fixture(scope="module")
def draws():
    return jnp.asarray(measured(np.random.default_rng(1974), DRAWS))


@pytest.fixture(scope="module")
def normal_spread(draws):
    return np.std(np.asarray(estimates(draws, DiagonalNoise()).values), axis=0)


@pytest.mark.parametrize("noise", NOISES)
def test_intervals_cover_with_outliers(noise, draws, normal_spread):
    """The corrected intervals hold for noise of another density than the assumed one.

    Estimates by normal noise scatter at least twice as much.
    """
    fits = estimates(draws, noise)
    assert bool(jnp.all(fits.successful))
    ends = np.asarray(fits.interval(coloured=True))
    covered = np.sum((ends[..., 0] <= [P, B]) & (ends[..., 1] >= [P, B]), axis=0)
    low, high = binom.ppf([0.0005 / 2, 1 - 0.0005 / 2], DRAWS, 0.95)
    assert np.all((covered >= low) & (covered <= high)), covered / DRAWS
    assert np.all(normal_spread > 2.0 * np.std(np.asarray(fits.values), axis=0))


def test_values_out_of_range_are_refused():
    with pytest.raises(InputError, match=r"`dof` is 0\.5; give at least 1"):
        StudentNoise(0.5)
    with pytest.raises(InputError, match="`threshold` is 1; give more than 1"):
        HuberNoise(1.0)


@pytest.fixture
def rng(seed):
    return np.random.default_rng(seed)
