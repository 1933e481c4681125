"""Autoregressive noise: against the dense Gaussian, coverage, order, refusals."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from reference_estimation import Lag, lag_rhs, rk4
from scipy.linalg import cho_factor, cho_solve, toeplitz
from scipy.optimize import minimize
from scipy.signal import lfilter
from scipy.stats import binom

from jaxid._foundation.checks import InputError
from jaxid.data import Record, record
from jaxid.estimation import AutoregressiveNoise, OutputError, estimate, select_order
from jaxid.models import free

DRAWS, P, B, X0, SIGMA = 500, 1.0, 2.0, 0.5, 0.2
COEFFICIENTS = {1: (0.8,), 2: (1.2, -0.5)}
MODEL = Lag(p=0.8, b=1.5)
FREE = free(MODEL, "p", "b", per_record=("initial_state",))


def inputs(rows):
    t = 0.1 * np.arange(rows)
    return t, np.sign(np.sin(0.7 * t)) + 0.5 * np.sign(np.sin(1.9 * t))


def measurements(rng, rows, order, draws):
    """Return measured outputs of many draws, with stationary autoregressive noise."""
    t, u = inputs(rows)
    y = rk4(lag_rhs, t, u, np.array([X0]), np.array([P, B]))
    e = SIGMA * rng.normal(size=(draws, rows + 200))
    noise = lfilter([1.0], [1.0, *(-a for a in COEFFICIENTS[order])], e)[:, 200:]
    return y[:, 0] + noise


def estimates(rng, rows, order, draws=DRAWS):
    t, u = inputs(rows)
    z = measurements(rng, rows, order, draws)

    def single(z):
        of = Record(
            jnp.asarray(t),
            jnp.asarray(u)[:, None],
            z[:, None],
            jnp.ones((rows, 1), bool),
            {},
            ("u",),
            ("x",),
            ("",),
            ("",),
            ("",),
        )
        return estimate(MODEL, FREE, of, OutputError(AutoregressiveNoise(order)))

    return eqx.filter_jit(eqx.filter_vmap(single))(jnp.asarray(z))


@pytest.fixture
def rng(seed):
    return np.random.default_rng(seed)


def test_intervals_cover_under_coloured_noise(rng):
    """With errors for white noise 95 % intervals cover about half of the draws."""
    fits = estimates(rng, rows=600, order=1)
    assert bool(jnp.all(fits.successful))
    ends = np.asarray(fits.interval())
    covered = (ends[..., 0] <= [P, B]) & (ends[..., 1] >= [P, B])
    low, high = binom.ppf([0.0005 / 2, 1 - 0.0005 / 2], DRAWS, 0.95)
    count = np.sum(covered, axis=0)
    assert np.all((count >= low) & (count <= high)), count / DRAWS


def covariance(coefficients, rows):
    """Covariance of a stationary autoregression with innovations of unit variance."""
    impulse = lfilter([1.0], [1.0, *(-a for a in coefficients)], np.eye(1, 3000)[0])
    return toeplitz([impulse[lag:] @ impulse[: 3000 - lag] for lag in range(rows)])


def dense_cost(v, coefficients):
    """Negative log-likelihood of a stationary autoregression, its variance at the best."""
    R = covariance(coefficients, len(v))
    variance = v @ cho_solve(cho_factor(R), v) / len(v)
    return 0.5 * (len(v) * (np.log(variance) + 1.0) + np.linalg.slogdet(R)[1])


def test_estimate_equals_that_of_dense_gaussian(rng):
    """SciPy minimises over parameters, initial state and coefficients together."""
    rows, order = 60, 2
    t, u = inputs(rows)
    z = measurements(rng, rows, order, 1)[0]
    of = record(t, u[:, None], z[:, None], inputs=("u",), outputs=("x",))
    fit = estimate(MODEL, FREE, of, OutputError(AutoregressiveNoise(order)))

    def cost(unknown):
        p, b, x0, *coefficients = unknown
        return dense_cost(
            z - rk4(lag_rhs, t, u, np.array([x0]), np.array([p, b]))[:, 0], coefficients
        )

    coefficients = AutoregressiveNoise(order).coefficients(fit.residuals, fit.mask)[0]
    at = np.array([*fit.values, *np.ravel(fit.parameters.rows), *coefficients])
    np.testing.assert_allclose(fit.cost, cost(at), rtol=1e-9)
    best = minimize(cost, at, method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-12})
    assert cost(at) - best.fun < 1e-6
    np.testing.assert_allclose(at, best.x, rtol=0, atol=1e-3)


def test_sample_after_gap_is_whitened_once_its_predecessors_are_valid(rng):
    mask = jnp.ones((1, 50, 1), bool).at[0, 20].set(False)
    v = jnp.where(mask, jnp.asarray(rng.normal(size=(1, 50, 1))), 1e9)
    noise = AutoregressiveNoise(2)
    whiten = noise.whitening(v, mask)
    rows, (a, b) = np.asarray(whiten(v, mask))[0, :, 0], noise.coefficients(v, mask)[0]
    assert list(np.flatnonzero(rows == 0.0)) == [20, 21, 22]
    v = np.asarray(v)[0, :, 0]
    expected = (v[25] - a * v[24] - b * v[23]) / whiten.deviation[0]
    np.testing.assert_allclose(rows[25], expected, rtol=1e-12)
    np.testing.assert_allclose(np.sum(rows**2), 47.0, rtol=1e-12)


def test_order_of_noise_is_selected(rng):
    """In at least nine of ten records of 600 samples, and never for one record of white noise."""
    for order in (1, 2):
        t, u = inputs(600)
        y = rk4(lag_rhs, t, u, np.array([X0]), np.array([P, B]))[:, 0]
        noise = measurements(rng, 600, order, 40) - y
        orders = [
            select_order(jnp.asarray(v)[None, :, None], jnp.ones((1, 600, 1), bool)) for v in noise
        ]
        # BIC overfits a true order with probability P(chi2_1 > log 600) = 1.1 % per further order
        assert np.mean(np.asarray(orders) == order) >= 0.9, orders
    white = rng.normal(size=(1, 600, 1))
    assert select_order(jnp.asarray(white), jnp.ones((1, 600, 1), bool)) == 0


def test_unsuitable_records_are_refused(rng):
    t, u = inputs(100)
    z = rng.normal(size=(100, 1))
    uneven = t + 0.01 * np.sin(t)
    with pytest.raises(InputError, match="uniform sampling"):
        estimate(
            MODEL,
            FREE,
            record(uneven, u[:, None], z, inputs=("u",), outputs=("x",)),
            OutputError(AutoregressiveNoise(1)),
        )
    pair = [record(x, u[:, None], z, inputs=("u",), outputs=("x",)) for x in (t, 0.2 * t)]
    with pytest.raises(InputError, match=r"steps of 0\.02 to 0\.1 s"):
        estimate(MODEL, FREE, pair, OutputError(AutoregressiveNoise(1)))
    z[::2] = np.nan
    with pytest.raises(InputError, match="valid predecessors"):
        estimate(
            MODEL,
            FREE,
            record(t, u[:, None], z, inputs=("u",), outputs=("x",)),
            OutputError(AutoregressiveNoise(1)),
        )
    with pytest.raises(InputError, match="at least 1"):
        AutoregressiveNoise(0)
