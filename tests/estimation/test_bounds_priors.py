"""Bounds are respected and reported; a prior is one more measurement."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from compiled_problem import linearise
from reference_estimation import Lag, lag_rhs, rk4
from scipy.signal import lfilter
from static_line import Line

from jaxid._foundation.results import RESULTS
from jaxid.data import Record, record
from jaxid.estimation import GaussNewton, OutputError, estimate
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.problem import Problem
from jaxid.estimation.spectrum_policy import Clip, Damp, Truncate, TwoStep
from jaxid.models import FixedNoise, LinearModel, free
from jaxid.models.free import Parameters

SIGMA = 0.05


def lag_record(seed, n=150, p=1.5, b=2.0, x0=0.3):
    t = 0.05 * np.arange(n)
    u = np.sign(np.sin(1.1 * t))
    z = rk4(lag_rhs, t, u, np.array([x0]), np.array([p, b]))
    z = z + SIGMA * np.random.default_rng(seed).normal(size=z.shape)
    return record(t, u, z, inputs=("u",), outputs=("x",))


KNOWN = OutputError(noise=FixedNoise([SIGMA**2]))


@pytest.mark.parametrize(("low", "high", "edge"), [(2.0, None, 2.0), (None, 1.2, 1.2)])
def test_parameter_on_bound_is_held_and_reported(seed, low, high, edge):
    data, start = lag_record(seed), 2.5 if low else 1.0
    model = Lag(p=start, b=1.0)
    chosen = free(model, "p", "b", per_record=("initial_state",), bounds={"p": (low, high)})
    result = estimate(model, chosen, data, KNOWN)
    assert "on its bound" in result.status
    assert bool(result.successful)
    assert result.value("p") == edge
    assert np.isnan(result.standard_error("p"))
    fixed = Lag(p=edge, b=1.0)
    other = estimate(fixed, free(fixed, "b", per_record=("initial_state",)), data, KNOWN)
    np.testing.assert_allclose(result.value("b"), other.value("b"), rtol=1e-8)
    np.testing.assert_allclose(result.standard_error("b"), other.standard_error("b"), rtol=1e-8)
    np.testing.assert_allclose(result.own, other.own, rtol=1e-8)
    np.testing.assert_allclose(result.own_errors, other.own_errors, rtol=1e-8)


@pytest.mark.parametrize("policy", [Clip(), Truncate(), TwoStep(), Damp()])
def test_fit_ends_where_every_parameter_is_on_a_bound(policy):
    """No direction is left; the residual, which stays large, is none."""
    u = np.sin(0.3 * np.arange(100))
    data = record(0.1 * np.arange(100), u, 2.0 * u + 0.5, inputs=("u",), outputs=("y",))
    model = Line(jnp.array(1.0), jnp.array(0.0))
    chosen = free(model, "slope", "level", bounds={"slope": (0.0, 1.2), "level": (-1.0, 0.2)})
    result = estimate(model, chosen, data, KNOWN, solver=GaussNewton(policy=policy))
    assert result.values.tolist() == [1.2, 0.2]
    assert "on its bound" in result.status
    assert bool(result.successful)
    assert result.iterations < 10


def test_parameter_without_effect_is_reported_as_undetermined():
    data = record(0.1 * np.arange(50), np.zeros(50), np.ones(50), inputs=("u",), outputs=("y",))
    model = Line(jnp.array(1.0), jnp.array(0.0))
    result = estimate(model, free(model, "slope"), data, KNOWN)
    assert "do not determine" in result.status
    assert np.isinf(result.standard_error("slope"))
    assert result.iterations < 10


def test_record_that_is_fitted_exactly_determines_its_parameters():
    u = np.sin(0.3 * np.arange(100))
    data = record(0.1 * np.arange(100), u, 2.0 * u + 0.5, inputs=("u",), outputs=("y",))
    model = Line(jnp.array(2.0), jnp.array(0.5))
    result = estimate(model, free(model, "slope", "level"), data, OutputError())
    assert result.status == "converged"
    np.testing.assert_allclose(result.values, [2.0, 0.5], rtol=1e-12)
    assert np.all(np.asarray(result.standard_errors) < 1e-12)


def test_inactive_bound_changes_nothing(seed):
    data, model = lag_record(seed), Lag(p=1.0, b=1.0)
    inside = estimate(model, free(model, "p", "b", bounds={"p": (0.0, 5.0)}), data, KNOWN)
    without = estimate(model, free(model, "p", "b"), data, KNOWN)
    assert inside.status == "converged"
    np.testing.assert_allclose(inside.values, without.values, rtol=1e-9)
    np.testing.assert_allclose(inside.standard_errors, without.standard_errors, rtol=1e-9)


def test_start_on_bound_can_leave_bound(seed):
    data, model = lag_record(seed), Lag(p=0.5, b=1.0)
    result = estimate(model, free(model, "p", "b", bounds={"p": (0.5, None)}), data, KNOWN)
    assert result.status == "converged"
    assert abs(result.value("p") - 1.5) < 5 * result.standard_error("p")


def static(gain):
    """Return the model `y = D u`; its state has no effect and stays zero."""
    return LinearModel(
        [[-1.0]], [[0.0]], [[0.0]], [[gain]], states=("x",), inputs=("u",), outputs=("y",)
    )


def static_record(seed, gain=2.0):
    rng = np.random.default_rng(seed)
    u = rng.normal(size=40)
    return (
        u,
        (z := gain * u + SIGMA * rng.normal(size=40)),
        record(np.arange(40.0), u, z, inputs=("u",), outputs=("y",)),
    )


def test_prior_equals_measurement_of_parameter(seed):
    u, z, data = static_record(seed)
    mean, deviation = 2.1, 0.01
    model = static(0.0)
    result = estimate(model, free(model, "D", prior={"D[0,0]": (mean, deviation)}), data, KNOWN)
    information = u @ u / SIGMA**2 + 1 / deviation**2
    np.testing.assert_allclose(
        result.values, (u @ z / SIGMA**2 + mean / deviation**2) / information, rtol=1e-10
    )
    np.testing.assert_allclose(result.standard_errors, information**-0.5, rtol=1e-10)
    # The same as one more sample of unit input, measured with the prior's deviation.
    v = z - u * result.value("D[0,0]")
    prior = ((result.value("D[0,0]") - mean) / deviation) ** 2
    np.testing.assert_allclose(
        result.cost, 0.5 * v @ v / SIGMA**2 + 0.5 * prior + 40 * np.log(SIGMA), rtol=1e-10
    )


def test_corrected_error_contains_error_of_prior(seed):
    """`V = C (S' Gamma S + T) C`, with `S' Gamma S` from an estimate without the prior, whose mean
    is that estimate.

    The residuals are those of the other estimate. Their loss of power is smaller under the prior,
    by less than 3 % of 400 samples.
    """
    rng, rows = np.random.default_rng(seed), 400
    u = np.sin(0.05 * np.arange(rows))
    z = 2.0 * u + SIGMA * lfilter([0.6], [1.0, -0.8], rng.normal(size=rows + 100))[100:]
    data, model = record(np.arange(1.0 * rows), u, z, inputs=("u",), outputs=("y",)), static(0.0)
    plain = estimate(model, free(model, "D"), data, KNOWN)
    error, deviation = float(plain.standard_errors[0]), 0.5 * float(plain.standard_errors[0])
    prior = {"D[0,0]": (plain.value("D[0,0]"), deviation)}
    fit = estimate(model, free(model, "D", prior=prior), data, KNOWN)
    C = 1.0 / (1.0 / error**2 + 1.0 / deviation**2)
    of_data = float(plain.corrected_errors[0]) ** 2 / error**4
    variance = C**2 * (of_data + 1.0 / deviation**2)
    np.testing.assert_allclose(fit.corrected_errors, np.sqrt(variance), rtol=0.03)
    # The priors' share of the variance is known.
    dof = float(plain.corrected_dof[0]) * (variance / (C**2 * of_data)) ** 2
    np.testing.assert_allclose(fit.corrected_dof, dof, rtol=0.1)


def test_prior_determines_parameter_without_data(seed):
    """The estimate of an unobserved input matrix is its prior, and no direction is weak."""
    _, _, data = static_record(seed)
    model = static(0.0)
    result = estimate(model, free(model, "B", "D", prior={"B[0,0]": (0.7, 0.2)}), data, KNOWN)
    np.testing.assert_allclose(result.value("B[0,0]"), 0.7, rtol=1e-9)
    np.testing.assert_allclose(result.standard_error("B[0,0]"), 0.2, rtol=1e-9)


def test_prior_moves_parameter_off_bound_against_data(seed):
    u, z, data = static_record(seed, gain=-0.1)
    model = static(0.0)
    prior = {"D[0,0]": (0.5, 0.002)}
    result = estimate(
        model, free(model, "D", bounds={"D[0,0]": (0.0, None)}, prior=prior), data, KNOWN
    )
    information = u @ u / SIGMA**2 + 1 / 0.002**2
    expected = (u @ z / SIGMA**2 + 0.5 / 0.002**2) / information
    assert expected > 0
    assert result.status == "converged"
    np.testing.assert_allclose(result.values, expected, rtol=1e-9)


def test_bound_on_per_record_parameter_is_respected(seed):
    data, model = lag_record(seed, x0=0.3), Lag(p=1.0, b=1.0)
    bounds = {"initial_state.x": (None, 0.0)}
    result = estimate(
        model, free(model, "p", "b", per_record=("initial_state",), bounds=bounds), data, KNOWN
    )
    assert float(result.own[0, 0]) == 0.0
    at_zero = estimate(_FromZero(p=1.0, b=1.0), free(model, "p", "b"), data, KNOWN)
    np.testing.assert_allclose(result.values, at_zero.values, rtol=1e-8)
    np.testing.assert_allclose(result.standard_errors, at_zero.standard_errors, rtol=1e-8)
    assert "on its bound" in result.status
    assert np.isnan(result.own_errors[0, 0])


class _FromZero(Lag):
    """The lag from rest."""

    def initial_state(self, record):
        return 0.0 * record.z[0]


@pytest.fixture(scope="module")
def two_active_bounds():
    """400 draws of `y = D u` with four correlated inputs, two elements of D held by their bounds in
    every draw.
    """
    draw, rows = np.random.default_rng(3), 60
    u = draw.normal(size=(rows, 1)) + 0.25 * draw.normal(size=(rows, 4))
    z = u @ [1.0, -1.0, 2.0, 0.5] + 0.2 * np.random.default_rng(1).normal(size=(400, rows))
    names = tuple("abcd")
    start = [[3.0, -3.0, 0.0, 0.0]]
    model = LinearModel(
        [[-1.0]], [[0.0] * 4], [[0.0]], start, states=("x",), inputs=names, outputs=("y",)
    )
    chosen = free(model, "D", bounds={"D[0,0]": (1.5, None), "D[0,1]": (None, -1.5)})
    t, mask, units = jnp.arange(rows * 1.0), jnp.ones((rows, 1), bool), ("",) * 4

    def one(z):
        data = Record(t, jnp.asarray(u), z[:, None], mask, {}, names, ("y",), units, ("",), ("",))
        return estimate(model, chosen, data, OutputError())

    return eqx.filter_jit(eqx.filter_vmap(one))(jnp.asarray(z)), one, z, u


def test_draws_with_two_active_bounds_end_on_both(two_active_bounds):
    """A step that is clipped and no more left 1 % of the draws within rounding of a bound, and 2 %
    without convergence.
    """
    result, *_ = two_active_bounds
    assert bool(jnp.all(result.result == RESULTS.at_bound))
    np.testing.assert_array_equal(result.values[:, :2], np.broadcast_to([1.5, -1.5], (400, 2)))
    assert bool(jnp.all(jnp.isnan(result.standard_errors[:, :2])))
    assert bool(jnp.all(jnp.isnan(result.corrected_errors[:, :2])))
    assert bool(jnp.all(jnp.isfinite(result.standard_errors[:, 2:])))
    assert bool(jnp.all(result.on_bound[:, :2]))
    assert not bool(jnp.any(result.on_bound[:, 2:]))
    np.testing.assert_array_equal(result.degrees_of_freedom, 58)


def test_free_parameters_with_active_bounds_equal_least_squares(two_active_bounds):
    result, _, z, u = two_active_bounds
    expected = np.linalg.lstsq(u[:, 2:], (z - u[:, :2] @ [1.5, -1.5]).T, rcond=None)[0].T
    np.testing.assert_allclose(result.values[:, 2:], expected, rtol=1e-6)


def test_parameter_on_bound_is_not_listed_as_weak(two_active_bounds):
    _, one, z, _ = two_active_bounds
    result = one(jnp.asarray(z[0]))
    assert result.weak_directions == ()
    assert np.asarray(result.on_bound).tolist() == [True, True, False, False]
    text = str(result)
    assert "not determined" not in text
    assert "bounds: D[0,0], D[0,1] on the bound, without a standard error" in text
    assert "their intervals can cover less than they state" in text


def test_parameter_near_bound_is_named_in_print(seed):
    data, model = lag_record(seed), Lag(p=1.0, b=1.0)
    free_of = estimate(model, free(model, "p", "b"), data, KNOWN)
    edge = free_of.value("p") + free_of.standard_error("p")
    result = estimate(model, free(model, "p", "b", bounds={"p": (None, edge)}), data, KNOWN)
    assert result.status == "converged"
    assert "bounds: p within 2 standard errors of the bound" in str(result)
    assert "bounds:" not in str(free_of)


@pytest.mark.parametrize("edge", [0.0, 3.0, -1e6])
def test_value_within_rounding_of_bound_is_set_to_bound(edge):
    model = static(edge)
    chosen = free(model, "D", bounds={"D[0,0]": (edge, None)})
    _, _, data = static_record(0)
    problem = Problem.of(model, chosen, as_stack(data), KNOWN)
    information = linearise(problem, Parameters(jnp.array([edge]), jnp.zeros((1, 0)))).information
    # Held by the bound, a parameter has no information; off the bound it has.
    off = linearise(problem, Parameters(jnp.array([edge + 1.0]), jnp.zeros((1, 0)))).information
    inside = Parameters(
        jnp.array([edge + 2 * abs(np.spacing(edge) if edge else 1e-13)]), jnp.zeros((1, 0))
    )
    assert float(problem.project(inside, off, 1e-9).shared[0]) == edge
    assert bool(jnp.isfinite(problem.project(inside, information, 1e-9).shared[0]))
    away = Parameters(jnp.array([edge + 0.5]), jnp.zeros((1, 0)))
    assert float(problem.project(away, off, 1e-9).shared[0]) == edge + 0.5


def test_size_of_one_parameter_hides_no_other(seed):
    """A size, 1e5 standard errors long here, brings one column to the length of the others."""
    data, model = lag_record(seed), Lag(p=1.0, b=1.0)
    precise = OutputError(noise=FixedNoise([(1e-4 * SIGMA) ** 2]))
    plain = estimate(model, free(model, "p", "b"), data, precise)
    sized = estimate(model, free(model, "p", "b", scale={"p": 1.5}), data, precise)
    np.testing.assert_allclose(sized.values, plain.values, rtol=1e-6)
    np.testing.assert_allclose(sized.standard_errors, plain.standard_errors, rtol=1e-6)


class TwoOffsets(Lag):
    """Only the sum of an offset of all records and of one of each is measured."""

    shared: jnp.ndarray = eqx.field(default_factory=lambda: jnp.zeros(()))
    own: jnp.ndarray = eqx.field(default_factory=lambda: jnp.zeros(()))

    def output(self, t, x, u):
        return x + self.shared + self.own


def test_own_parameter_that_shared_ones_leave_open_has_no_error(seed):
    """With a prior on the shared offset its error is the prior's, and without one infinite;
    the error of the initial state, known apart from both, stays finite.
    """
    model, data = TwoOffsets(p=1.5, b=2.0), [lag_record(seed), lag_record(seed + 1)]
    for prior, expected in (({"shared": (0.0, 0.5)}, 0.5), ({}, np.inf)):
        chosen = free(model, "b", "shared", per_record=("own",), prior=prior)
        result = estimate(model, chosen, data, KNOWN)
        np.testing.assert_allclose(result.own_errors[:, 0], expected, rtol=1e-2)
        np.testing.assert_allclose(result.corrected_own_errors[:, 0], expected, rtol=0.2)
    chosen = free(model, "b", "shared", per_record=("own", "initial_state"))
    errors = np.asarray(estimate(model, chosen, data, KNOWN).own_errors)
    np.testing.assert_array_equal(np.isfinite(errors), [[False, True]] * 2)
