"""Fits and predictions between two programs of the model equal those in one program."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import SIGMA, Spring, fly

from jaxid import OutputError, close_loop, estimate, free, simulate
from jaxid.data import split_at, stack
from jaxid.diagnosis.free_form import linear_models
from jaxid.diagnosis.validation import Predictor, predict
from jaxid.effects.equation import Term
from jaxid.estimation import problem as estimation_problem
from jaxid.estimation.estimate import as_stack, checked_case, fit_problem
from jaxid.estimation.host_iteration import fit_by_steps
from jaxid.estimation.model_programs import PROGRAMS
from jaxid.estimation.problem import Problem
from jaxid.estimation.shared_programs import estimate_case, evaluate
from jaxid.estimation.solver import GaussNewton
from jaxid.models import FixedNoise, Parameters
from jaxid.models.base import canonical

CUBIC = Term("v", "x^3", jnp.array(-0.3))
SAMPLES = 200
MOST_OF_STUDY = 45  # chosen; 39 are compiled, 81 before small operations were NumPy's


@pytest.fixture(scope="module")
def records():
    return [fly(seed, CUBIC, samples=SAMPLES)[0] for seed in range(40, 45)]


@pytest.mark.parametrize("chord", [False, True])
def test_fit_by_steps_equals_fit_in_one_program(records, chord):
    model = Spring(jnp.array(1.5), jnp.array(0.2))
    chosen = free(model, "k", "c", per_record=["initial_state"], prior={"k": (1.2, 0.5)})
    problem = Problem.of(model, chosen, as_stack(records[:2]), OutputError())
    begin = Parameters(jnp.array([1.5, 0.2]), jnp.zeros((2, 2)))
    solver = GaussNewton(chord=chord)
    ours = fit_by_steps(problem, begin, solver)
    theirs = fit_problem(problem, begin, solver)
    assert bool(ours.result == theirs.result)
    np.testing.assert_allclose(ours.cost, theirs.cost, rtol=1e-10)
    for name in ("covariance", "own_covariance", "robust_covariance", "noise"):
        scale = np.max(np.abs(getattr(theirs, name)))
        np.testing.assert_allclose(
            getattr(ours, name), getattr(theirs, name), rtol=1e-5, atol=1e-5 * scale, err_msg=name
        )
    # Both ends lie within the solver's tolerance of 1e-6 standard errors of the minimum.
    error = np.sqrt(np.diagonal(theirs.covariance))
    moved = np.asarray(ours.parameters.shared) - np.asarray(theirs.parameters.shared)
    np.testing.assert_array_less(np.abs(moved) / error, 1e-5)


@pytest.mark.parametrize("kept_bytes", [16_000_000, 1])
def test_case_by_shared_programs_equals_estimate(records, monkeypatch, kept_bytes):
    """With one byte the records are taken one at a time, in one program."""
    monkeypatch.setattr(estimation_problem, "KEPT_BYTES", kept_bytes)
    model = Spring(jnp.array(1.5), jnp.array(0.2))
    chosen = free(model, "k", "c", per_record=["initial_state"], prior={"k": (1.2, 0.5)})
    case = checked_case(model, chosen, records[:2], OutputError())
    cost, linearised = evaluate(case, case.begin)
    # not the compiled function of other tests: `KEPT_BYTES` is no argument
    whole, expected = eqx.filter_jit(lambda case: case.problem.evaluate(case.begin))(case)
    np.testing.assert_allclose(cost, whole, rtol=1e-12)
    np.testing.assert_allclose(
        np.abs(linearised.information.factor), np.abs(expected.information.factor), rtol=1e-9
    )
    ours = estimate_case(case)
    theirs = estimate(model, chosen, records[:2], OutputError())
    moved = np.asarray(ours.values) - np.asarray(theirs.values)
    np.testing.assert_array_less(np.abs(moved / theirs.standard_errors), 1e-5)
    scale = np.max(np.abs(theirs.covariance))
    np.testing.assert_allclose(ours.covariance, theirs.covariance, rtol=1e-5, atol=1e-5 * scale)


@pytest.mark.parametrize("window", [None, 30])
def test_prediction_starts_at_estimate_of_window(records, window):
    """Three records in groups of two, as if there were two training records."""
    model = Spring(jnp.array(1.4), jnp.array(0.25))
    likelihood = OutputError(FixedNoise(jnp.array([SIGMA**2])))
    stacked = stack(records[:3])
    starts = tuple(f"initial_state.{name}" for name in model.states)
    predictor = Predictor(likelihood, window, starts, 2)
    ours = predictor.predict(canonical(model), stacked.anonymous())
    together = predict(model, stacked, likelihood, window=window)
    for k, one in enumerate(records[:3]):
        if window is None:
            start = np.asarray(model.initial_state(one))
        else:
            first, _ = split_at(one, window)
            chosen = free(model, per_record=["initial_state"])
            start = np.asarray(estimate(model, chosen, first, likelihood).own[0])
        y = simulate(model, one.t, one.u, initial_state=start).y
        scale = np.max(np.abs(y))
        np.testing.assert_allclose(ours.initial_state[k], start, atol=1e-6 * scale)
        np.testing.assert_allclose(ours.y[k], y, atol=1e-6 * scale)
        np.testing.assert_allclose(together.y[k], y, atol=1e-6 * scale)
    after = np.arange(SAMPLES) >= (window or 0)
    expected = np.asarray(stacked.mask) & after[None, :, None]
    np.testing.assert_array_equal(ours.scored, expected)


def test_study_holds_its_model_in_four_programs(records, compilations):
    """One of the outputs, one of the sensitivities, one of those in the window, and the linear
    model. All others are small, and few: what surrounds them is computed by NumPy.
    """
    jax.clear_caches()  # programs that another module compiled are not counted
    programs = (*PROGRAMS, linear_models)
    for program in programs:
        program.clear()
    model = Spring(jnp.array(1.5), jnp.array(0.2))
    study = close_loop(
        model,
        free(model, "k", "c", per_record=["initial_state"]),
        OutputError(),
        train=records[:2],
        check=records[2:4],
        test=records[4:],
        effects=(Term("v", "x^2"), Term("v", "x^3")),
        window=30,
    )
    assert study.effects == ("x^3 in v",)
    assert [len(program.known) for program in programs] == [1, 2, 1]
    assert len(compilations) <= MOST_OF_STUDY, compilations
