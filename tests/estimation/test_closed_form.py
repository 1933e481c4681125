"""Where the outputs are linear in the free parameters, the estimate is weighted least squares, and
one step away.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from reference_estimation import rk4

from jaxid._foundation.types import Array
from jaxid.data import record
from jaxid.estimation import OutputError, estimate
from jaxid.models import (
    AbstractModel,
    DiagonalNoise,
    FixedNoise,
    FullNoise,
    LinearModel,
    free,
)

A = np.array([[0.0, 1.0], [-2.0, -0.5]])
R = np.array([[0.04, 0.03], [0.03, 0.09]])
STATES, INPUTS, OUTPUTS = ("x", "v"), ("force",), ("position", "acceleration")


class Decay(AbstractModel):
    """A free decay: no input."""

    rate: Array
    states, inputs, outputs = ("x",), (), ("x",)

    def rhs(self, t, x, u):
        return -self.rate * x

    def output(self, t, x, u):
        return x


def linear(B, C, D):
    return LinearModel(A, B, C, D, states=STATES, inputs=INPUTS, outputs=OUTPUTS)


def signals(rng, n):
    t = 0.1 * np.arange(n)
    u = np.sin(1.1 * t + rng.uniform(0, 6)) + rng.normal(size=n).cumsum() * 0.1
    x = rk4(lambda x, u, theta: A @ x + np.array([0.0, 1.0]) * u, t, u, np.zeros(2), np.zeros(1))
    return t, u, x


def least_squares(S, z, weight):
    """Minimum of `(z - S theta)' W (z - S theta)` over rows (sample, output, parameter), and its
    covariance.
    """
    M = np.einsum("ijp,jk,ikq->pq", S, weight, S)
    return np.linalg.solve(M, np.einsum("ijp,jk,ik->p", S, weight, z)), np.linalg.inv(M)


def output_matrices(rng, gaps):
    """C[0,0], C[1,1] and D[1,0] free: other regressors in each output, so that a full R matters."""
    made, S, Z = [], [], []
    for n in (80, 50):
        t, u, x = signals(rng, n)
        rows = np.zeros((n, 2, 3))
        rows[:, 0, 0], rows[:, 1, 1], rows[:, 1, 2] = x[:, 0], x[:, 1], u
        z = rows @ np.array([1.5, -0.7, 2.0]) + rng.multivariate_normal(np.zeros(2), R, n)
        if gaps:
            z[5:15, 0] = np.nan
            z[rng.uniform(size=n) < 0.2, 1] = np.nan
        made.append(record(t, u, z, inputs=INPUTS, outputs=OUTPUTS, name=str(n)))
        S.append(np.where(np.isnan(z)[..., None], 0.0, rows))
        Z.append(np.where(np.isnan(z), 0.0, z))
    return made, np.concatenate(S), np.concatenate(Z)


NOISES = {
    "known, full": (lambda: FixedNoise(R), False),
    "known, diagonal, gaps": (lambda: FixedNoise(np.diagonal(R)), True),
    "full": (FullNoise, False),
    "diagonal, gaps": (DiagonalNoise, True),
}


@pytest.mark.parametrize("case", NOISES)
def test_output_matrices_equal_weighted_least_squares(case, seed):
    noise, gaps = NOISES[case][0](), NOISES[case][1]
    made, S, z = output_matrices(np.random.default_rng(seed), gaps)
    model = linear(np.array([[0.0], [1.0]]), np.array([[1.0, 0.0], [0.0, 1.0]]), np.zeros((2, 1)))
    result = estimate(
        model, free(model, "C[0,0]", "C[1,1]", "D[1,0]"), made, OutputError(noise=noise)
    )
    assert bool(result.successful)
    # At the R that stands with the estimate, it is the weighted least-squares solution; R itself is
    # checked below.
    values, covariance = least_squares(S, z, np.linalg.inv(result.noise))
    np.testing.assert_allclose(
        result.values, values, rtol=1e-9 if isinstance(noise, FixedNoise) else 1e-7
    )
    np.testing.assert_allclose(result.covariance, covariance, rtol=1e-9)
    v = z - S @ np.asarray(result.values)
    if isinstance(noise, FullNoise):
        np.testing.assert_allclose(result.noise, v.T @ v / len(v), rtol=1e-9)
    if isinstance(noise, DiagonalNoise):
        counts = sum(np.asarray(r.mask).sum(axis=0) for r in made)
        np.testing.assert_allclose(
            result.noise, np.diag((v**2).sum(axis=0) / counts), rtol=1e-9, atol=1e-300
        )


def test_linear_problem_with_known_noise_converges_in_one_step(seed):
    made, *_ = output_matrices(np.random.default_rng(seed), gaps=False)
    model = linear(np.array([[0.0], [1.0]]), np.array([[1.0, 0.0], [0.0, 1.0]]), np.zeros((2, 1)))
    result = estimate(
        model, free(model, "C[0,0]", "C[1,1]", "D[1,0]"), made, OutputError(noise=FixedNoise(R))
    )
    assert int(result.iterations) == 2  # the start, and the minimum
    assert float(result.decrements[1]) < 1e-9


def test_input_matrix_and_initial_states_equal_dense_least_squares(seed):
    """`B` shared, initial states by record: the elimination of a record's own unknowns loses
    nothing.
    """
    rng = np.random.default_rng(seed)
    lengths = (60, 90, 40)
    S, Z, made = [], [], []
    for i, n in enumerate(lengths):
        t, u, _ = signals(rng, n)
        columns = [rk4(lambda x, u, b: A @ x + b * u, t, u, np.zeros(2), b) for b in np.eye(2)]
        own = [rk4(lambda x, u, b: A @ x, t, u, x0, np.zeros(1)) for x0 in np.eye(2)]
        rows = np.zeros((n, 2, 2 + 2 * len(lengths)))
        rows[..., :2] = np.stack(columns, -1)
        rows[..., 2 + 2 * i : 4 + 2 * i] = np.stack(own, -1)
        z = rows @ rng.normal(size=rows.shape[-1]) + rng.multivariate_normal(np.zeros(2), R, n)
        S.append(rows)
        Z.append(z)
        made.append(record(t, u, z, inputs=INPUTS, outputs=OUTPUTS, name=str(n)))
    values, covariance = least_squares(np.concatenate(S), np.concatenate(Z), np.linalg.inv(R))
    model = linear(np.zeros((2, 1)), np.eye(2), np.zeros((2, 1)))
    result = estimate(
        model,
        free(model, "B", per_record=("initial_state",)),
        made,
        OutputError(noise=FixedNoise(R)),
    )
    errors = np.sqrt(np.diagonal(covariance))
    np.testing.assert_allclose(result.values, values[:2], rtol=1e-9)
    np.testing.assert_allclose(result.own.reshape(-1), values[2:], rtol=1e-9)
    np.testing.assert_allclose(result.covariance, covariance[:2, :2], rtol=1e-9)
    np.testing.assert_allclose(result.own_errors.reshape(-1), errors[2:], rtol=1e-9)


def test_correlations_and_F_values_follow_from_covariance(seed):
    made, *_ = output_matrices(np.random.default_rng(seed), gaps=False)
    model = linear(np.array([[0.0], [1.0]]), np.array([[1.0, 0.0], [0.0, 1.0]]), np.zeros((2, 1)))
    result = estimate(
        model, free(model, "C[0,0]", "C[1,1]", "D[1,0]"), made, OutputError(noise=FixedNoise(R))
    )
    C = np.asarray(result.covariance)
    np.testing.assert_allclose(
        result.F, np.asarray(result.values) ** 2 / np.diagonal(C), rtol=1e-12
    )
    np.testing.assert_allclose(jnp.diagonal(result.correlation), 1.0, rtol=1e-12)
    np.testing.assert_allclose(
        result.correlation[0, 1], C[0, 1] / np.sqrt(C[0, 0] * C[1, 1]), rtol=1e-12
    )


def test_free_decay_without_an_input_is_estimated():
    t, no_input = 0.1 * np.arange(40), np.zeros((40, 0))
    x = rk4(lambda x, u, theta: -x, t, np.zeros(40), np.array([2.0]), np.zeros(1))
    decay = record(t, no_input, x, inputs=(), outputs=("x",))
    start = Decay(jnp.array(0.3))
    chosen = free(start, "rate", per_record=("initial_state",))
    found = estimate(start, chosen, decay, OutputError(FixedNoise(jnp.eye(1))))
    assert found.value("rate") == pytest.approx(1.0, rel=1e-6)
