"""Fit statistics against their definitions in NumPy, and against cases whose answer is known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.diagnosis.statistics import statistics

NAMES = ("alpha", "q")


@pytest.fixture
def data(key):
    a, b, c = jax.random.split(key, 3)
    y = jax.random.normal(a, (3, 50, 2)) * jnp.array([[[1.0, 5.0]]]) + jnp.array([[[0.3, -2.0]]])
    z = 1.1 * y + 0.2 + 0.5 * jax.random.normal(b, y.shape)
    mask = jax.random.bernoulli(c, 0.8, y.shape)
    return jnp.where(mask, z, jnp.nan), y, mask


def test_numpy_gives_the_same(data):
    z, y, mask = data
    R = jnp.array([[0.25, 0.1], [0.1, 4.0]])
    found = statistics(z, y, mask, outputs=NAMES, noise=R, skip=4)
    for j in range(2):
        kept = np.asarray(mask)[:, 4:, j]
        Z, Y = np.asarray(z)[:, 4:, j][kept], np.asarray(y)[:, 4:, j][kept]
        V = Z - Y
        expected = {
            "count": kept.sum(),
            "rms": np.sqrt(np.mean(V**2)),
            "max_abs": np.abs(V).max(),
            "r_squared": 1 - np.sum(V**2) / np.sum((Z - Z.mean()) ** 2),
            "theil": np.sqrt(np.mean(V**2)) / (np.sqrt(np.mean(Z**2)) + np.sqrt(np.mean(Y**2))),
            "bias": (Z.mean() - Y.mean()) ** 2 / np.mean(V**2),
            "variance": (Z.std() - Y.std()) ** 2 / np.mean(V**2),
            "covariance": 2 * (1 - np.corrcoef(Z, Y)[0, 1]) * Z.std() * Y.std() / np.mean(V**2),
            "normalised": np.sqrt(np.mean(V**2)) / [0.5, 2.0][j],
        }
        for name, value in expected.items():
            np.testing.assert_allclose(getattr(found, name)[j], value, rtol=1e-10, err_msg=name)


def test_the_shares_add_up_to_one(data):
    found = statistics(*data, outputs=NAMES)
    np.testing.assert_allclose(found.bias + found.variance + found.covariance, 1.0, rtol=1e-10)
    assert jnp.isnan(found.normalised).all()


def test_each_share_is_what_it_is_named_after(key):
    z = jax.random.normal(key, (1, 200, 1))
    z, mask = z - jnp.mean(z), jnp.ones(z.shape, bool)
    shifted, stretched = (statistics(z, y, mask, outputs=("q",)) for y in (z + 0.3, 1.4 * z))
    noisy = statistics(z, jnp.flip(z, axis=1), mask, outputs=("q",))
    np.testing.assert_allclose(shifted.bias, 1.0, rtol=1e-10)
    np.testing.assert_allclose(stretched.variance, 1.0, rtol=1e-10)
    np.testing.assert_allclose(noisy.covariance, 1.0, rtol=1e-10)
    opposite = statistics(z, -z, mask, outputs=("q",))
    np.testing.assert_allclose(opposite.theil, 1.0, rtol=1e-12)  # the worst there is
    np.testing.assert_allclose(opposite.r_squared, -3.0, rtol=1e-12)


def test_padding_changes_nothing(data):
    z, y, mask = data
    pad = ((0, 0), (0, 13), (0, 0))
    ours = statistics(z, y, mask, outputs=NAMES)
    theirs = statistics(
        jnp.pad(z, pad), jnp.pad(y, pad, mode="edge"), jnp.pad(mask, pad), outputs=NAMES
    )
    for one, other in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)


@pytest.mark.parametrize("level", [1.0, 0.1, 9.81])
def test_a_constant_channel_has_no_coefficient_of_determination(level):
    """The mean of equal numbers is rounded."""
    z, mask = jnp.full((1, 1000, 1), level), jnp.ones((1, 1000, 1), bool)
    found = statistics(z, z + 0.1, mask, outputs=("q",))
    assert jnp.isnan(found.r_squared[0])
    np.testing.assert_allclose(found.rms, 0.1)


def test_the_table_names_channels_and_units(data):
    table = str(statistics(*data, outputs=NAMES, units=("rad", "rad/s"))).splitlines()
    assert [line.split()[0] for line in table] == ["output", *NAMES]
    assert table[1].endswith(" rad")
    assert table[2].endswith(" rad/s")
    assert "Theil U" in table[0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"outputs": ("q",)}, "1 names"),
        ({"units": ("rad",)}, "1 units"),
        ({"skip": 50}, "skip is 50"),
    ],
)
def test_bad_options_are_refused(data, change, words):
    options = {"outputs": NAMES} | change
    with pytest.raises(InputError, match=words):
        statistics(*data, **options)
