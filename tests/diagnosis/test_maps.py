"""Maps of residuals: calibrated for white and for coloured residuals, and awake where the mean
follows a variable.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import binom

from jaxid._foundation.checks import InputError
from jaxid.diagnosis import residual_maps

CASES, ROWS, DRAWS = 3, 400, 300


def drawn(seed, colour=0.0):
    """Residuals, and a variable of its own that is slow."""
    rng = np.random.default_rng(seed)
    e = rng.normal(size=(CASES, ROWS))
    v = np.zeros_like(e)
    for i in range(ROWS):
        v[:, i] = colour * v[:, i - 1] * (i > 0) + e[:, i]
    s = np.cumsum(rng.normal(size=(CASES, ROWS)), axis=1)
    return jnp.asarray(v[..., None]), jnp.asarray(s - s.mean())


@pytest.mark.parametrize("colour", [0.0, 0.7])
def test_alarms_come_at_their_level(colour):
    """300 draws at 5 %: within what a right test meets with 99.9 % probability, widened at the top
    for the coloured one, whose covariance is estimated from the same residual (a white residual
    taken for granted gives 80 % alarms there)."""
    whole = jnp.ones((CASES, ROWS, 1), bool)
    alarms = 0
    for seed in range(DRAWS):
        v, s = drawn(seed, colour)
        alarms += int(residual_maps(v, whole, {"s": s}, ("y",)).p_value[0, 0] < 0.05)
    low, high = binom.interval(0.999, DRAWS, 0.05)
    assert low <= alarms <= (high if colour == 0.0 else 2 * high)


@pytest.mark.parametrize("variable", [np.arange(ROWS), np.sin(np.arange(ROWS) / 40)])
def test_white_noise_has_no_mean_over_time(variable):
    """The bins of time, and of a slow signal, are pieces of a record in a row: 1,000 draws at 5 %,
    within the upper bound that a right test meets with 99.9 % probability."""
    v = jnp.asarray(np.random.default_rng(5).normal(size=(1000, 1, ROWS, 1)))
    whole, s = jnp.ones((1, ROWS, 1), bool), jnp.asarray(variable * 1.0)[None]
    p = np.array([residual_maps(draw, whole, {"t": s}, ("y",)).p_value[0, 0] for draw in v])
    assert np.sum(p < 0.05) <= binom.ppf(0.999, p.size, 0.05)


def test_a_mean_that_follows_a_variable_is_seen_where_it_is():
    v, s = drawn(1)
    bent = v + 0.5 * jnp.maximum(s - jnp.quantile(s, 0.75), 0.0)[..., None]
    found = residual_maps(bent, jnp.ones(v.shape, bool), {"s": s, "other": s[:, ::-1]}, ("y",))
    assert float(found.p_value[0, 0]) < 1e-6
    level = jnp.abs(found.mean[0, 0]) / found.deviation[0, 0]
    assert jnp.all(level[-2:] > 4.0)
    assert jnp.all(level[:5] < 4.0)
    assert "s " in str(found)


def test_missing_samples_say_nothing():
    v, s = drawn(2)
    mask = jax.random.bernoulli(jax.random.key(0), 0.8, v.shape)
    spoiled = jnp.where(mask, v, 1e6)
    one, other = (residual_maps(x, mask, {"s": s}, ("y",)) for x in (v, spoiled))
    np.testing.assert_allclose(one.mean, other.mean, rtol=1e-12)


def test_samples_without_a_variable_do_not_count_in_its_map():
    """The response depends on the variable; other maps stay as they are."""
    v, s = drawn(4)
    bent, gap = v + 0.5 * (s**2 - jnp.mean(s**2))[..., None] / jnp.var(s), s.at[0, 7].set(jnp.nan)
    whole = jnp.ones(v.shape, bool)
    found = residual_maps(bent, whole, {"gap": gap, "s": s}, ("y",))
    without = residual_maps(bent, whole.at[0, 7].set(False), {"s": s}, ("y",))
    np.testing.assert_allclose(found.p_value[0, 0], without.p_value[0, 0], rtol=1e-9)
    np.testing.assert_allclose(found.mean[0, 0], without.mean[0, 0], rtol=1e-9)
    whole_map = residual_maps(bent, whole, {"s": s}, ("y",))
    np.testing.assert_array_equal(found.mean[0, 1], whole_map.mean[0, 0])


def test_refusals():
    v, s = drawn(3)
    whole = jnp.ones(v.shape, bool)
    with pytest.raises(InputError, match="'s' is not finite at any valid sample"):
        residual_maps(v, whole, {"s": s * np.nan}, ("y",))
    with pytest.raises(InputError, match="1 residual channels and 2 names"):
        residual_maps(v, whole, {"s": s}, ("a", "b"))
    with pytest.raises(InputError, match="no variable"):
        residual_maps(v, whole, {}, ("a",))
    with pytest.raises(InputError, match="two at least"):
        residual_maps(v, whole, {"s": s}, ("a",), bins=1)
