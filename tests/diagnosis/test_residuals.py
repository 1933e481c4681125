"""Residual tests: equal to statsmodels, with the level they claim, and able to find colour and
followed signals.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import binom
from statsmodels.stats.diagnostic import acorr_ljungbox
from statsmodels.tsa.stattools import acf, ccf

from jaxid._foundation.checks import InputError
from jaxid.diagnosis import residuals
from jaxid.diagnosis.residual_report import analyse_residual
from jaxid.diagnosis.residuals import residual_tests

DRAWS = 2000

# each compiled as one program in place of one for every operation
autocorrelation = eqx.filter_jit(residuals.autocorrelation)
cross_correlation = eqx.filter_jit(residuals.cross_correlation)
ljung_box = eqx.filter_jit(residuals.ljung_box)


def whole(v):
    return jnp.ones(v.shape, bool)


@eqx.filter_jit
def ar1(key, shape, rho):
    """First-order autoregressive noise of unit variance along axis -2, stationary from the
    start.
    """
    e = jnp.moveaxis(jax.random.normal(key, shape), -2, 0)

    def step(x, e):
        x = rho * x + jnp.sqrt(1 - rho**2) * e
        return x, x

    return jnp.moveaxis(jnp.concatenate([e[:1], jax.lax.scan(step, e[0], e[1:])[1]]), 0, -2)


def band(share, n, parameters=1):
    """Counts among n that a right test meets with 99.9 % probability, Bonferroni over the
    parameters.
    """
    return binom.ppf(0.0005 / parameters, n, share), binom.ppf(1 - 0.0005 / parameters, n, share)


def test_autocorrelation_and_ljung_box_equal_statsmodels(key):
    v = ar1(key, (1, 300, 2), 0.3)
    v = v - jnp.mean(v, axis=1, keepdims=True)  # statsmodels takes the mean off, we do not
    r, test = autocorrelation(v, whole(v), 20), ljung_box(v, whole(v), 20, fitted=3)
    for j in range(2):
        x = np.asarray(v[0, :, j])
        np.testing.assert_allclose(
            r[j], acf(x, nlags=20, adjusted=True, fft=False), rtol=1e-10, atol=1e-12
        )
        theirs = acorr_ljungbox(x, lags=[20], model_df=3)
        np.testing.assert_allclose(test.statistic[j], theirs["lb_stat"].iloc[0], rtol=1e-10)
        np.testing.assert_allclose(test.p_value[j], theirs["lb_pvalue"].iloc[0], rtol=1e-8)
        assert test.dof[j] == 17


def test_cross_correlation_equals_statsmodels_and_positive_lags_say_that_the_signal_comes_first(
    key,
):
    a, b = jax.random.split(key)
    s = ar1(a, (1, 400, 1), 0.8)
    # the residual follows the signal of 7 samples ago
    v = 0.5 * jnp.roll(s, 7, axis=1) + jax.random.normal(b, s.shape)
    v = v - jnp.mean(v)
    r, width = cross_correlation(v, whole(v), s, 12)
    theirs = ccf(np.asarray(v[0, :, 0]), np.asarray(s[0, :, 0]), adjusted=True, fft=False)[:13]
    np.testing.assert_allclose(r[0, 0, 12:], theirs, rtol=1e-10, atol=1e-12)
    back = ccf(np.asarray(s[0, :, 0]), np.asarray(v[0, :, 0]), adjusted=True, fft=False)[:13]
    np.testing.assert_allclose(r[0, 0, 12::-1], back, rtol=1e-10, atol=1e-12)
    assert int(jnp.argmax(jnp.abs(r[0, 0]))) - 12 == 7
    np.testing.assert_allclose(width[0, 0, 12 + 7], 1.959964 / np.sqrt(400 - 7), rtol=1e-6)


def brute_force(v, mask, k):
    """The definition, pair by pair."""
    total, pairs = 0.0, 0
    for case in range(v.shape[0]):
        for i in range(v.shape[1] - k):
            if mask[case, i] and mask[case, i + k]:
                total, pairs = total + v[case, i] * v[case, i + k], pairs + 1
    return total / pairs, pairs


def gaps(key, v):
    """A mask with a fifth of the samples missing, and NaN there."""
    mask = jax.random.bernoulli(key, 0.8, v.shape)
    return jnp.where(mask, v, jnp.nan), mask


def test_gaps_are_counted_pair_by_pair(key):
    a, b = jax.random.split(key)
    v, mask = gaps(b, ar1(a, (3, 40, 1), 0.5))
    r, found = autocorrelation(v, mask, 5), ljung_box(v, mask, 5)
    V, K, N = np.asarray(v)[..., 0], np.asarray(mask)[..., 0], int(mask.sum())
    c = [brute_force(V, K, k) for k in range(6)]
    np.testing.assert_allclose(r[0], [mean / c[0][0] for mean, _ in c], rtol=1e-10)
    expected = (N + 2) / N * sum(n * (mean / c[0][0]) ** 2 for mean, n in c[1:])
    np.testing.assert_allclose(found.statistic[0], expected, rtol=1e-10)


def test_padding_changes_nothing(key):
    a, b, c = jax.random.split(key, 3)
    s = ar1(c, (2, 100, 1), 0.9)
    v, mask = gaps(b, ar1(a, (2, 100, 2), 0.4))
    pad = ((0, 0), (0, 57), (0, 0))
    padded = jnp.pad(v, pad), jnp.pad(mask, pad), jnp.pad(s, pad, mode="edge")[..., 0]
    ours = residual_tests(v, mask, {"s": s[..., 0]}, ("p", "q"), lags=15)
    theirs = residual_tests(*padded[:2], {"s": padded[2]}, ("p", "q"), lags=15)
    for one, other in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("broken", [False, True], ids=["whole", "gaps"])
def test_white_noise_is_called_coloured_as_often_as_the_level_says(key, broken):
    """2,000 draws at 5 %: 99.9 % of right tests alarm in 3.5 to 6.7 % of them."""
    a, b = jax.random.split(key)
    v = jax.random.normal(a, (DRAWS, 2, 200, 1))
    mask = jax.random.bernoulli(b, 0.8, v.shape) if broken else whole(v)
    p = eqx.filter_jit(jax.vmap(lambda v, mask: ljung_box(v, mask, 10).p_value[0]))(v, mask)
    low, high = band(0.05, DRAWS)
    assert low <= int(jnp.sum(p < 0.05)) <= high, f"{float(jnp.mean(p < 0.05)):.4f}"


def test_each_correlation_lies_in_its_band_as_often_as_it_says(key):
    """A white residual, a strongly coloured signal, 2,000 draws: 95 % at each of three lags,
    Bonferroni over them.
    """
    a, b = jax.random.split(key)
    v, s = jax.random.normal(a, (DRAWS, 1, 400, 1)), ar1(b, (DRAWS, 1, 400, 1), 0.95)
    r, width = eqx.filter_jit(jax.vmap(lambda v, s: cross_correlation(v, whole(v), s, 10)))(v, s)
    inside = jnp.sum(jnp.abs(r) <= width, axis=0)[0, 0, jnp.array([0, 10, 20])]
    low, high = band(0.95, DRAWS, 3)
    assert ((low <= inside) & (inside <= high)).all(), inside / DRAWS


def test_nothing_missing_passes_and_the_bounds_of_false_alarms_hold(key):
    """Both tests at 1 %, two channels, two coloured signals, 1,000 draws, one-sided 99.9 %
    bounds.
    """
    a, b = jax.random.split(key)
    draws = 1000
    v, s = jax.random.normal(a, (draws, 2, 200, 2)), ar1(b, (draws, 2, 200, 2), 0.9)

    def verdicts(v, s):
        found = residual_tests(v, whole(v), {"a": s[..., 0], "b": s[..., 1]}, ("p", "q"))
        return ~jnp.all(found.white), jnp.any(found.follows)

    coloured, follows = eqx.filter_jit(jax.vmap(verdicts))(v, s)
    # The chi-square of Ljung and Box is asymptotic, with a heavier tail at 25 lags: 2 % is allowed
    # for it.
    assert int(jnp.sum(coloured)) <= binom.ppf(0.999, draws, 0.02)
    assert int(jnp.sum(follows)) <= binom.ppf(0.999, draws, 0.01)


def test_coloured_noise_is_found(key):
    """Power: AR(1) with 0.3 over 400 samples is seen at 1 % in nearly every draw."""
    v = ar1(key, (500, 1, 400, 1), 0.3)
    p = eqx.filter_jit(jax.vmap(lambda v: ljung_box(v, whole(v), 10).p_value[0]))(v)
    assert float(jnp.mean(p < 0.01)) > 0.95


def test_the_signal_that_is_followed_is_named_with_its_lag(key):
    a, b, c = jax.random.split(key, 3)
    s, other = ar1(a, (2, 500, 1), 0.7), ar1(b, (2, 500, 1), 0.7)
    v = jax.random.normal(c, (2, 500, 2)).at[..., 1].add(0.6 * jnp.roll(s[..., 0], 3, axis=1))
    found = residual_tests(
        v, whole(v), {"elevator": s[..., 0], "rudder": other[..., 0]}, ("q", "alpha")
    )
    np.testing.assert_array_equal(found.white, [True, False])
    np.testing.assert_array_equal(found.follows, [[False, False], [True, False]])
    assert int(found.cross_lag[1, 0]) == 3
    assert not bool(found.passed)
    table = str(found).splitlines()
    assert table[1].startswith("q ")
    assert table[1].split()[-2:] == ["yes", "-"]
    assert "elevator (+0." in table[2]
    assert ", 3)" in table[2]
    assert "rudder" not in str(found)


def test_of_several_certain_signals_the_strongest_is_named(key):
    """The p-values of both are zero in floating point."""
    a, b, c = jax.random.split(key, 3)
    cause, other = jax.random.normal(a, (1, 8000)), jax.random.normal(b, (1, 8000))
    proxy = cause + other
    v = (2.0 * cause + (cause**2 - 1.0) + 0.1 * jax.random.normal(c, cause.shape))[..., None]
    report = analyse_residual(v, whole(v), {"proxy": proxy, "cause": cause}, ("q",))
    np.testing.assert_array_equal(report.tests.cross_p, 0.0)
    assert report.strongest_correlation("q").signal == "cause"
    assert report.nonlinear_dependence("q") == ("cause", 0.0)


def test_colour_alone_is_not_taken_for_a_signal(key):
    """Coloured residual and signal, independent: Bartlett's variance keeps the alarms below 5 % at
    a level of 1 %.
    """
    a, b = jax.random.split(key)
    v, s = ar1(a, (500, 1, 500, 1), 0.8), ar1(b, (500, 1, 500, 1), 0.8)
    verdict = eqx.filter_jit(
        jax.vmap(lambda v, s: residual_tests(v, whole(v), {"s": s[..., 0]}, ("q",)).follows[0, 0])
    )
    assert float(jnp.mean(verdict(v, s))) < 0.05
    r, width = jax.vmap(lambda v, s: cross_correlation(v, whole(v), s, 1))(v, s)
    # the band for white residuals would have failed
    assert float(jnp.mean(jnp.abs(r) > width)) > 0.2


def test_a_residual_with_a_mean_is_not_white(key):
    v = 0.5 + jax.random.normal(key, (1, 400, 1))
    assert float(ljung_box(v, whole(v), 10).p_value[0]) < 1e-6


def test_without_signals_and_with_a_silent_channel():
    v = jnp.zeros((1, 30, 1))
    found = residual_tests(v, whole(v), {}, ("q",))
    assert bool(found.passed)
    assert found.cross_p.shape == (1, 0)
    assert "q" in str(found)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"outputs": ("p", "q")}, "2 names"),
        ({"level": 0.0}, "level is 0.0"),
        ({"lags": 0}, "lags is 0"),
    ],
)
def test_bad_options_are_refused(change, words):
    v = jnp.zeros((1, 30, 1))
    options = {"outputs": ("q",)} | change
    with pytest.raises(InputError, match=words):
        residual_tests(v, whole(v), {}, **options)


@pytest.mark.parametrize(
    ("given", "shape"),
    [(np.zeros((30, 1)), r"\(30, 1\)"), ([[0.0], [1.0]], r"\(2, 1\)"), (0.0, r"\(\)")],
)
def test_residuals_that_are_no_stack_are_refused(given, shape):
    """In the tests an annotation of `residual_tests` would refuse them before."""
    words = rf"residuals have the shape {shape} and `mask` {shape}.*record, sample, output"
    with pytest.raises(InputError, match=words):
        residuals._channels(given, np.ones(np.shape(given), bool), ("q",))


def test_residual_with_a_sample_that_is_no_number_does_not_pass(key):
    v = jax.random.normal(key, (1, 400, 2))
    tests = residual_tests(v.at[0, 7, 0].set(jnp.nan), whole(v), outputs=("x", "y"))
    np.testing.assert_array_equal(tests.white, [False, True])
    assert not tests.passed


def test_channel_without_a_sample_has_no_verdict(key):
    v = jax.random.normal(key, (1, 400, 2))
    tests = residual_tests(v, whole(v).at[..., 1].set(False), outputs=("x", "dead"))
    (line,) = [line for line in str(tests).splitlines() if line.startswith("dead")]
    assert line.split() == ["dead", "-", "-", "-", "no", "signals", "were", "given"]
