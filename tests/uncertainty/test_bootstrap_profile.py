"""Bootstrap, profile likelihood and the advice which error to take, on small static models."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.signal import lfilter
from scipy.special import ndtri
from static_line import Line

import jaxid
from jaxid._foundation.checks import InputError
from jaxid._foundation.types import Array
from jaxid.data import record
from jaxid.models import AbstractModel
from jaxid.uncertainty import (
    Bootstrap,
    ErrorKind,
    Shape,
    bootstrap,
    compare_errors,
    consider,
    profile_likelihood,
)

ROWS = 240


class Exponential(AbstractModel):
    """A static model: `y = a (1 - exp(-b u)) + c`, of which c is a sensor's offset."""

    a: Array
    b: Array
    c: Array
    states, inputs, outputs = (), ("u",), ("y",)

    def rhs(self, t, x, u):
        return x

    def output(self, t, x, u):
        return self.a * (1 - jnp.exp(-self.b * u)) + self.c


def curve_of(u, a, b, c=0.0):
    return a * (1 - np.exp(-b * u)) + c


def case(sigma, rho=0.0, reach=3.0, b=1.0, least=0.0, **options):
    """Estimate of a and b, records and likelihood; noise AR(1) with `rho`."""
    rng, model = np.random.default_rng(5), Exponential(a=2.0, b=b, c=0.0)
    u = least + reach * np.abs(np.sin(0.05 * np.arange(ROWS)))
    e = lfilter([np.sqrt(1 - rho**2)], [1.0, -rho], rng.normal(size=ROWS + 100))[100:]
    z = curve_of(u, 2.0, b) + sigma * e
    data = record(0.1 * np.arange(ROWS), u, z, inputs=("u",), outputs=("y",))
    likelihood = jaxid.OutputError()
    fit = jaxid.estimate(model, jaxid.free(model, "a", "b", **options), data, likelihood)
    return fit, data, likelihood, (u, z)


@pytest.fixture(scope="module")
def white():
    return case(sigma=0.1)


@pytest.fixture(scope="module")
def coloured():
    return case(sigma=0.1, rho=0.8)


@pytest.fixture(scope="module")
def curved():
    """Little of the saturation is reached, so that a and b are nearly one parameter."""
    return case(sigma=0.1, reach=0.8)


def test_bootstrap_of_regular_problem_equals_cramer_rao(white):
    """200 draws give a standard error to 5 % (one sigma)."""
    fit, data, likelihood, _ = white
    result = bootstrap(fit, data, likelihood, key=jax.random.key(1), draws=200)
    assert bool(jnp.all(result.successful))
    np.testing.assert_allclose(result.standard_errors, fit.standard_errors, rtol=0.18)
    ends = np.asarray(result.interval() - fit.interval()) / np.asarray(fit.standard_errors)[:, None]
    assert (np.abs(ends) < 0.7).all(), ends  # a quantile of 200 draws is right to 0.2 (one sigma)
    assert (np.abs(result.bias) < 0.25 * np.asarray(fit.standard_errors)).all()


def test_bootstrap_repeats_the_priors(white):
    """Each prior holds four times the information of the records; with its mean held fixed, the
    estimates would scatter by less than half of their standard errors.
    """
    known = np.asarray(white[0].standard_errors) / 2.0
    prior = {"a": (2.0, float(known[0])), "b": (1.0, float(known[1]))}
    fit, data, likelihood, _ = case(sigma=0.1, prior=prior)
    result = bootstrap(fit, data, likelihood, key=jax.random.key(1), draws=200)
    np.testing.assert_allclose(result.standard_errors, fit.standard_errors, rtol=0.18)


def test_block_bootstrap_keeps_colour_of_residuals(coloured):
    """Blocks of 30 samples, six correlation times, keep some 80 % of the variance; samples drawn
    one by one give the Cramer-Rao bound, a third of the error.
    """
    fit, data, likelihood, _ = coloured
    result = bootstrap(fit, data, likelihood, key=jax.random.key(1), draws=200, block=30)
    ratio = np.asarray(result.standard_errors / fit.corrected_errors)
    assert ((ratio > 0.65) & (ratio < 1.25)).all(), ratio
    assert (np.asarray(result.standard_errors) > 1.6 * np.asarray(fit.standard_errors)).all()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_interval_of_estimate_on_bound_ends_at_quantile_of_draws(side):
    """Half of the draws of an unbiased estimate stand on the bound, as the estimate does."""
    normal = ndtri((np.arange(400) + 0.5) / 400)
    draws = jnp.asarray(side * np.maximum(normal, 0.0))[:, None]
    result = Bootstrap(("b",), jnp.zeros(1), draws, jnp.ones(400, bool), 0)
    expected = np.sort([0.0, side * ndtri(0.975)])
    # Between quantiles of 400 draws, 0.04 apart here
    np.testing.assert_allclose(result.interval()[0], expected, atol=0.04)


def test_blocks_have_the_same_scatter_with_known_noise(seed):
    """The values of a line do not depend on R, so that the draws are equal."""
    rng, model, fits = np.random.default_rng(seed), Line(jnp.array(1.0), jnp.array(0.0)), []
    u, z = rng.normal(size=(2, 12))
    data = record(0.1 * np.arange(12), u, z, inputs=("u",), outputs=("y",))
    for noise in (jaxid.DiagonalNoise(), jaxid.FixedNoise([2.0])):
        likelihood = jaxid.OutputError(noise)
        fit = jaxid.estimate(model, jaxid.free(model, "slope", "level"), data, likelihood)
        key = jax.random.key(1)
        fits.append(bootstrap(fit, data, likelihood, key=key, draws=20, block=1))
    np.testing.assert_allclose(fits[1].draws, fits[0].draws, rtol=1e-6, atol=1e-8)


def test_profile_equals_profile_by_scipy(curved):
    """The best a for each b is linear least squares; the ends follow by root finding."""
    fit, data, likelihood, (u, z) = curved
    result = profile_likelihood(fit, data, likelihood, "b")

    def cost(b):
        basis = curve_of(u, 1.0, b)
        a = basis @ z / (basis @ basis)
        return 0.5 * ROWS * (np.log(np.mean((z - a * basis) ** 2)) + 1.0)

    np.testing.assert_allclose(
        result.costs, [cost(b) for b in np.asarray(result.points)], rtol=1e-8
    )
    least = cost(fit.value("b"))
    ends = [
        brentq(lambda b: cost(b) - least - result.threshold, *bracket)
        for bracket in ((1e-6, fit.value("b")), (fit.value("b"), 10.0))
    ]
    # The root of the rise is interpolated between points half a standard error apart.
    np.testing.assert_allclose(result.ends, ends, atol=0.1 * fit.standard_error("b"))
    assert result.shape is Shape.BOUNDED


@pytest.mark.parametrize("size", [1e-5, 1e3])
@pytest.mark.parametrize("past", [0.0, 3.0, 100.0])
def test_profile_from_bound_equals_closed_form(size, past):
    """`y = slope u + level` with one standard error `size` of the slope, whose estimate without its
    bound at zero lies `past` standard errors outside: `d^2 / 2 + past d` is the rise at `d`.
    """
    model, u = Line(jnp.array(1.0), jnp.array(0.0)), np.sin(0.3 * np.arange(12))
    u = (u - u.mean()) / np.linalg.norm(u - u.mean()) / size
    z = 1.0 - past * size * u
    data = record(0.1 * np.arange(12), u, z, inputs=("u",), outputs=("y",))
    likelihood = jaxid.OutputError(jaxid.FixedNoise([1.0]))
    chosen = jaxid.free(model, "slope", "level", bounds={"slope": (0.0, None)})
    fit = jaxid.estimate(model, chosen, data, likelihood)
    assert fit.value("slope") == 0.0
    result = profile_likelihood(fit, data, likelihood, "slope")
    end = size * (np.sqrt(past**2 + 2.0 * result.threshold) - past)
    # The root of a straight line, interpolated between the second and the third of equal steps, is
    # right to 2.6 %.
    np.testing.assert_allclose(result.ends, [0.0, end], rtol=0.026)
    assert result.shape is Shape.ONE_SIDED


def test_profile_without_upper_limit_is_one_sided():
    """A saturation that is reached at once has no largest rate."""
    fit, data, likelihood, _ = case(0.1, reach=3.0, b=8.0, least=1.0, bounds={"b": (0.1, 50.0)})
    result = profile_likelihood(fit, data, likelihood, "b")
    assert result.shape is Shape.ONE_SIDED
    assert result.ends[1] == 50.0
    assert 1.0 < result.ends[0] < fit.value("b")
    assert compare_errors(fit, profiles=[result]).advice[1].kind is ErrorKind.PROFILE


def test_advice_names_reason_of_each_error(white, coloured):
    fit, data, likelihood, _ = white
    kinds = [advice.kind for advice in compare_errors(fit).advice]
    assert kinds == [ErrorKind.CRAMER_RAO] * 2
    constants = consider(fit, data, likelihood, {"c": 0.2})
    together = compare_errors(fit, considered=constants)
    assert [advice.kind for advice in together.advice] == [ErrorKind.CONSTANTS] * 2
    expected = np.hypot(fit.corrected_errors, np.abs(constants.gain[:, 0]) * 0.2)
    np.testing.assert_allclose(together.errors(ErrorKind.CONSTANTS), expected)
    comparison = compare_errors(coloured[0])
    assert [advice.kind for advice in comparison.advice] == [ErrorKind.COLOURED] * 2
    assert "times too small" in str(comparison)
    assert "interval(coloured=True)" in str(comparison)


def test_faulty_bootstraps_are_refused(white):
    fit, data, likelihood, _ = white
    key = jax.random.key(0)
    with pytest.raises(InputError, match="take 200"):
        bootstrap(fit, data, likelihood, key=key, draws=3)
    with pytest.raises(InputError, match="shorter blocks"):
        bootstrap(fit, data, likelihood, key=key, block=ROWS + 1)
    mask = data.mask.at[5].set(False)
    with pytest.raises(InputError, match="Samples are missing"):
        bootstrap(fit, dataclasses.replace(data, mask=mask), likelihood, key=key, block=10)
