"""Intervals cover their nominal share: 2,000 simulated records, estimated in one call."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference_estimation import Lag, lag_rhs, rk4
from scipy.special import stdtr
from scipy.stats import binom, norm
from scipy.stats import t as t_distribution

from jaxid._foundation.checks import InputError
from jaxid.data import Record, record
from jaxid.estimation import OutputError, estimate
from jaxid.models import FixedNoise, LinearModel, free

DRAWS, WIDTH = 2000, 1.959963984540054
P, B, X0, SIGMA = 1.0, 2.0, 0.5, 0.2


def estimates(key, rows, rho, gaps=0.0):
    """All draws: noise of standard deviation SIGMA, first-order autoregressive with `rho`; a share
    of samples missing.
    """
    t = 0.1 * np.arange(rows)
    u = np.sign(np.sin(0.7 * t)) + 0.5 * np.sign(np.sin(1.9 * t))
    y = rk4(lag_rhs, t, u, np.array([X0]), np.array([P, B]))
    e = jax.random.normal(key, (rows, DRAWS))

    def step(x, e):
        x = rho * x + np.sqrt(1 - rho**2) * e
        return x, x

    noise = jnp.concatenate([e[:1], jax.lax.scan(step, e[0], e[1:])[1]]).T if rho else e.T
    t, u, z = (
        jnp.asarray(t),
        jnp.asarray(u)[:, None],
        jnp.asarray(y)[None] + SIGMA * noise[..., None],
    )
    model = Lag(p=0.8, b=1.5)
    chosen = free(model, "p", "b", per_record=("initial_state",))

    valid = jax.random.uniform(jax.random.key(30), z.shape) >= gaps

    def one(z, valid):
        return estimate(
            model,
            chosen,
            Record(t, u, z, valid, {}, ("u",), ("x",), ("",), ("",), ("",)),
            OutputError(),
        )

    return eqx.filter_jit(eqx.filter_vmap(one))(jnp.where(valid, z, 0.0), valid)


@pytest.fixture(scope="module")
def white():
    return estimates(jax.random.key(1974), 300, 0.0)


@pytest.fixture(scope="module")
def coloured():
    return estimates(jax.random.key(1974), 200, 0.8)


@pytest.fixture(scope="module")
def coloured_with_gaps():
    return estimates(jax.random.key(1974), 600, 0.8, gaps=0.3)


def shares(result, errors):
    """Share of the intervals that hold the truth, for p and b."""
    truth = jnp.array([[P, B]])
    return np.asarray(jnp.mean((jnp.abs(result.values - truth) < WIDTH * errors) * 1.0, axis=0))


def band(parameters):
    """Shares that a right 95 % interval meets with 99.9 % probability, Bonferroni over the
    parameters.
    """
    tail = 0.0005 / parameters
    return binom.ppf(tail, DRAWS, 0.95) / DRAWS, binom.ppf(1 - tail, DRAWS, 0.95) / DRAWS


def test_band_of_shares_equals_design_value():
    low, high = band(3)
    assert 0.930 < low < 0.934
    assert 0.964 < high < 0.967


def test_all_records_of_white_noise_converge(white):
    assert bool(jnp.all(white.successful))
    assert white.values.shape == (DRAWS, 2)


def test_intervals_under_white_noise_cover_every_parameter(white):
    """R is estimated too, with N = 300 and three parameters: the normal interval then covers 94.8
    %.
    """
    low, high = band(3)
    own = float(
        jnp.mean((jnp.abs(white.own[:, 0, 0] - X0) < WIDTH * white.own_errors[:, 0, 0]) * 1.0)
    )
    covered = [*shares(white, white.standard_errors), own]
    assert all(low <= share <= high for share in covered), (covered, low, high)


def test_standard_errors_under_white_noise_equal_scatter(white):
    """Mean standard error over the scatter of the estimates, which 2,000 draws give to 1.6 % (one
    sigma).
    """
    ratio = jnp.mean(white.standard_errors, axis=0) / jnp.std(white.values, axis=0)
    np.testing.assert_allclose(ratio, 1.0, atol=3.3 * 0.016 + 0.01)
    correlation = np.corrcoef(np.asarray(white.values).T)[0, 1]
    np.testing.assert_allclose(jnp.mean(white.correlation[:, 0, 1]), correlation, atol=0.05)


def test_noise_variance_under_white_noise_is_estimated(white):
    """Maximum likelihood divides by N, not by N - 3: 1 % low; the mean of 2,000 draws is known to
    0.2 %.
    """
    np.testing.assert_allclose(jnp.mean(white.noise), SIGMA**2 * (1 - 3 / 300), rtol=0.01)


def test_corrected_errors_under_white_noise_cover_slightly_more(white):
    """It never shrinks an interval, so that it covers a little more than 95 %."""
    low, _ = band(2)
    covered = shares(white, white.corrected_errors)
    assert (covered >= low).all(), covered
    assert (covered <= 0.975).all(), covered


def covered_by_interval(result):
    """Share of the intervals for coloured residuals that hold the truth, for p and b."""
    ends, truth = np.asarray(result.interval(coloured=True)), np.array([P, B])
    return np.mean((ends[..., 0] <= truth) & (truth <= ends[..., 1]), axis=0)


def test_interval_for_coloured_residuals_covers_with_200_samples(coloured):
    """AR(1) with 0.8. Uncorrected intervals cover about 52 %.

    A tapered autocovariance of the residual itself with normal quantiles covers 86 %; the
    autoregressive one without the correction of its power 89 %, and with it 92 %; Student's t
    gives the rest.
    """
    white = shares(coloured, coloured.standard_errors)
    assert (white < 0.6).all(), white
    low, high = band(2)
    covered = covered_by_interval(coloured)
    assert ((low <= covered) & (covered <= high)).all(), covered


def test_corrected_error_of_initial_state_covers_under_coloured_noise(coloured):
    """The corrected variances are estimates themselves: the normal quantile covers its share of
    Student's t, with the degrees of freedom of the shared parameters.
    """
    apart = np.abs(coloured.own[:, 0, 0] - X0)
    assert np.mean(apart < WIDTH * coloured.own_errors[:, 0, 0]) < 0.75
    nu = np.median(coloured.corrected_dof, axis=0)
    expected = 2.0 * stdtr(np.array([nu.min(), nu.max()]), WIDTH) - 1.0
    low, high = binom.ppf([0.0005, 0.9995], DRAWS, expected) / DRAWS
    covered = np.mean(apart < WIDTH * coloured.corrected_own_errors[:, 0, 0])
    assert low <= covered <= high, (low, covered, high)


def test_interval_for_coloured_residuals_covers_with_gaps(coloured_with_gaps):
    """The noise of the test above, 600 samples of which 30 % are missing at random.

    An autocovariance from all pairs of valid samples is not positive definite, and covers 88 % with
    normal quantiles.
    """
    low, high = band(2)
    covered = covered_by_interval(coloured_with_gaps)
    assert ((low <= covered) & (covered <= high)).all(), covered


def test_interval_for_coloured_residuals_covers_under_white_noise(white):
    low, high = band(2)
    covered = covered_by_interval(white)
    assert ((low <= covered) & (covered <= high)).all(), covered


def short_estimates(likelihood):
    """All draws: 48 samples of `y = D u` with three parameters."""
    rows, units = 48, ("",) * 3
    draw = np.random.default_rng(7)
    u, truth = draw.normal(size=(rows, 3)), np.array([1.0, -2.0, 0.5])
    z = jnp.asarray(u @ truth)[None] + SIGMA * jax.random.normal(
        jax.random.key(1974), (DRAWS, rows)
    )
    names = ("a", "b", "c")
    model = LinearModel(
        [[-1.0]], [[0.0] * 3], [[0.0]], [[0.0] * 3], states=("x",), inputs=names, outputs=("y",)
    )
    chosen = free(model, "D")

    def one(z):
        data = Record(
            jnp.arange(rows * 1.0),
            jnp.asarray(u),
            z[:, None],
            jnp.ones((rows, 1), bool),
            {},
            names,
            ("y",),
            units,
            ("",),
            ("",),
        )
        return estimate(model, chosen, data, likelihood)

    return eqx.filter_jit(eqx.filter_vmap(one))(z), truth


@pytest.mark.parametrize(
    ("likelihood", "dof"), [(OutputError(), 45), (OutputError(FixedNoise([SIGMA**2])), np.inf)]
)
def test_intervals_of_short_records_cover_nominal_share(likelihood, dof):
    """48 samples, three parameters, 2,000 draws: the band that holds a right interval with 99.9 %
    for all three together.

    With R estimated, normal quantiles of the asymptotic errors cover 93.2 %.
    """
    result, truth = short_estimates(likelihood)
    np.testing.assert_array_equal(result.degrees_of_freedom, dof)
    low, high = band(3)
    ends = np.asarray(result.interval())
    covered = np.mean((ends[..., 0] <= truth) & (truth <= ends[..., 1]), axis=0)
    assert ((low <= covered) & (covered <= high)).all(), covered
    half = (ends[..., 1] - ends[..., 0]) / 2
    factor = (
        norm.isf(0.025) if np.isinf(dof) else t_distribution.isf(0.025, dof) * np.sqrt(48 / dof)
    )
    np.testing.assert_allclose(half, factor * np.asarray(result.standard_errors), rtol=1e-10)


def test_interval_of_slope_equals_least_squares(seed):
    """A slope through the origin, 12 samples: the closed form of its interval."""
    draw = np.random.default_rng(seed)
    u = draw.normal(size=12)
    z = 2.0 * u + 0.3 * draw.normal(size=12)
    model = LinearModel(
        [[-1.0]], [[0.0]], [[0.0]], [[0.0]], states=("x",), inputs=("u",), outputs=("y",)
    )
    data = record(np.arange(12.0), u, z, inputs=("u",), outputs=("y",))
    result = estimate(model, free(model, "D"), data, OutputError())
    slope = u @ z / (u @ u)
    error = np.sqrt(np.sum((z - slope * u) ** 2) / 11 / (u @ u))
    expected = slope + t_distribution.isf([0.95, 0.05], 11) * error
    np.testing.assert_allclose(result.interval(0.9)[0], expected, rtol=1e-6)
    assert "Student's t with 11 degrees of freedom" in str(result)
    known = estimate(model, free(model, "D"), data, OutputError(FixedNoise([0.09])))
    assert "R is known; intervals use normal quantiles" in str(known)
    with pytest.raises(InputError, match="The level is 95"):
        result.interval(95.0)
