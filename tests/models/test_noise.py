"""Whitening of independent channels, and the rows by which an estimated R changes the curvature."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.models.noise import DiagonalNoise, Division, FixedNoise

CASES, SAMPLES, OUTPUTS, COLUMNS = 2, 7, 3, 4


def rows_with_gaps():
    rng = np.random.default_rng(3)
    v = rng.normal(size=(CASES, SAMPLES, OUTPUTS)) * [0.1, 1.0, 10.0]
    S = rng.normal(size=(CASES, SAMPLES, OUTPUTS, COLUMNS))
    mask = rng.random(v.shape) < 0.8
    v[~mask], S[~mask] = np.nan, np.nan
    return jnp.asarray(v), jnp.asarray(S), jnp.asarray(mask)


def test_diagonal_noise_whitens_as_its_cholesky_factor_does():
    v, S, mask = rows_with_gaps()
    noise = DiagonalNoise()
    ours, factor = noise.whitening(v, mask), Division(noise.cholesky(v, mask))
    for rows in (v, S):
        np.testing.assert_allclose(ours(rows, mask), factor(rows, mask), rtol=1e-14)


def test_rows_of_the_profile_are_products_of_sensitivities_and_residuals():
    v, S, mask = rows_with_gaps()
    white_v, white_S = (np.where(np.isnan(rows), 0.0, rows) for rows in (v, S))
    ours = DiagonalNoise().profile_rows(jnp.asarray(white_S), jnp.asarray(white_v), mask)
    for case in range(CASES):
        for channel in range(OUTPUTS):
            expected = white_v[case, :, channel] @ white_S[case, :, channel]
            np.testing.assert_allclose(ours[case, channel], expected, rtol=1e-12)


def test_given_covariance_that_is_not_symmetric_is_refused():
    mask = np.ones((1, 5, 2), bool)
    R = np.array([[1e-6, 0.5e-3], [0.5e-3, 1.0]])
    # rounding of a covariance of 5e-4
    FixedNoise(R + np.array([[0.0, 1e-18], [0.0, 0.0]])).check(mask, ("a", "b"))
    R[1, 0] = 0.0
    with pytest.raises(InputError, match=r"of 'a' and 'b' is 0\.0005 in row 0 and 0 in row 1"):
        FixedNoise(R).check(mask, ("a", "b"))
