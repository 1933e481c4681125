"""Draws from the posterior against closed forms: known and unknown R, a bound, own parameters."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import truncnorm
from static_line import Line

import jaxid
from jaxid import InputError
from jaxid.models import AbstractModel
from jaxid.uncertainty import posterior

pytest.importorskip("blackjax")

SIGMA, ROWS = 0.5, 30


class Place(AbstractModel):
    """`dx/dt = gain u`, `y = x`."""

    gain: jax.Array
    states, inputs, outputs = ("x",), ("u",), ("x",)

    def rhs(self, t, x, u):
        return self.gain * u

    def output(self, t, x, u):
        return x


def data(seed, slope=2.0, level=1.0):
    rng = np.random.default_rng(seed)
    u = rng.normal(size=ROWS)
    z = slope * u + level + SIGMA * rng.normal(size=ROWS)
    return jaxid.record(0.1 * np.arange(ROWS), u, z, inputs=("u",), outputs=("y",)), u, z


def drawn(model, free, records, likelihood):
    fit = jaxid.estimate(model, free, records, likelihood)
    result = posterior(fit, records, likelihood, key=jax.random.key(3), draws=1500)
    assert result.agree, str(result)
    return fit, result


def require_mean_and_deviation(result, mean, deviation):
    """Within 4.5 standard errors of the Monte Carlo, of a nearly normal posterior."""
    flat = np.asarray(result.draws).reshape(-1, len(result.names))
    effective = np.asarray(result.effective)
    error = deviation / np.sqrt(effective)
    assert (np.abs(flat.mean(axis=0) - mean) < 4.5 * error).all()
    # the squares need more draws than the values: at least a third of the effective number
    ratio = flat.std(axis=0) / deviation
    assert (np.abs(ratio - 1.0) < 4.5 * np.sqrt(3.0 / (2.0 * effective))).all(), ratio


def test_linear_model_with_known_noise_has_the_normal_posterior(seed):
    records, u, z = data(seed)
    model = Line(jnp.array(1.0), jnp.array(0.0))
    likelihood = jaxid.OutputError(jaxid.FixedNoise([SIGMA**2]))
    free = jaxid.free(model, "slope", "level", prior={"level": (0.9, 0.2)})
    _, result = drawn(model, free, records, likelihood)
    X = np.column_stack([u, np.ones(ROWS)])
    M = X.T @ X / SIGMA**2 + np.diag([0.0, 1 / 0.2**2])
    mean = np.linalg.solve(M, X.T @ z / SIGMA**2 + [0.0, 0.9 / 0.2**2])
    require_mean_and_deviation(result, mean, np.sqrt(np.diag(np.linalg.inv(M))))
    tree = result.to_arviz()
    assert tree["posterior"].dims == {"chain": 4, "draw": 1500}
    np.testing.assert_array_equal(tree["posterior"]["slope"], result.draws[..., 0])


def test_unknown_noise_gives_students_t(seed):
    """R integrated out with the density 1/s, flat priors: t with N - p degrees of freedom."""
    records, u, z = data(seed)
    model = Line(jnp.array(1.0), jnp.array(0.0))
    _, result = drawn(model, jaxid.free(model, "slope", "level"), records, jaxid.OutputError())
    X = np.column_stack([u, np.ones(ROWS)])
    mean, rest = np.linalg.lstsq(X, z)[:2]
    nu = ROWS - 2
    variance = rest[0] / nu * np.diag(np.linalg.inv(X.T @ X)) * nu / (nu - 2)
    require_mean_and_deviation(result, mean, np.sqrt(variance))


def test_bound_cuts_the_normal_posterior(seed):
    """The estimate lies on the bound."""
    records, u, z = data(seed)
    deviation = SIGMA / np.sqrt(u @ u)
    free_slope = float(u @ (z - 1.0) / (u @ u))
    low = free_slope + 0.7 * float(deviation)
    model = Line(jnp.array(low + 1.0), jnp.array(1.0))
    likelihood = jaxid.OutputError(jaxid.FixedNoise([SIGMA**2]))
    free = jaxid.free(model, "slope", bounds={"slope": (low, None)})
    fit, result = drawn(model, free, records, likelihood)
    assert bool(fit.on_bound[0])
    expected = truncnorm(0.7, np.inf, loc=free_slope, scale=deviation)
    assert float(result.draws.min()) >= low
    require_mean_and_deviation(result, expected.mean(), expected.std())


def test_initial_states_of_records_are_drawn_with_the_shared_parameters(seed):
    rng, t = np.random.default_rng(seed), 0.1 * np.arange(20)
    made = []
    for start in (0.0, 1.0):
        u = rng.normal(size=20)
        path = start + np.concatenate([[0.0], np.cumsum(0.05 * (u[1:] + u[:-1]))])
        z = path + SIGMA * rng.normal(size=20)
        made.append((jaxid.record(t, u, z, inputs=("u",), outputs=("x",)), path - start, z))
    model = Place(jnp.array(0.5))
    free = jaxid.free(model, "gain", per_record=("initial_state",))
    likelihood = jaxid.OutputError(jaxid.FixedNoise([SIGMA**2]))
    _, result = drawn(model, free, [one for one, _, _ in made], likelihood)
    X = np.zeros((40, 3))
    X[:, 0] = np.concatenate([path for _, path, _ in made])
    X[:20, 1] = X[20:, 2] = 1.0
    z = np.concatenate([z for _, _, z in made])
    mean, cov = np.linalg.lstsq(X, z)[0], SIGMA**2 * np.linalg.inv(X.T @ X)
    require_mean_and_deviation(result, mean[:1], np.sqrt(cov[:1, 0]))
    own = np.asarray(result.own).reshape(-1, 2)
    assert (np.abs(own.mean(axis=0) - mean[1:]) < 0.1 * np.sqrt(np.diag(cov))[1:]).all()
    correlation = np.corrcoef(np.asarray(result.draws).ravel(), own[:, 0])[0, 1]
    assert abs(correlation - cov[0, 1] / np.sqrt(cov[0, 0] * cov[1, 1])) < 0.1


def test_undetermined_and_too_few_are_refused(seed):
    records, *_ = data(seed)
    records = jaxid.record(records.t, np.ones(ROWS), records.z, inputs=("u",), outputs=("y",))
    model, likelihood = Line(jnp.array(1.0), jnp.array(0.0)), jaxid.OutputError()
    fit = jaxid.estimate(model, jaxid.free(model, "slope", "level"), records, likelihood)
    key = jax.random.key(0)
    nowhere = dataclasses.replace(fit, values=jnp.full(2, jnp.nan))
    with pytest.raises(InputError, match="cost of the estimate is not finite"):
        posterior(nowhere, records, likelihood, key=key)
    with pytest.raises(InputError, match="do not determine all parameters"):
        posterior(fit, records, likelihood, key=key)
    with pytest.raises(InputError, match="Give at least 2"):
        posterior(fit, records, likelihood, key=key, chains=1)
    with pytest.raises(InputError, match="at least 100 draws"):
        posterior(fit, records, likelihood, key=key, draws=10)
