"""Errors of instruments on a signal: lag, delay, range; statistics of noise, quantisation and
dropout.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jaxid.aircraft.instruments.instruments import Instruments
from jaxid.effects import SensorDelay, SensorLag

T = 0.05 * jnp.arange(120)
SIGNAL = jnp.stack([jnp.sin(2.0 * T), jnp.cos(1.3 * T) + 0.5 * T], axis=1)
SAMPLES, STEP = 20_000, 0.02
LONG = STEP * jnp.arange(SAMPLES)
SURE = 0.999


def instruments(**errors):
    return Instruments(("alpha", "q"), **errors)


@pytest.fixture(scope="module")
def measured():
    """20,000 samples of instruments at rest with every random error: z, mask."""
    noisy = instruments(
        noise={"q": 0.3},
        coloured_noise={"alpha": 0.02},
        bandwidth={"alpha": 4.0},
        dropout={"alpha": 0.05},
        quantum={"q": 0.01},
    )
    z, mask = eqx.filter_jit(lambda i, key: i.measure(key, LONG, jnp.zeros((SAMPLES, 2))))(
        noisy, jax.random.key(1974)
    )
    return np.array(z), np.array(mask)


# Observe ----------------------------------------------------------------------


def test_perfect_instruments_leave_signal_unchanged(key):
    perfect = instruments()
    assert perfect.observe(T, SIGNAL) is SIGNAL  # not even computed
    z, mask = perfect.measure(key, T, SIGNAL)
    np.testing.assert_array_equal(z, SIGNAL)
    assert mask.all()


def test_lag_and_delay_equal_sensor_effects_on_their_channel():
    observed = instruments(lag={"q": 0.1}, delay={"q": 0.03, "alpha": 0.07}).observe(T, SIGNAL)
    lagged = SensorLag("q", jnp.array(0.1)).observe(T, SIGNAL, ("alpha", "q"))
    want = SensorDelay("q", jnp.array(0.03)).observe(T, lagged, ("alpha", "q"))
    want = SensorDelay("alpha", jnp.array(0.07)).observe(T, want, ("alpha", "q"))
    np.testing.assert_allclose(observed, want, rtol=0, atol=1e-15)


def test_delayed_and_lagged_ramp_is_exact():
    ramp = jnp.stack([T, 3.0 * T], axis=1)
    observed = instruments(lag={"alpha": 0.2}, delay={"q": 0.1}).observe(T, ramp)
    np.testing.assert_allclose(observed[:, 0], T - 0.2 * (1 - np.exp(-T / 0.2)), rtol=0, atol=1e-14)
    np.testing.assert_allclose(observed[2:, 1], 3.0 * T[:-2], rtol=0, atol=1e-13)


def test_saturated_channel_stays_in_range_and_has_derivative():
    limited = instruments(upper={"q": 0.9}, lower={"q": -0.2, "alpha": -0.4})
    observed = limited.observe(T, SIGNAL)
    np.testing.assert_array_equal(observed[:, 1], np.clip(SIGNAL[:, 1], -0.2, 0.9))
    np.testing.assert_array_equal(observed[:, 0], np.maximum(SIGNAL[:, 0], -0.4))

    def of_level(level):
        return eqx.tree_at(lambda i: i.upper.values, limited, level[None]).observe(T, SIGNAL)[:, 1]

    np.testing.assert_array_equal(jax.jacfwd(of_level)(jnp.array(0.9)), SIGNAL[:, 1] > 0.9)


def test_sensitivity_to_lag_and_delay_equals_differences():
    def of(theta):
        late = instruments(lag={"q": theta[0]}, delay={"alpha": theta[1]})
        return late.observe(T, SIGNAL)

    theta, h = jnp.array([0.1, 0.033]), 1e-5  # a delay that meets no sample
    compiled = jax.jit(of)
    S = jax.jit(jax.jacfwd(of))(theta)
    for k, e in enumerate(np.eye(2)):
        # h^2 times a third derivative of 1e3 (lag^-3) is 1e-7; rounding 1e-11.
        difference = (compiled(theta + h * e) - compiled(theta - h * e)) / (2 * h)
        np.testing.assert_allclose(S[..., k], difference, rtol=0, atol=1e-6)
        assert np.abs(S[..., k]).max() > 0.5


# Measure ----------------------------------------------------------------------


def test_white_noise_has_its_variance_and_no_autocorrelation(measured):
    z = measured[0][:, 1]
    low, high = stats.chi2.interval(SURE, SAMPLES) / np.array(SAMPLES)
    assert low < np.mean(z**2) / (0.3**2 + 0.01**2 / 12) < high  # rounding adds its own variance
    bound = stats.norm.isf((1 - SURE) / 2 / 5) / np.sqrt(SAMPLES)  # five lags together
    for lag in range(1, 6):
        assert abs(np.mean(z[lag:] * z[:-lag])) / np.mean(z**2) < bound


def test_band_limited_noise_has_its_variance_and_autocorrelation(measured):
    """Each lag within 99.9 %/n by the variance of sample autocovariances of a Gaussian process
    (Bartlett, 1946).
    """
    z, mask = measured[0][:, 0], measured[1][:, 0]
    decay = np.exp(-4.0 * STEP)
    lags = (0, 1, 5, 20)
    for lag in lags:
        both = mask[lag:] & mask[: SAMPLES - lag]
        covariance = np.sum(z[lag:] * z[: SAMPLES - lag]) / both.sum()
        # N var = sum over m of (rho_m^2 + rho_(m+lag) rho_(m-lag)); samples that are lost add at
        # most their share's inverse.
        m = np.arange(-2000, 2001)
        spread = np.sum(decay ** (2 * np.abs(m)) + decay ** (np.abs(m + lag) + np.abs(m - lag)))
        sigma = np.sqrt(spread / both.sum())
        assert (
            abs(covariance / 0.02**2 - decay**lag)
            < stats.norm.isf((1 - SURE) / 2 / len(lags)) * sigma
        )


def test_band_limited_noise_on_uneven_times_is_stationary(key):
    """Over 4,000 draws each sample has the full variance, and two samples are correlated by the
    time between them.
    """
    clock = jnp.array([0.0, 0.3, 0.32, 1.4, 1.4])  # ends in padding
    noisy = instruments(coloured_noise={"q": 2.0}, bandwidth={"q": 1.5})
    keys = jax.random.split(key, 4000)
    n = jax.jit(jax.vmap(lambda k: noisy.measure(k, clock, jnp.zeros((5, 2)))[0][:, 1]))(keys)
    low, high = stats.chi2.interval(1 - (1 - SURE) / 4, 4000) / np.array(4000)
    power = np.mean(np.array(n) ** 2, axis=0)[:4] / 4.0
    assert np.all((low < power) & (power < high))
    correlation = np.corrcoef(np.array(n).T)
    want = np.exp(-1.5 * np.abs(np.subtract.outer(clock, clock)))
    # Fisher's z is normal with deviation 1/sqrt(N - 3); six pairs.
    pairs = np.triu_indices(4, 1)
    bound = stats.norm.isf((1 - SURE) / 2 / 6) / np.sqrt(3997)
    assert np.all(np.abs(np.arctanh(correlation[pairs]) - np.arctanh(want[pairs])) < bound)
    np.testing.assert_array_equal(n[:, 3], n[:, 4])


def test_dropouts_have_their_probability_and_leave_zeros(measured):
    z, mask = measured
    low, high = stats.binom.interval(SURE, SAMPLES, 0.05)
    assert low <= np.sum(~mask[:, 0]) <= high
    assert mask[:, 1].all()
    assert np.all(z[~mask] == 0.0)


def test_quantised_measurements_are_multiples_of_quantum(measured):
    steps = measured[0][:, 1] / 0.01
    # rounding of up to 130 steps
    np.testing.assert_allclose(steps, np.round(steps), rtol=0, atol=1e-11)
    assert len(np.unique(np.round(steps))) > 100


def test_zero_quantum_leaves_signal_unchanged(key):
    z, _ = instruments(quantum={"q": 0.0}).measure(key, T, SIGNAL)
    np.testing.assert_array_equal(z, SIGNAL)


def test_saturated_noisy_channel_stays_in_range_and_repeats_its_limit(key):
    limited = instruments(upper={"q": 0.9}, noise={"q": 0.05})
    z, _ = limited.measure(key, T, limited.observe(T, SIGNAL))
    assert z[:, 1].max() == 0.9
    assert np.sum(np.array(z[:, 1]) == 0.9) > 20


def test_noise_depends_on_key_and_channel(key):
    other = jax.random.key(7)
    both = instruments(noise={"alpha": 0.1, "q": 0.2})
    z, again = (both.measure(key, T, SIGNAL)[0] for _ in range(2))
    np.testing.assert_array_equal(z, again)
    assert np.all(both.measure(other, T, SIGNAL)[0] != z)
    alone = Instruments(("q",), noise={"q": 0.2})
    # The channel's noise does not change when others are not recorded.
    np.testing.assert_array_equal(alone.measure(key, T, SIGNAL[:, 1:])[0][:, 0], z[:, 1])
    assert np.abs(np.corrcoef(np.array(z - SIGNAL).T)[0, 1]) < 0.4  # 120 samples: 0.3 at 99.9 %
