"""Variance of weighted sums of a coloured residual: against its exact value, with gaps and without,
and never negative.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.stats import norm

from jaxid.estimation.coloured import score_covariance, tapered_covariance

DRAWS, ROWS, RHO = 2000, 600, 0.8
compiled_covariance = jax.jit(score_covariance)


@pytest.fixture(scope="module")
def noise():
    """Autoregressive noise of variance one, shape (draw, time)."""
    e = jax.random.normal(jax.random.key(1974), (DRAWS, ROWS))
    L = np.linalg.cholesky(toeplitz(RHO ** np.arange(ROWS)))
    return e @ L.T


def columns():
    """Two slow weights, as sensitivities are: shape (time, parameter)."""
    t = np.arange(ROWS) / ROWS
    return np.stack([np.sin(2 * np.pi * 4 * t), np.sign(np.sin(2 * np.pi * 7 * t))], axis=-1)


def sums_and_variances(noise, mask):
    """Of every draw: the sums `sum_i s_i v_i` over valid samples, their estimated variances, and
    the mean exact ones.
    """
    S = jnp.asarray(columns())[None, :, None]

    def one(v, m):
        s = jnp.where(m[None, :, None, None], S, 0.0)
        v, m = jnp.where(m, v, 0.0)[None, :, None], m[None, :, None]
        return jnp.einsum("ctop,cto->p", s, v), jnp.diagonal(score_covariance(s, v, m))

    exact = 0.0
    for m in np.asarray(mask[:20]):
        s = columns() * m[:, None]
        exact = exact + np.einsum("ip,ij,jp->p", s, toeplitz(RHO ** np.arange(ROWS)), s) / 20
    return *jax.jit(jax.vmap(one))(noise, mask), exact


def test_variance_with_gaps_is_exact_and_covers_as_without_gaps(noise):
    """30 % random gaps. The mean ratio is known to 1 %; lags divided by samples instead of pairs
    give 0.76.
    """
    complete = jnp.ones((DRAWS, ROWS), bool)
    valid = jax.random.uniform(jax.random.key(30), (DRAWS, ROWS)) >= 0.3
    covered = []
    for mask in (complete, valid):
        sums, variances, exact = sums_and_variances(noise, mask)
        np.testing.assert_allclose(np.mean(variances, axis=0) / exact, 1.0, atol=0.03)
        covered.append(np.mean(np.abs(sums) < norm.isf(0.025) * np.sqrt(variances), axis=0))
    # The band holds the difference of two equal shares of 2,000 draws with 99.9 % probability for
    # both columns together.
    half_width = norm.isf(0.0005 / 2) * np.sqrt(2 * covered[0] * (1 - covered[0]) / DRAWS)
    assert (np.abs(covered[1] - covered[0]) < half_width).all(), covered


def test_residual_of_exactly_zero_counts_as_sample():
    """A quantised residual: every second one zero, the rest of size one. Its variance is one
    half.
    """
    v = jnp.asarray(np.where(np.arange(400) % 2, 0.0, np.where(np.arange(400) % 4, 1.0, -1.0)))[
        None, :, None
    ]
    mask = jnp.ones(v.shape, bool)
    covariance = np.asarray(jax.jit(tapered_covariance)(v, mask))
    assert (np.fft.fft(covariance, axis=0).real >= -1e-12).all()
    np.testing.assert_allclose(covariance[0, 0], 0.5, rtol=0.05)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_variance_of_narrow_band_residual_is_not_negative(seed, share):
    """A residual of one frequency, whose spectrum is zero nearly everywhere, seen at random
    samples.
    """
    draw = np.random.default_rng(seed)
    mask = draw.uniform(size=(1, 300, 1)) >= share
    v = np.where(mask, np.sin(0.7 * np.arange(300))[None, :, None], 0.0)
    S = np.where(mask[..., None], draw.normal(size=(1, 300, 1, 5)), 0.0)
    values = np.linalg.eigvalsh(np.asarray(compiled_covariance(S, v, mask)))
    assert values[0] >= -1e-12 * values[-1]


def test_padding_of_shorter_record_changes_nothing(noise):
    v = jnp.asarray(noise[0])[None, :, None]
    mask = jnp.ones(v.shape, bool)
    longer = ((0, 0), (0, 250), (0, 0))
    S = jnp.asarray(columns())[None, :, None]
    padded = compiled_covariance(
        np.pad(S, (*longer, (0, 0))), np.pad(v, longer), np.pad(mask, longer)
    )
    np.testing.assert_allclose(padded, compiled_covariance(S, v, mask), rtol=0.02)
