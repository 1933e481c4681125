"""An over-parameterised model: the policies converge and name undetermined parameters; the
plain solver diverges.
"""

import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from reference_estimation import lag_rhs, rk4

from jaxid._foundation.results import RESULTS
from jaxid._foundation.types import Array
from jaxid.data import record
from jaxid.estimation import (
    Clip,
    Damp,
    GaussNewton,
    OutputError,
    Plain,
    Truncate,
    TwoStep,
    estimate,
)
from jaxid.models import AbstractModel, FixedNoise, free

TRUTH = np.array([1.5, 6.0])
POLICIES = [Clip(), Truncate(), TwoStep()]
START = (1.0, 1.0, 1.0)


class Product(AbstractModel):
    """A first-order lag with gain `a b + leak a`: without the leak only the product is
    determined.
    """

    p: Array
    a: Array
    b: Array
    leak: Array
    states, inputs, outputs = ("x",), ("u",), ("x",)

    def rhs(self, t, x, u):
        return -self.p * x + (self.a * self.b + self.leak * self.a**2) * u

    def output(self, t, x, u):
        return x


class Ordinary(AbstractModel):
    """The same with the product as one parameter."""

    p: Array
    gain: Array
    states, inputs, outputs = ("x",), ("u",), ("x",)

    def rhs(self, t, x, u):
        return -self.p * x + self.gain * u

    def output(self, t, x, u):
        return x


@pytest.fixture
def measured(seed):
    t = 0.05 * np.arange(200)
    u = np.sign(np.sin(1.1 * t))
    z = rk4(lag_rhs, t, u, np.zeros(1), TRUTH) + 0.05 * np.random.default_rng(seed).normal(
        size=(200, 1)
    )
    return record(t, u, z, inputs=("u",), outputs=("x",))


def fit(measured, policy, start=START, leak=0.0, **options):
    model = Product(*start, leak)
    solver = GaussNewton(policy=policy, **options)
    return estimate(model, free(model, "p", "a", "b"), measured, OutputError(), solver=solver)


@pytest.mark.parametrize("policy", POLICIES, ids=lambda policy: type(policy).__name__)
@pytest.mark.parametrize("start", [START, (0.5, 3.0, 0.3), (1.0, 0.1, 5.0)], ids=str)
def test_policy_estimates_determined_and_names_undetermined_parameters(measured, policy, start):
    ordinary = Ordinary(1.0, 1.0)
    exact = estimate(ordinary, free(ordinary, "p", "gain"), measured, OutputError())
    result = fit(measured, policy, start)
    assert result.result == RESULTS.undetermined
    assert int(result.iterations) <= 12
    np.testing.assert_allclose(result.value("p"), exact.value("p"), rtol=1e-7)
    np.testing.assert_allclose(
        result.value("a") * result.value("b"), exact.value("gain"), rtol=1e-7
    )
    np.testing.assert_allclose(result.standard_error("p"), exact.standard_error("p"), rtol=1e-6)
    assert np.isinf(result.standard_error("a"))
    assert np.isinf(result.standard_error("b"))
    # Along the weak direction a b stays: da/a = - db/b.
    (words,) = result.weak_directions
    ratio = result.value("a") / result.value("b")
    assert words == f"a + {ratio:.3g} b is determined, a - {1 / ratio:.3g} b is not"
    assert words in str(result)


def test_plain_policy_diverges_from_same_start(measured):
    """The plain Gauss-Newton iteration has no search: the other policies need none
    here.
    """
    search = optx.LearningRate(1.0)
    plain = fit(measured, Plain(), search=search, max_steps=30)
    assert not bool(plain.successful)
    assert np.max(np.abs(plain.values)) > 1e4, plain.values
    assert float(np.nanmax(plain.costs[1:])) > 10 * float(plain.costs[0])
    for policy in (Clip(), Truncate()):
        result = fit(measured, policy, search=search, max_steps=30)
        assert result.result == RESULTS.undetermined
        assert np.max(np.abs(result.values)) < 10


def test_search_stops_plain_policy_without_convergence(measured):
    plain = fit(measured, Plain())
    assert not bool(plain.successful)
    assert "Check the units" in plain.status
    assert float(plain.cost) > float(fit(measured, Clip()).cost) + 100


@pytest.mark.parametrize("policy", POLICIES, ids=lambda policy: type(policy).__name__)
def test_weak_direction_above_rounding_does_no_harm(measured, policy):
    """With a leak of 1e-7 the two columns differ by 1e-7 of their length: an eigenvalue of 1e-14,
    and not rounding.
    """
    result = fit(measured, policy, leak=1e-7)
    assert result.result == RESULTS.undetermined
    exact = fit(measured, Clip())
    gain = result.value("a") * result.value("b") + 1e-7 * result.value("a") ** 2
    np.testing.assert_allclose(gain, exact.value("a") * exact.value("b"), rtol=1e-6)
    assert np.isinf(result.standard_error("a"))
    assert len(result.weak_directions) == 1


@pytest.mark.parametrize("policy", [*POLICIES, Plain()], ids=lambda policy: type(policy).__name__)
def test_well_posed_problem_is_equal_under_every_policy(measured, policy):
    model = Ordinary(1.0, 1.0)
    chosen = free(model, "p", "gain", per_record=("initial_state",))
    result = estimate(model, chosen, measured, OutputError(), solver=GaussNewton(policy=policy))
    reference = estimate(model, chosen, measured, OutputError())
    np.testing.assert_allclose(result.values, reference.values, rtol=1e-10)
    np.testing.assert_allclose(result.standard_errors, reference.standard_errors, rtol=1e-10)
    assert result.weak_directions == ()


def test_damping_ends_within_its_tolerance_of_the_undamped_estimate(measured):
    model = Ordinary(1.0, 1.0)
    chosen = free(model, "p", "gain", per_record=("initial_state",))
    damped = estimate(model, chosen, measured, OutputError(), solver=GaussNewton(policy=Damp()))
    reference = estimate(model, chosen, measured, OutputError())
    distance = (damped.values - reference.values) / reference.standard_errors
    np.testing.assert_allclose(distance, 0.0, atol=GaussNewton().tolerance)
    np.testing.assert_allclose(damped.standard_errors, reference.standard_errors, rtol=1e-6)
    assert damped.status == "converged"


class Exponentials(AbstractModel):
    """Problem 6 of Moré, Garbow and Hillstrom, ACM Transactions on Mathematical Software 7, 1981
    (Jennrich and Sampson): `2 + 2 i - exp(i x1) - exp(i x2)`; least sum of squares 124.362.
    """

    x1: Array
    x2: Array
    states, inputs, outputs = (), ("row",), ("residual",)

    def rhs(self, t, x, u):
        return jnp.zeros(0)

    def output(self, t, x, u):
        i = u[0]
        return jnp.array([2.0 + 2.0 * i - jnp.exp(i * self.x1) - jnp.exp(i * self.x2)])


def exponentials(policy, **options):
    rows = np.arange(1.0, 11.0)
    data = record(rows, rows[:, None], np.zeros((10, 1)), inputs=("row",), outputs=("residual",))
    model = Exponentials(0.3, 0.4)
    solver = GaussNewton(policy=policy)
    known = OutputError(noise=FixedNoise(np.array([12.4])))
    return estimate(model, free(model, "x1", "x2", **options), data, known, solver=solver)


def test_damping_reaches_a_minimum_with_large_residuals():
    """Gauss-Newton's direction is poor there at any length, and its search ends above it."""
    damped, clipped = exponentials(Damp()), exponentials(Clip())
    np.testing.assert_allclose(np.sum(np.square(damped.residuals)), 124.362, atol=1e-3)
    np.testing.assert_allclose(damped.values, 0.257825, atol=1e-5)
    assert float(clipped.cost) > float(damped.cost) + 0.1
    assert not bool(clipped.successful)


def test_damping_respects_bounds():
    damped = exponentials(Damp(), bounds={"x1": (0.28, None)})
    assert damped.value("x1") == 0.28
    assert bool(damped.successful)
    # the other parameter alone: its residuals have no slope
    i, x2 = np.arange(1.0, 11.0), damped.value("x2")
    slope = np.sum((2 + 2 * i - np.exp(0.28 * i) - np.exp(i * x2)) * i * np.exp(i * x2))
    curvature = np.sum((i * np.exp(i * x2)) ** 2)
    assert abs(slope / curvature) < 1e-5
