"""Sandwich covariance against statsmodels, with own parameters, and under a wrong likelihood."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import statsmodels.api as sm
from scipy.stats import t as t_distribution
from static_line import Line

import jaxid
from jaxid import InputError
from jaxid.models import LinearModel
from jaxid.uncertainty import (
    ErrorKind,
    bootstrap,
    compare_errors,
    consider,
    profile_likelihood,
    sandwich,
)

ROWS, CASES = 12, 20


def data(seed, cases=CASES):
    """Records with errors in common and noise of different size."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(cases, ROWS)) + rng.normal(size=(cases, 1))
    size = np.exp(rng.normal(size=(cases, 1)))
    z = 2.0 * u + 1.0 + size * (rng.normal(size=u.shape) + rng.normal(size=(cases, 1)))
    t = 0.1 * np.arange(ROWS)
    pairs = zip(u, z, strict=True)
    return [jaxid.record(t, a, b, inputs=("u",), outputs=("y",)) for a, b in pairs], u, z


def fitted(records, *names, **options):
    model = Line(jnp.array(1.0), jnp.array(0.0))
    likelihood = jaxid.OutputError()
    return jaxid.estimate(model, jaxid.free(model, *names, **options), records, likelihood)


@pytest.mark.parametrize("block", [0, 4])
def test_it_equals_statsmodels(seed, block):
    records, u, z = data(seed)
    result = sandwich(fitted(records, "slope", "level"), records, jaxid.OutputError(), block=block)
    groups = np.arange(u.size) // (block or ROWS)
    X = np.column_stack([u.ravel(), np.ones(u.size)])
    other = sm.OLS(z.ravel(), X).fit(cov_type="cluster", cov_kwds={"groups": groups})
    np.testing.assert_allclose(result.covariance, other.cov_params(), rtol=1e-7)
    assert result.groups == groups[-1] + 1
    quantile = t_distribution.ppf(0.95, groups[-1])
    ends = other.params[:, None] + quantile * other.bse[:, None] * np.array([-1.0, 1.0])
    np.testing.assert_allclose(result.interval(0.9), ends, rtol=1e-6)


def test_own_parameters_are_eliminated(seed):
    """A level of each record: the regression of the deviations from the record's means."""
    records, u, z = data(seed)
    result = sandwich(fitted(records, "slope", per_record=("level",)), records, jaxid.OutputError())
    du, dz = u - u.mean(axis=1, keepdims=True), z - z.mean(axis=1, keepdims=True)
    slope = np.sum(du * dz) / np.sum(du**2)
    scores = np.sum(du * (dz - slope * du), axis=1)
    factor = CASES / (CASES - 1) * (u.size - 1) / (u.size - 1)
    expected = factor * np.sum(scores**2) / np.sum(du**2) ** 2
    np.testing.assert_allclose(result.covariance[0, 0], expected, rtol=1e-7)


@pytest.mark.parametrize("motion", [1.0, 0.0])
def test_priors_are_part_of_the_scatter(seed, motion):
    """`V = C (f sum s s' + T) C`; without motion the slope has the error of its prior."""
    records, u, z = data(seed)
    u = motion * u
    pairs = zip(u, z, strict=True)
    records = [
        jaxid.record(0.1 * np.arange(ROWS), a, b, inputs=("u",), outputs=("y",)) for a, b in pairs
    ]
    model, likelihood = (
        Line(jnp.array(1.0), jnp.array(0.0)),
        jaxid.OutputError(jaxid.FixedNoise([4.0])),
    )
    free = jaxid.free(model, "slope", "level", prior={"slope": (1.5, 0.1)})
    result = sandwich(jaxid.estimate(model, free, records, likelihood), records, likelihood)
    X, T = np.stack([u, np.ones(u.shape)], axis=-1), np.diag([1 / 0.1**2, 0.0])
    C = np.linalg.inv(np.einsum("gti,gtj->ij", X, X) / 4.0 + T)
    theta = C @ (np.einsum("gti,gt->i", X, z) / 4.0 + T @ [1.5, 0.0])
    s = np.einsum("gti,gt->gi", X, z - X @ theta) / 4.0
    factor = CASES / (CASES - 1) * (u.size - 1) / (u.size - 2)
    np.testing.assert_allclose(result.covariance, C @ (factor * s.T @ s + T) @ C, rtol=1e-7)
    if not motion:
        np.testing.assert_allclose(result.standard_errors[0], 0.1, rtol=1e-12)


def test_undetermined_parameter_has_infinite_error(seed):
    """Without motion the records say nothing about the slope."""
    _, _, z = data(seed)
    records = [
        jaxid.record(0.1 * np.arange(ROWS), np.zeros(ROWS), one, inputs=("u",), outputs=("y",))
        for one in z
    ]
    fit = fitted(records, "slope", "level")
    result = sandwich(fit, records, jaxid.OutputError())
    assert np.isinf(fit.standard_errors[0])
    np.testing.assert_array_equal(result.interval()[0], [-np.inf, np.inf])
    assert 0.0 < float(result.standard_errors[1]) < np.inf


def test_errors_equal_scatter_where_cramer_rao_is_a_third_of_it(seed):
    """Errors in common to a record, 40 records: the scatter of 4,000 least-squares estimates is
    known to 1.1 % (one sigma), the mean of 12 sandwich errors of 15 % scatter to 4.3 %.
    """
    rng, cases, draws = np.random.default_rng(seed), 40, 12
    u = rng.normal(size=(cases, 1)) + 0.3 * rng.normal(size=(cases, ROWS))

    def measured(count):
        noise = rng.normal(size=(count, *u.shape)) + rng.normal(size=(count, cases, 1))
        return 2.0 * u + 1.0 + noise

    X = np.column_stack([u.ravel(), np.ones(u.size)])
    slopes = np.linalg.lstsq(X, measured(4000).reshape(4000, -1).T)[0][0]
    errors, plain = [], []
    for z in measured(draws):
        pairs = zip(u, z, strict=True)
        t = 0.1 * np.arange(ROWS)
        records = [jaxid.record(t, a, b, inputs=("u",), outputs=("y",)) for a, b in pairs]
        fit = fitted(records, "slope", "level")
        errors.append(sandwich(fit, records, jaxid.OutputError()).standard_errors[0])
        plain.append(fit.standard_errors[0])
    assert abs(np.mean(errors) / slopes.std() - 1.0) < 0.16
    assert np.mean(plain) < 0.45 * slopes.std()


def test_advice_is_the_sandwich_where_noise_grows_with_the_input(seed):
    """White noise of size |u|: the scores have sqrt(3) times the stated deviation."""
    rng, t, records = np.random.default_rng(seed), 0.1 * np.arange(ROWS), []
    for u in rng.normal(size=(200, ROWS)):
        z = 2.0 * u + 1.0 + u * rng.normal(size=ROWS)
        records.append(jaxid.record(t, u, z, inputs=("u",), outputs=("y",)))
    fit = fitted(records, "slope", "level")
    result = sandwich(fit, records, jaxid.OutputError())
    comparison = compare_errors(fit, sandwich=result)
    assert comparison.advice[0].kind is ErrorKind.SANDWICH
    assert comparison.advice[1].kind is ErrorKind.CRAMER_RAO
    np.testing.assert_allclose(comparison.errors(ErrorKind.SANDWICH), result.standard_errors)
    ratio = float(result.standard_errors[0] / fit.standard_errors[0])
    assert abs(ratio / np.sqrt(3.0) - 1.0) < 0.2  # 200 groups: 5 % (one sigma)


def test_too_few_groups_are_refused(seed):
    records, *_ = data(seed, cases=3)
    fit = fitted(records, "slope", "level")
    with pytest.raises(InputError, match="3 groups of samples do not give a covariance of 2"):
        sandwich(fit, records, jaxid.OutputError())
    with pytest.raises(InputError, match="A block has -1 samples"):
        sandwich(fit, records, jaxid.OutputError(), block=-1)


@pytest.mark.parametrize(
    "function",
    [
        partial(sandwich, block=2),
        partial(bootstrap, key=jax.random.key(0)),
        partial(profile_likelihood, name="B[0,0]"),
        partial(consider, deviations={"C[0,0]": 0.1}),
    ],
    ids=lambda function: function.func.__name__,
)
def test_likelihood_of_another_estimate_is_refused(function):
    t = 0.1 * np.arange(40)
    records = jaxid.record(t, np.sin(t), np.sin(t), inputs=("u",), outputs=("x",))
    model = LinearModel(
        *([[0.0]], [[1.0]], [[1.0]], [[0.0]]), states=("x",), inputs=("u",), outputs=("x",)
    )
    fit = jaxid.estimate(model, jaxid.free(model, "B[0,0]"), records, jaxid.OutputError())
    with pytest.raises(InputError, match="no noise parameters of FilterError"):
        function(fit, records, jaxid.FilterError({"x": 0.1}))
