"""Derivatives of the filter of a nonlinear model against forward mode through the filter."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gusty_pendulum import CASES, pendulum_problem

from jaxid.estimation.filter.kalman import inverse_cholesky
from jaxid.models.free import initial_parameters
from jaxid.models.free_model import FreeModel
from jaxid.sensitivity.jacobian import value_and_jacobian


@pytest.mark.parametrize("case", CASES)
def test_derivatives_of_nonlinear_model_equal_forward_mode(case):
    problem, _ = pendulum_problem(case)
    likelihood = problem.likelihood
    begin = initial_parameters(problem.model, problem.positions, problem.records)
    flat, one = jax.tree.map(lambda leaf: leaf[0], problem.cases())
    family = FreeModel(problem.model, flat, problem.positions)
    theta = jnp.concatenate([begin.rows[0], begin.shared])

    def innovations(theta):
        model, x0 = family(theta)
        filtered = likelihood.filter(model, one, x0)
        return jnp.concatenate([filtered.v, filtered.B.reshape(one.t.size, -1)], axis=-1)

    value, derivative = jax.jit(lambda theta: value_and_jacobian(innovations, theta))(theta)
    inverse = inverse_cholesky(value[:, 3:].reshape(-1, 3, 3))
    dB = np.asarray(derivative[:, 3:]).reshape(one.t.size, 3, 3, -1)
    first, second = np.triu_indices(3)
    white = np.einsum("tij,tjkp,tlk->tilp", inverse, dB, inverse)[:, first, second]
    weight = np.where(first == second, np.sqrt(0.5), 1.0)[None, :, None]
    expected = [-np.einsum("tij,tjp->tip", inverse, derivative[:, :3]), -weight * white]
    expected = np.concatenate(expected, axis=1)
    _, rows = jax.jit(lambda theta: likelihood.sensitivities(family, theta, one))(theta)
    scale = np.abs(expected).max(axis=(0, 1))
    np.testing.assert_allclose(np.asarray(rows) / scale, expected / scale, atol=1e-12)
