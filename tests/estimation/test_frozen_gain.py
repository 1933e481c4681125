"""Filter error with the gain frozen: derivatives, limits, and the fit that starts with it."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gusty_lag import GustyLag, as_record, flights
from gusty_pendulum import CASES, pendulum_problem

from jaxid import InputError
from jaxid.estimation import FilterError, FirstOrder, GaussNewton, estimate
from jaxid.estimation.estimate import checked_case
from jaxid.estimation.filter.filter_error import FrozenGain
from jaxid.estimation.filter.kalman import filter_signals, inverse_cholesky
from jaxid.estimation.solver import minimise
from jaxid.models import free
from jaxid.models.free import initial_parameters
from jaxid.models.free_model import FreeModel
from jaxid.sensitivity.jacobian import value_and_jacobian
from jaxid.simulation.steppers import runge_kutta_step

START = GustyLag(jnp.array(0.7), jnp.array(1.5))
FREE = free(START, "p", "b", per_record=("initial_state",))
FORCED = {"force": FirstOrder(0.3, 2.0)}
OWN, PHYSICS = 1, 2  # free parameters of a record and of the model of `START`


def frozen(problem):
    likelihood = FrozenGain(problem.likelihood)
    return eqx.tree_at(lambda problem: problem.likelihood, problem, likelihood)


@eqx.filter_jit
def squares(problem, parameters):
    """Information and negative gradient of one record, the parameters of the record first."""
    information = problem.linearise(parameters).information
    own, shared = information.own, information.triangle
    first = jnp.concatenate([own.jacobian[0], own.coupling[0]], axis=1)
    second = jnp.pad(shared, ((0, 0), (own.jacobian.shape[-1], 0)))
    rows = jnp.concatenate([first, second])
    return rows.T @ rows, rows.T @ jnp.concatenate([own.rhs[0], information.rhs])


def assert_squares_equal(squares, expected, atol):
    """Scaled by the standard errors with all other parameters known."""
    scale = np.sqrt(np.diag(expected[0]))
    np.testing.assert_allclose(
        squares[0] / np.outer(scale, scale), expected[0] / np.outer(scale, scale), atol=atol
    )
    np.testing.assert_allclose(squares[1] / scale, expected[1] / scale, atol=atol)


@pytest.mark.parametrize("case", CASES)
def test_columns_of_model_equal_derivatives_with_gain_held(case):
    """Forward mode through the filter's recursion with constant gains and covariances."""
    problem, physics = pendulum_problem(case)
    likelihood, begin = (
        problem.likelihood,
        initial_parameters(problem.model, problem.positions, problem.records),
    )
    flat, one = jax.tree.map(lambda leaf: leaf[0], problem.cases())
    family = FreeModel(problem.model, flat, problem.positions)
    theta = jnp.concatenate([begin.rows[0], begin.shared])
    substeps = likelihood.stepper.substeps

    def gains(theta):
        model, x0 = family(theta)
        filtered = likelihood.filter(model, one, x0)
        inverse = inverse_cholesky(filtered.B)
        samples, _ = filter_signals(model, one, likelihood.hold, substeps)
        slope = jax.vmap(jax.jacfwd(model.output, argnums=1))
        H = slope(samples.t, filtered.x_predicted, samples.u)
        H = jnp.where(one.mask[..., None], H, 0.0)
        return filtered.P_predicted @ H.mT @ inverse.mT @ inverse, inverse

    def white(theta, K, inverse):
        model, x0 = family(theta)
        samples, steps = filter_signals(model, one, likelihood.hold, substeps)

        def interval(x, now):
            (t, u, z, mask), steps, K, inverse = now
            v = jnp.where(mask, z - model.output(t, x, u), 0.0)

            def substep(x, step):
                return runge_kutta_step(model, x, *step)[0], None

            return jax.lax.scan(substep, x + K @ v, steps)[0], inverse @ v

        return jax.lax.scan(interval, x0, (samples, steps, K, inverse))[1].reshape(-1)

    @jax.jit
    def white_at_start(theta):
        held = gains(theta)
        return value_and_jacobian(lambda theta: white(theta, *held), theta)

    w, J = map(np.asarray, white_at_start(theta))
    own = np.s_[: begin.rows.size + physics]
    information, gradient = squares(frozen(problem), begin)
    expected = (J.T @ J)[own, own], -(J.T @ w)[own]
    assert_squares_equal((information[own, own], gradient[own]), expected, 1e-11)


@pytest.fixture(scope="module")
def lag():
    """A record of a linear model, with gaps."""
    t, u, z, _ = flights(1, 100, 11)
    z[0, np.random.default_rng(1).uniform(size=100) < 0.2] = np.nan
    case = checked_case(START, FREE, as_record(t, u, z[0]), FilterError(FORCED))
    return case.problem, case.begin


def test_columns_of_noises_of_linear_model_are_exact(lag):
    """The information on `p` differs by 3 %: it lacks the derivatives of gain and covariance."""
    problem, begin = lag
    noises = np.s_[OWN + PHYSICS :]
    information, gradient = squares(frozen(problem), begin)
    exact, exact_gradient = squares(problem, begin)
    parts = (information[noises, noises], gradient[noises])
    assert_squares_equal(parts, (exact[noises, noises], exact_gradient[noises]), 1e-11)
    assert abs(information[OWN, OWN] / exact[OWN, OWN] - 1) > 0.01


def test_without_process_noise_all_derivatives_are_exact():
    """The gain is zero, and stays zero: output error."""
    t, u, z, _ = flights(1, 100, 11)
    case = checked_case(START, FREE, as_record(t, u, z[0]), FilterError())
    exact = squares(case.problem, case.begin)
    assert_squares_equal(squares(frozen(case.problem), case.begin), exact, 1e-11)


@pytest.fixture(scope="module")
def records():
    t, u, z, _ = flights(2, 400, 11)
    return [as_record(t, u, z[0]), as_record(t[:250], u[:250], z[1, :250])]


def test_fit_that_starts_frozen_has_estimate_and_errors_of_moving_gain(records):
    moving = estimate(START, FREE, records, FilterError(FORCED))
    mixed = estimate(START, FREE, records, FilterError(FORCED, frozen_gain=True))
    assert bool(mixed.successful)
    distance = np.asarray(mixed.values - moving.values) / np.asarray(moving.standard_errors)
    # to the tolerance of the iteration, 1e-6 standard errors, and some
    np.testing.assert_allclose(distance, 0.0, atol=1e-5)
    np.testing.assert_allclose(mixed.standard_errors, moving.standard_errors, rtol=1e-5)
    assert int(mixed.iterations) < int(moving.iterations)


def test_end_of_frozen_iteration_is_near_estimate(records):
    """Its equations hold at other parameters than the likelihood's, both within sampling errors:
    0.03 standard errors apart here, where the iteration alone may leave 0.1.
    """
    exact = estimate(START, FREE, records, FilterError(FORCED))
    case = checked_case(START, FREE, records, FilterError(FORCED))
    solver = GaussNewton(tolerance=0.01, max_steps=40)
    parameters, _ = jax.jit(lambda begin: minimise(frozen(case.problem), begin, solver))(case.begin)
    distance = (parameters.shared - exact.values) / exact.standard_errors
    assert 1e-4 < float(jnp.max(jnp.abs(distance))) < 0.2


def test_frozen_gain_with_iterated_updates_is_refused():
    with pytest.raises(InputError, match="one linearisation"):
        FilterError(FORCED, updates=2, frozen_gain=True)
