"""Buffet: zero below its onset, its intensity at full buffet, noise of the requested band."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft import Buffet, buffet_noise

T = 0.02 * jnp.arange(256)
DRAWS = 1500


@pytest.fixture(scope="module")
def noise():
    keys = jax.random.split(jax.random.key(1974), DRAWS)
    return np.asarray(jax.jit(jax.vmap(lambda key: buffet_noise(key, T, 10.0)))(keys))


def test_buffet_has_onset_and_full_intensity(noise):
    buffet = Buffet(onset=0.2, full=0.4, intensity=0.05)
    share = jax.jit(lambda alpha: buffet.coefficient({"alpha": alpha, "buffet": jnp.ones(())}))
    np.testing.assert_allclose(
        [share(alpha) for alpha in (-1.0, 0.2, 0.3, 0.4, 1.5)],
        [0, 0, 0.025, 0.05, 0.05],
        atol=1e-16,
    )
    assert jax.grad(share)(0.2) == 0.0  # it sets in without a corner
    np.testing.assert_allclose(jax.grad(share)(0.3), 0.05 * 1.5 / 0.2, rtol=1e-12)
    assert Buffet().coefficient({"alpha": jnp.array(1.0), "buffet": jnp.array(3.0)}) == 0.0
    full = jax.vmap(lambda n: buffet.coefficient({"alpha": jnp.array(0.5), "buffet": n}))(
        jnp.asarray(noise[:, 100])
    )
    # The variance of 1500 draws is chi-squared within 12 % with 99.9 % probability, so its root
    # within 6 %.
    np.testing.assert_allclose(np.sqrt(np.mean(full**2)), 0.05, rtol=0.06)


def test_noise_is_white_up_to_its_bandwidth(noise):
    power = noise[:, ::64] ** 2
    error = (power.mean(axis=0) - 1.0) / (power.std(axis=0) / DRAWS**0.5)
    assert (np.abs(error) < 3.7).all(), error  # 99.9 % for the largest of four normal numbers
    spectrum = np.mean(np.abs(np.fft.rfft(noise * np.hanning(T.size), axis=1)) ** 2, axis=0)
    spectrum *= 2 * 0.02 / np.sum(np.hanning(T.size) ** 2)
    f = np.fft.rfftfreq(T.size, 0.02)
    # three bins off the edges, as the window is two wide
    inside, outside = (f > 0.6) & (f < 9.4), f > 10.6
    # One-sided density 1/10 per Hz. A mean of 1500 periodograms scatters by 2.6 %, the largest of
    # 45 by 4.2 times that.
    np.testing.assert_allclose(spectrum[inside], 0.1, rtol=0.11)
    assert (spectrum[outside] < 1e-4).all()


def test_noise_depends_on_key(key):
    one, two = jax.random.split(key)
    np.testing.assert_array_equal(buffet_noise(one, T, 5.0), buffet_noise(one, T, 5.0))
    assert not np.any(buffet_noise(one, T, 5.0) == buffet_noise(two, T, 5.0))


def test_invalid_arguments_raise_error(key):
    with pytest.raises(InputError, match=r"intensity is -0\.1.*zero or more"):
        Buffet(intensity=-0.1)
    with pytest.raises(InputError, match=r"`full` less `onset`.*above onset"):
        Buffet(onset=0.3, full=0.3)
    with pytest.raises(InputError, match=r"no signal 'buffet'"):
        Buffet().coefficient({"alpha": jnp.zeros(())})
    with pytest.raises(InputError, match=r"bandwidth is 0\.0 Hz.*positive"):
        buffet_noise(key, T, 0.0)
    with pytest.raises(InputError, match=r"bandwidth times sample time is 0\.6.*twice as fast"):
        buffet_noise(key, T, 30.0)
    with pytest.raises(InputError, match=r"0 sinusoids"):
        buffet_noise(key, T, 5.0, count=0)
