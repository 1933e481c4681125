"""The autoregressive process of a residual, and its loss of power, against dense matrices."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from jaxid.estimation.coloured_errors import (
    ScoreSpectrum,
    _levinson,
    _loss,
    _pairs,
    _powers,
    burg,
    coloured_variances,
)
from jaxid.estimation.estimate import _robust_own
from jaxid.sensitivity.information import gather, record_triangles

ROWS = 300
found_by = jax.jit(burg, static_argnums=2)


def process(seed, coefficients, rows, share=0.0):
    """Two records of a process and its mask: shape (case, time, output)."""
    rng = np.random.default_rng(seed)
    v = lfilter([1.0], np.append(1.0, -np.asarray(coefficients)), rng.normal(size=(2, rows + 300)))
    mask = rng.uniform(size=(2, rows, 1)) >= share
    return jnp.asarray(np.where(mask, v[:, 300:, None], 0.0)), jnp.asarray(mask)


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_order_and_coefficients_of_process_are_found(seed, share):
    """20,000 samples; with 30 % missing a third of the windows is left, the error 1 %."""
    v, mask = process(seed, [1.6, -0.8], 10_000, share)
    found = found_by(v, mask, 2)
    assert int(found.order[0]) == 2
    np.testing.assert_allclose(found.coefficients[:2, 0], [1.6, -0.8], atol=0.04)
    np.testing.assert_allclose(found.variance[0], 1.0, rtol=0.06)
    np.testing.assert_array_equal(found.coefficients[2:], 0.0)
    assert int(found_by(*process(seed, [], 10_000, share), 2).order[0]) == 0


def test_process_does_not_depend_on_records_at_a_time(seed):
    """The reflection coefficients are pooled over all records."""
    v, mask = process(seed, [1.6, -0.8], 500, 0.1)
    for one, other in zip(found_by(v, mask, 1), found_by(v, mask, 2), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("priors", [(0.0, 0.0), (1.0, 3.0)])
def test_loss_of_power_equals_dense_trace(priors):
    """`tr J_k (2 Gamma H - H Gamma H - S C T C S')` of an AR(1) process with 0.8: both ends of the
    record are left out of the first term, 1 % here.
    """
    t = np.arange(ROWS)
    columns = np.linalg.qr(np.stack([np.sin(0.05 * t), np.exp(-t / 40), t / ROWS], -1))[0]
    # Column 0 belongs to the record, the others are shared and have priors.
    T = np.diag([0.0, *priors])
    half = np.linalg.inv(np.sqrt(np.eye(3) + T))
    F = jnp.fft.rfft(jnp.asarray(columns @ half)[None, :, None], 2 * ROWS, axis=1)
    of_priors = jnp.zeros(2), jnp.asarray((half @ T @ half)[1:, 1:])
    score = ScoreSpectrum(jnp.zeros((ROWS + 1, 1, 2)), F, 1, *of_priors)
    frequency = np.pi * np.arange(ROWS + 1) / ROWS
    density = 0.36 / np.abs(1 - 0.8 * np.exp(-1j * frequency)) ** 2
    mask = jnp.ones((1, ROWS, 1), bool)
    loss = jax.jit(lambda density: _loss(score, _powers(score), density, _pairs(mask)))(
        jnp.asarray(density)[:, None]
    )
    Gamma, C = toeplitz(0.8**t), half @ half
    H = columns @ C @ columns.T
    missing = Gamma @ H + H @ Gamma - H @ Gamma @ H - columns @ C @ T @ C @ columns.T
    for lag in (0, 1, 5):
        expected = np.trace(missing, offset=lag) / (ROWS - lag)
        np.testing.assert_allclose(loss[lag, 0], expected, rtol=0.03)


def test_degrees_of_freedom_equal_scatter_of_variance():
    """1,000 draws of 400 samples, AR(1) with 0.6: the scatter of the estimated variance."""
    rows, draws = 400, 1000
    e = np.random.default_rng(1974).normal(size=(draws, rows + 100))
    v = jnp.asarray(lfilter([1.0], [1.0, -0.6], e, axis=1)[:, 100:])[:, None, :, None]
    column = jnp.asarray(np.sin(0.02 * np.arange(rows)))[None, :, None, None]
    power = jnp.sum(jnp.abs(jnp.fft.rfft(column, 2 * rows, axis=1)) ** 2, axis=0)
    mask = jnp.ones((1, rows, 1), bool)
    score = ScoreSpectrum(power, None, 0, jnp.zeros(1), jnp.zeros((1, 1)))
    run = jax.jit(jax.vmap(lambda v: coloured_variances(score, v, mask, 1)))
    variance, dof, _ = run(v)
    scatter = np.std(variance[:, 0]) / np.mean(variance[:, 0])
    np.testing.assert_allclose(np.sqrt(2 / np.median(dof)), scatter, rtol=0.12)
    column = np.asarray(column)[0, :, 0, 0]
    exact = column @ toeplitz(0.6 ** np.arange(rows)) @ column / (1 - 0.36)
    np.testing.assert_allclose(np.mean(variance), exact, rtol=0.04)


def test_recursion_solves_yule_walker(seed):
    """Order 2 from five lags of the autocovariance, against a dense solution."""
    v, mask = process(seed, [1.6, -0.8], 2000)
    given = found_by(v, mask, 2)
    c = np.asarray(given.autocovariance[:, 0]) * (1 + 0.01 * 0.5 ** np.arange(11))
    solved = jax.jit(_levinson)(given, jnp.asarray(c)[:, None])
    order = int(given.order[0])
    expected = np.linalg.solve(toeplitz(c[:order]), c[1 : order + 1])
    np.testing.assert_allclose(solved.coefficients[:order, 0], expected, rtol=1e-7)
    np.testing.assert_allclose(solved.variance[0], c[0] - expected @ c[1 : order + 1], rtol=1e-7)


def test_own_covariances_equal_dense_least_squares(seed):
    """Two records with two unknowns of their own and three in common, under a known process."""
    rng, rows = np.random.default_rng(seed), 40
    own, shared = rng.normal(size=(2, rows, 1, 2)), rng.normal(size=(2, rows, 1, 3))
    triangles = record_triangles(*map(jnp.asarray, (own, shared, np.zeros((2, rows, 1)))))
    nothing = jnp.zeros((2, 2), bool), jnp.zeros(3, bool)
    information = gather(triangles, jnp.zeros((0, 4)), *nothing)
    half = np.linalg.inv(np.asarray(information.triangle)[:3])
    block = information.own
    local = np.einsum("ctjo,cok->ctk", own, block.inverse)
    rest = shared - np.einsum("ctjo,cok,ckp->ctjp", own, block.inverse, block.coupling)
    columns = np.concatenate([local, rest[:, :, 0] @ half], axis=-1)
    Gamma = toeplitz(0.8 ** np.arange(rows))
    products = np.einsum("ctp,ts,csq->cpq", columns, Gamma, columns)
    products[:, 2:, 2:] = products[:, 2:, 2:].sum(axis=0)
    found = _robust_own(block, jnp.asarray(half), jnp.asarray(products), 0.0)
    A = np.zeros((2 * rows, 7))
    A[:rows, :2], A[rows:, 2:4], A[:, 4:] = own[0, :, 0], own[1, :, 0], shared.reshape(-1, 3)
    weights = np.linalg.pinv(A)
    dense = weights @ np.kron(np.eye(2), Gamma) @ weights.T
    for case, at in enumerate(([0, 1], [2, 3])):
        expected = dense[np.ix_(at, [*at, 4, 5, 6])]
        np.testing.assert_allclose(found[case], expected, rtol=1e-9, atol=1e-12)
