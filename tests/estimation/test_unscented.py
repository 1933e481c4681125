"""The unscented update: linear outputs, the moments of a square, derivatives, and its fit."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gusty_pendulum import PENDULUM, PHYSICS

from jaxid import RK4, FilterError, InputError
from jaxid.data import record
from jaxid.estimation.estimate import checked_case
from jaxid.estimation.filter.backward_pass import smooth_filtered
from jaxid.estimation.filter.kalman import Sample, cholesky, unscented_update
from jaxid.estimation.problem import Problem
from jaxid.models import AbstractModel, LinearModel, free
from jaxid.models.free import Parameters
from jaxid.uncertainty.bootstrap import drawn_records


class Squares(AbstractModel):
    """A random walk, whose square and value are measured."""

    gain: jax.Array
    states, inputs, outputs = ("x",), ("u",), ("square", "value")

    def rhs(self, t, x, u):
        return self.gain * u - x

    def output(self, t, x, u):
        return jnp.stack([x[0] ** 2, x[0]])


def test_moments_of_a_square_are_exact():
    """`x ~ N(m, P)`: E x^2 = m^2 + P, var x^2 = 4 m^2 P + 2 P^2, cov(x, x^2) = 2 m P."""
    m, P, r, z = 0.7, 0.4, 0.1, 1.9
    sample = Sample(jnp.zeros(()), jnp.zeros(1), jnp.array([z, 0.0]), jnp.array([True, False]))
    update = eqx.filter_jit(unscented_update)(
        Squares(jnp.array(1.0)), jnp.array([m]), jnp.array([[P]]), sample, jnp.array([r, 1.0])
    )
    B = 4 * m**2 * P + 2 * P**2 + r**2
    gain = 2 * m * P / B
    np.testing.assert_allclose(update.y[0], m**2 + P, rtol=1e-14)
    np.testing.assert_allclose(update.B, [[B, 0.0], [0.0, 1.0]], rtol=1e-14)
    np.testing.assert_allclose(update.x, [m + gain * (z - m**2 - P)], rtol=1e-14)
    np.testing.assert_allclose(update.P, [[P - gain**2 * B]], rtol=1e-13)


def test_factor_of_singular_covariance():
    root = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.5, 0.0, 0.3]])
    S = np.asarray(cholesky(jnp.asarray(root @ root.T)))
    np.testing.assert_allclose(S @ S.T, root @ root.T, atol=1e-14)
    assert not S[:, 1].any()


def test_linear_outputs_give_the_same_likelihood():
    model = LinearModel(
        *([[0.0, 1.0], [-2.0, -0.4]], [[0.0], [1.0]], [[1.0, 0.0], [0.3, 1.0]], [[0.0], [0.0]]),
        states=("x", "v"),
        inputs=("f",),
        outputs=("a", "b"),
    )
    rng, t = np.random.default_rng(3), 0.05 * np.arange(60)
    z = 0.3 * rng.normal(size=(60, 2))
    z[rng.uniform(size=z.shape) < 0.3] = np.nan
    data = record(t, np.sin(3 * t), z, inputs=("f",), outputs=("a", "b"))
    costs = []
    for unscented in (False, True):
        likelihood = FilterError({"v": 0.3}, initial={"x": 0.1}, unscented=unscented)
        case = checked_case(model, free(model, "A[1,0]"), data, likelihood)
        cost, linearised = eqx.filter_jit(Problem.evaluate)(case.problem, case.begin)
        costs.append(np.concatenate([cost[None], linearised.information.gradient()[0]]))
    np.testing.assert_allclose(costs[1], costs[0], rtol=1e-9)


def test_gradient_of_nonlinear_model_equals_derivative_of_cost():
    rng, t = np.random.default_rng(5), 0.08 * np.arange(40)
    z = np.stack([np.sin(2 * t), np.cos(3 * t), 2 * np.cos(2 * t)], 1)
    z[rng.uniform(size=z.shape) < 0.3] = np.nan
    data = record(t, np.sin(3 * t), z, inputs=("torque",), outputs=PENDULUM.outputs)
    likelihood = FilterError({"rate": 0.4}, initial={"angle": 0.1}, unscented=True)
    case = checked_case(PENDULUM, free(PENDULUM, *PHYSICS), data, likelihood)

    def cost(theta):
        return case.problem.cost(Parameters(theta, jnp.zeros((1, 0))))

    expected = jax.jit(jax.grad(cost))(case.begin.shared)
    _, linearised = eqx.filter_jit(Problem.evaluate)(case.problem, case.begin)
    gradient, _ = linearised.information.gradient()
    np.testing.assert_allclose(gradient, expected, rtol=1e-8, atol=1e-8)


def test_innovations_of_a_curved_output_have_no_mean():
    """Samples are so far apart that the state forgets: the mean of the square is `m^2 + P`, which
    the linearised update misses by P, 0.15 deviations. 8,000 samples show a mean of 0.011.
    """
    truth, t = Squares(jnp.array(1.0)), 2.0 * np.arange(400)
    blank = record(t, np.ones(400), np.zeros((400, 2)), inputs=("u",), outputs=truth.outputs)
    means = []
    for unscented in (False, True):
        noise = FilterError(
            {"x": 0.5}, {"square": 0.1, "value": 10.0}, unscented=unscented, stepper=RK4(20)
        )
        case = checked_case(truth, free(truth, "gain"), blank, noise)
        problem, begin = case.problem, case.begin

        def innovations(key, problem=problem, begin=begin):
            z = drawn_records(problem, begin, jnp.eye(2), key)
            again = eqx.tree_at(lambda node: node.records.z, problem, z)
            return again.residuals(begin)[0, 100:, 0]

        w = jax.jit(jax.vmap(innovations))(jax.random.split(jax.random.key(5), 27))
        means.append(float(jnp.mean(w)))
    assert abs(means[1]) < 0.04
    assert means[0] > 0.1


def test_smoothed_states_are_those_of_the_recursion_with_gains():
    """`x_s = x + P Phi' P_pred^-1 (x_s(next) - x_pred(next))` (Rauch, Tung, Striebel), with the
    moments of the unscented updates.
    """
    rng, t = np.random.default_rng(6), 0.08 * np.arange(40)
    z = np.stack([2 * np.sin(2 * t), 2 * np.cos(3 * t), 3 * np.cos(2 * t)], 1)
    z[rng.uniform(size=z.shape) < 0.3] = np.nan
    data = record(t, np.sin(3 * t), z, inputs=("torque",), outputs=PENDULUM.outputs)
    start = {"angle": 0.5, "rate": 0.5}
    likelihood = FilterError({"angle": 0.2, "rate": 0.8}, initial=start, unscented=True)
    case = checked_case(PENDULUM, free(PENDULUM, *PHYSICS), data, likelihood)
    model, initial_state = case.problem.model_of(case.begin, 0)
    filtered = eqx.filter_jit(likelihood.filter)(model, data, initial_state)
    smoothed, _ = eqx.filter_jit(smooth_filtered)(filtered)
    filtered = jax.tree.map(np.asarray, filtered)
    expected = [np.asarray(filtered.x[-1])]
    for i in range(38, -1, -1):
        P, Phi, P_next = filtered.P[i], filtered.Phi[i], filtered.P_predicted[i + 1]
        step = np.linalg.solve(P_next, expected[0] - filtered.x_predicted[i + 1])
        expected.insert(0, filtered.x[i] + P @ Phi.T @ step)
    np.testing.assert_allclose(smoothed, expected, rtol=1e-8, atol=1e-8)


def test_contradictory_options_are_refused():
    with pytest.raises(InputError, match="no linearisation to iterate"):
        FilterError({"x": 0.1}, unscented=True, updates=2)
    with pytest.raises(InputError, match="Leave out `updates` and `unscented`"):
        FilterError({"x": 0.1}, unscented=True, frozen_gain=True)
