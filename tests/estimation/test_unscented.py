"""The unscented update: linear outputs, the moments of a square, derivatives, and its fit."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gusty_pendulum import PENDULUM, PHYSICS

import jaxid
from jaxid import FilterError, InputError
from jaxid.data import record
from jaxid.estimation.estimate import checked_case
from jaxid.estimation.filter.kalman import Sample, cholesky, unscented_update
from jaxid.estimation.problem import Problem
from jaxid.models import AbstractModel, LinearModel, free
from jaxid.models.free import Parameters
from jaxid.uncertainty.bootstrap import drawn_records


class Squares(AbstractModel):
    """A random walk, of which the square and the value are measured."""

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
    update = unscented_update(
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


def test_fit_from_a_curved_output_has_less_bias():
    """The square alone is measured, of a state with a large random part and a mean of 1."""

    class Square(Squares):
        outputs = ("square",)

        def output(self, t, x, u):
            return x**2

    truth = Squares(jnp.array(1.0))
    t = 0.2 * np.arange(400)
    blank = record(
        t, 1.0 + 0.3 * np.sign(np.sin(t)), np.zeros((400, 2)), inputs=("u",), outputs=truth.outputs
    )
    noise = FilterError({"x": 0.5}, {"square": 0.1, "value": 0.1}, {"x": 0.3})
    case = checked_case(truth, free(truth, "gain"), blank, noise)
    draws = jax.vmap(lambda key: drawn_records(case.problem, case.begin, jnp.eye(2), key)[0])
    z = np.asarray(draws(jax.random.split(jax.random.key(5), 20)))
    bias = {}
    for unscented in (False, True):
        likelihood = FilterError(
            {"x": jaxid.Fixed(0.5)}, {"square": jaxid.Fixed(0.1)}, unscented=unscented
        )
        fits = [
            jaxid.estimate(
                Square(jnp.array(1.0)),
                free(truth, "gain"),
                record(t, blank.u, one[:, :1], inputs=("u",), outputs=("square",)),
                likelihood,
            )
            for one in z
        ]
        errors = np.array([(fit.value("gain") - 1.0) / fit.standard_error("gain") for fit in fits])
        bias[unscented] = abs(errors.mean())
    assert bias[True] < bias[False], bias


def test_contradictory_options_are_refused():
    with pytest.raises(InputError, match="no linearisation to iterate"):
        FilterError({"x": 0.1}, unscented=True, updates=2)
    with pytest.raises(InputError, match="Leave out `updates` and `unscented`"):
        FilterError({"x": 0.1}, unscented=True, frozen_gain=True)
