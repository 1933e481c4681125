"""Records drawn from models with process noise, and the bootstrap of filter error."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oscillator import OSCILLATOR
from scipy.signal import lfilter

import jaxid
from jaxid import FilterError, FirstOrder, InnovationForm, InputError, OutputError
from jaxid.estimation.estimate import checked_case
from jaxid.models import free
from jaxid.uncertainty import bootstrap
from jaxid.uncertainty.bootstrap import drawn_records

NOISE = FilterError({"v": FirstOrder(0.5, 0.4), "x": 0.1}, {"a": 0.05, "b": 0.08}, {"x": 0.2})


def empty(count, missing=0.0):
    rng, t = np.random.default_rng(1), 0.05 * np.arange(count)
    z = np.where(rng.uniform(size=(count, 2)) < missing, np.nan, 0.0)
    return jaxid.record(t, np.sign(np.sin(1.7 * t)), z, inputs=("f",), outputs=("a", "b"))


def test_innovations_of_drawn_records_are_white_with_unit_variance():
    """2,000 records of 40 samples: every mean, variance and correlation within 4.9 standard errors,
    which all of 3,321 meet with a probability above 0.995.
    """
    case = checked_case(OSCILLATOR, free(OSCILLATOR, "A[1,0]"), empty(40), NOISE)
    problem, parameters = case.problem, case.begin
    draws = 2000

    def whitened(key):
        z = drawn_records(problem, parameters, jnp.eye(2), key)
        again = eqx.tree_at(lambda node: node.records.z, problem, z)
        return again.residuals(parameters)[0, :, :2].ravel()

    w = np.asarray(jax.jit(jax.vmap(whitened))(jax.random.split(jax.random.key(4), draws)))
    limit = 4.9 / np.sqrt(draws)
    assert np.abs(w.mean(axis=0)).max() < limit
    assert np.abs((w**2).mean(axis=0) - 1.0).max() < limit * np.sqrt(2.0)
    products = w.T @ w / draws
    assert np.abs(products - np.diag(np.diag(products))).max() < limit


@pytest.mark.parametrize(
    "likelihood", [FilterError({"v": 0.3}), InnovationForm()], ids=["filter error", "innovations"]
)
def test_bootstrap_with_process_noise_equals_cramer_rao(likelihood):
    """100 draws give a standard error to 7 % (one sigma); the record is long enough for Cramer-Rao
    to hold within 10 %.
    """
    truth = FilterError({"v": 0.3}, {"a": 0.05, "b": 0.08})
    case = checked_case(OSCILLATOR, free(OSCILLATOR, "A[1,0]"), empty(600), truth)
    z = drawn_records(case.problem, case.begin, jnp.eye(2), jax.random.key(2))[0]
    blank = empty(600)
    data = jaxid.record(blank.t, blank.u, z, inputs=("f",), outputs=("a", "b"))
    chosen = free(OSCILLATOR, "A[1,0]", "A[1,1]", "B[1,0]")
    fit = jaxid.estimate(OSCILLATOR, chosen, data, likelihood)
    assert bool(fit.successful)
    result = bootstrap(fit, data, likelihood, key=jax.random.key(1), draws=100)
    assert float(result.successful.mean()) > 0.97
    ratio = np.asarray(result.standard_errors / fit.standard_errors)[:3]
    assert ((ratio > 0.7) & (ratio < 1.35)).all(), ratio
    assert (np.abs(result.bias / fit.standard_errors)[:3] < 0.5).all()
    with pytest.raises(InputError, match="are innovations, and no blocks"):
        bootstrap(fit, data, likelihood, key=jax.random.key(1), block=20)


def test_parametric_bootstrap_of_noise_with_memory_is_refused():
    rng, blank = np.random.default_rng(0), empty(200)
    clean = np.asarray(jaxid.simulate(OSCILLATOR, blank.t, blank.u, np.zeros(2)).y)
    z = clean + 0.05 * lfilter([0.6], [1.0, -0.8], rng.normal(size=(200, 2)), axis=0)
    data = jaxid.record(blank.t, blank.u, z, inputs=("f",), outputs=("a", "b"))
    likelihood = OutputError(jaxid.AutoregressiveNoise(1))
    fit = jaxid.estimate(OSCILLATOR, free(OSCILLATOR, "A[1,0]"), data, likelihood)
    with pytest.raises(InputError, match="the noise is AutoregressiveNoise"):
        bootstrap(fit, data, likelihood, key=jax.random.key(0))
    result = bootstrap(fit, data, likelihood, key=jax.random.key(0), draws=40, block=40)
    assert 0.5 < float(result.standard_errors[0] / fit.standard_errors[0]) < 1.5
