"""Test signals: values at and between the edges, spectra, orthogonality."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import chirp

from jaxid._foundation.checks import InputError
from jaxid.data import (
    doublet,
    full_sine,
    half_sine,
    linear_sweep,
    log_sweep,
    multisine,
    pulses,
    ramp,
    sine,
    step,
    three_two_one_one,
)

T = jnp.arange(0.0, 10.0, 0.5)


def test_steps_and_pulses_change_at_their_edges():
    t = jnp.array([-1.0, 0.999, 1.0, 1.999, 2.0, 2.999, 3.0, 9.0])
    np.testing.assert_array_equal(step(t, 1.0, 2.0), [0, 0, 2, 2, 2, 2, 2, 2])
    np.testing.assert_array_equal(doublet(t, 1.0, 1.0, 2.0), [0, 0, 2, 2, -2, -2, 0, 0])
    np.testing.assert_array_equal(pulses(t, [1.0, 3.0], [5.0]), [0, 0, 5, 5, 5, 5, 0, 0])
    np.testing.assert_array_equal(
        three_two_one_one(jnp.arange(9.0) - 0.5, 0.0, 1.0, 3.0), [0, 3, 3, 3, -3, -3, 3, -3, 0]
    )
    with pytest.raises(InputError, match=r"2 edges and 2 levels.*one edge more"):
        pulses(t, [1.0, 2.0], [1.0, 1.0])


def test_smooth_signals_have_known_values():
    np.testing.assert_allclose(ramp(jnp.array([0.0, 1.0, 2.0, 3.0, 9.0]), 1, 3, 4), [0, 0, 2, 4, 4])
    np.testing.assert_allclose(
        half_sine(jnp.array([0.0, 1.0, 1.5, 2.0, 3.0, 5.0]), 1, 2, 2),
        [0, 0, 2**0.5, 2, 0, 0],
        atol=1e-15,
    )
    np.testing.assert_allclose(
        full_sine(jnp.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), 1, 4, 2),
        [0, 0, 2, 0, -2, 0, 0],
        atol=1e-15,
    )
    np.testing.assert_allclose(
        sine(T, 0.25, 2.0, 0.3), 2 * np.sin(np.pi / 2 * np.asarray(T) + 0.3), rtol=1e-14
    )


@pytest.mark.parametrize(
    ("sweep", "method"), [(linear_sweep, "linear"), (log_sweep, "logarithmic")]
)
def test_sweeps_agree_with_scipy(sweep, method):
    t = np.linspace(0, 20, 777)
    expected = 3 * chirp(t, 0.1, 20, 2.0, method=method, phi=-90)
    np.testing.assert_allclose(sweep(jnp.asarray(t), 20.0, 0.1, 2.0, 3.0), expected, atol=1e-11)
    np.testing.assert_array_equal(sweep(jnp.array([-1.0, 20.5]), 20.0, 0.1, 2.0), [0, 0])


def test_doublet_has_largest_power_at_documented_frequency():
    n, dt = 2**16, 0.01
    power = np.abs(np.fft.rfft(doublet(jnp.arange(n) * dt, 1.0, 2.0)))
    np.testing.assert_allclose(np.argmax(power) / (n * dt), 0.37 / 2.0, rtol=0.01)


def test_three_two_one_one_has_documented_mean():
    u = three_two_one_one(jnp.arange(0.0, 7.0, 0.01) + 0.005, 0.0, 1.0, 2.0)
    np.testing.assert_allclose(u.mean(), 2 / 7, rtol=1e-12)


def test_multisines_are_orthogonal_with_flat_spectrum_and_low_peak():
    period, dt, count = 20.0, 0.01, 3
    t = jnp.arange(0.0, period, dt)
    u = np.asarray(multisine(t, period, 0.1, 3.0, count=count, amplitude=2.0))
    assert u.shape == (len(t), count)
    gram = u.T @ u / len(t)
    np.testing.assert_allclose(gram, 2.0 * np.eye(count), atol=1e-12)
    spectrum = np.abs(np.fft.rfft(u, axis=0)) / len(t) * 2
    lines = [set(np.flatnonzero(spectrum[:, j] > 1e-9)) for j in range(count)]
    assert set.union(*lines) == set(range(2, 61))
    assert sum(map(len, lines)) == 59
    peak_factors = np.abs(u).max(axis=0) / np.sqrt((u**2).mean(axis=0))
    assert (peak_factors < 2.0).all()  # cosines in phase reach sqrt(2 K) = 6.3


def test_multisine_with_fewer_harmonics_than_inputs_is_refused():
    with pytest.raises(InputError, match=r"2 harmonics for 3 inputs.*Lengthen"):
        multisine(T, 10.0, 0.1, 0.2, count=3)


@pytest.mark.parametrize(
    "signal",
    [
        step,
        doublet,
        three_two_one_one,
        ramp,
        half_sine,
        full_sine,
        lambda t: sine(t, 0.3),
        lambda t: linear_sweep(t, 9.0, 0.1, 1.0),
        lambda t: log_sweep(t, 9.0, 0.1, 1.0),
        lambda t: multisine(t, 10.0, 0.1, 1.0)[..., 0],
    ],
)
def test_signals_are_pure_functions_of_time(signal):
    expected = signal(T)
    assert expected.shape == T.shape
    np.testing.assert_allclose(jax.jit(signal)(T), expected, atol=1e-14)
    np.testing.assert_allclose(jax.vmap(signal)(T), expected, atol=1e-14)
    np.testing.assert_allclose(signal(T.reshape(4, 5)), expected.reshape(4, 5), atol=1e-14)


def test_signals_accept_traced_amplitude_and_edges():
    slope = jax.grad(lambda a: half_sine(jnp.array([1.0]), 0.0, 2.0, a).sum())(jnp.array(3.0))
    np.testing.assert_allclose(slope, 1.0, rtol=1e-14)
    np.testing.assert_array_equal(
        jax.jit(lambda w: doublet(T, 1.0, w))(jnp.array(2.0)), doublet(T, 1.0, 2.0)
    )
