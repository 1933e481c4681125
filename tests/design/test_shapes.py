"""Shapes of parametrised inputs."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.design.shapes import multisine

T = jnp.linspace(0.0, 10.0, 101)


def test_multisine_without_fade_begins_and_ends_at_full_size():
    basis = np.asarray(multisine(T, 0.1, 0.5, fade=0.0).basis)
    angle = 2.0 * np.pi * 0.1 * np.arange(1, 6) * np.asarray(T)[:, None]
    # rounding of angles up to 31
    np.testing.assert_allclose(basis, np.c_[np.cos(angle), np.sin(angle)], rtol=0, atol=1e-13)
    faded = np.asarray(multisine(T, 0.1, 0.5, fade=0.1).basis)
    np.testing.assert_array_equal(faded[[0, -1]], 0.0)
    np.testing.assert_allclose(faded[5], 0.5 * basis[5], rtol=0, atol=1e-13)
    np.testing.assert_array_equal(faded[11:90], basis[11:90])


@pytest.mark.parametrize("fade", [-0.1, 0.6, float("nan")])
def test_multisine_with_fade_that_is_no_share_of_one_end_is_refused(fade):
    with pytest.raises(InputError, match=r"`fade` is .*from 0 to 0\.5"):
        multisine(T, 0.1, 0.5, fade=fade)
