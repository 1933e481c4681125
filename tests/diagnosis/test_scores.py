"""The score test against plain linear algebra: what a column explains, and what it would explain in
the place of others.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.diagnosis.scores import exchange_falls, scores_of

CASES, ROWS, OUTPUTS, OWN, SHARED = 3, 40, 2, 2, 6
WHOLE = jnp.ones((CASES, ROWS, OUTPUTS), bool)  # no sample is missing
# the last of the free ones are effects that are in
FREE = np.array([True, True, True, True, False, False])


@pytest.fixture(scope="module")
def problem():
    """Whitened columns and a residual that is orthogonal to all free ones, as at an optimum."""
    keys = jax.random.split(jax.random.key(1974), 2)
    S = np.array(jax.random.normal(keys[0], (CASES, ROWS, OUTPUTS, OWN + SHARED)))
    v = np.asarray(jax.random.normal(keys[1], (CASES, ROWS, OUTPUTS))).reshape(-1)
    A = plain(S)
    stay = A[:, np.r_[np.ones(CASES * OWN, bool), FREE]]
    v = v - stay @ np.linalg.lstsq(stay, v, rcond=None)[0]
    return jnp.asarray(v.reshape(CASES, ROWS, OUTPUTS)), jnp.asarray(S), A, v


def plain(S):
    """One matrix, each record's own unknowns in columns of their own."""
    own = np.zeros((CASES, ROWS * OUTPUTS, CASES * OWN))
    for case in range(CASES):
        own[case, :, case * OWN : (case + 1) * OWN] = S[case, ..., :OWN].reshape(-1, OWN)
    return np.concatenate([own, S[..., OWN:].reshape(CASES, -1, SHARED)], axis=-1).reshape(
        -1, CASES * OWN + SHARED
    )


def squares(A, v):
    """What least squares leaves."""
    rest = v - A @ np.linalg.lstsq(A, v, rcond=None)[0]
    return rest @ rest


def columns(A, shared):
    return A[:, np.r_[np.ones(CASES * OWN, bool), shared]]


def test_a_score_is_the_fall_of_chi_square_with_the_column_free(problem):
    v, S, A, residual = problem
    score = np.asarray(scores_of(v, S, WHOLE, jnp.asarray(FREE)).score)
    assert np.all(score[FREE] == 0)
    for absent in np.flatnonzero(~FREE):
        more = FREE | (np.arange(SHARED) == absent)
        fall = residual @ residual - squares(columns(A, more), residual)
        # A small fall is the difference of two large sums, and rounds as they do.
        rounding = 4 * np.finfo(float).eps * (residual @ residual)
        np.testing.assert_allclose(score[absent], fall, rtol=1e-10, atol=rounding)


def test_a_column_that_is_not_finite_has_no_score_and_does_the_others_no_harm(problem):
    v, S, _, _ = problem
    spoilt = S.at[0, 3, 1, -2].set(jnp.nan)
    scores = scores_of(v, spoilt, WHOLE, jnp.asarray(FREE))
    clean = scores_of(v, S.at[..., -2].set(0.0), WHOLE, jnp.asarray(FREE))
    assert np.isnan(scores.identifiable_fraction[-2])
    assert float(scores.score[-2]) == 0.0
    np.testing.assert_array_equal(scores.score, clean.score)
    np.testing.assert_array_equal(scores.significance, clean.significance)
    values, out = jnp.zeros(SHARED), jnp.asarray([[False, False, False, True, False, False]])
    falls = exchange_falls(v, spoilt, jnp.asarray(FREE), out, values)
    assert np.isfinite(falls[0, -1])
    assert np.isneginf(falls[0, -2])


def test_an_exchange_falls_as_a_fit_from_anew_does(problem):
    v, S, A, residual = problem
    values = np.array([0.5, -1.0, 0.3, 0.2, 0.0, 0.0])
    sets = np.array([[0, 0, 0, 1, 0, 0], [0, 0, 1, 1, 0, 0]], bool)
    falls = np.asarray(
        exchange_falls(v, S, jnp.asarray(FREE), jnp.asarray(sets), jnp.asarray(values))
    )
    assert np.all(np.isneginf(falls[:, FREE]))
    measured = residual + A[:, CASES * OWN :] @ values
    for out, fall in zip(sets, falls, strict=True):
        for come in np.flatnonzero(~FREE):
            new = (FREE & ~out) | (np.arange(SHARED) == come)
            expected = residual @ residual - squares(columns(A, new), measured)
            np.testing.assert_allclose(fall[come], expected, rtol=1e-10)
