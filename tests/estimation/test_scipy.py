"""Estimates, standard errors and R equal an independent code in NumPy and SciPy; derivatives equal
three others.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from compiled_problem import cost, linearise, outputs, sensitivities
from reference_estimation import (
    Lag,
    Pendulum,
    as_records,
    complex_step,
    estimate_by_scipy,
    pendulum_records,
    pendulum_rhs,
    rk4,
)

from jaxid.data import record, stack
from jaxid.estimation import GaussNewton, OutputError, estimate, host_iteration
from jaxid.estimation.limits import Limits
from jaxid.estimation.model_programs import PROGRAMS
from jaxid.estimation.problem import Problem
from jaxid.models import DiagonalNoise, FixedNoise, FullNoise, Parameters, free
from jaxid.models.base import canonical
from jaxid.simulation import RK4, ZeroOrder

KNOWN = np.array([[4e-4, 5e-4], [5e-4, 3e-3]])

NOISES = {
    "diagonal, gaps": (
        DiagonalNoise(),
        True,
        lambda v, valid: np.diag(np.sum(v**2, axis=0) / np.sum(valid, axis=0)),
    ),
    "full": (FullNoise(), False, lambda v, valid: v.T @ v / len(v)),
    "fixed and full": (FixedNoise(KNOWN), False, lambda v, valid: KNOWN),
    "fixed, gaps": (
        FixedNoise(np.diagonal(KNOWN)),
        True,
        lambda v, valid: np.diag(np.diagonal(KNOWN)),
    ),
}


def predict_joint(made):
    """All outputs as a function of columns (shared, initial state of record 0, of record 1)."""

    def predict(theta):
        rows = [
            rk4(pendulum_rhs, t, u, theta[3 + 2 * i : 5 + 2 * i], theta[:3])
            for i, (t, u, _) in enumerate(made)
        ]
        return np.concatenate(rows)

    return predict


SOLVERS = {"every step": GaussNewton(), "chord": GaussNewton(chord=True)}


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("case", NOISES)
def test_estimate_equals_scipy_least_squares(case, solver, seed):
    noise, gaps, covariance = NOISES[case]
    made = pendulum_records(np.random.default_rng(seed), gaps)
    begin = np.array([3.5, 0.2, 1.2, 0.3, 0.1, -0.1, 0.8])
    theirs = estimate_by_scipy(
        predict_joint(made), np.concatenate([z for _, _, z in made]), begin, covariance
    )
    model = Pendulum(stiffness=3.5, damping=0.2, torque=1.2)
    chosen = free(model, "stiffness", "damping", "torque", per_record=("initial_state",))
    ours = estimate(
        model, chosen, as_records(made, model), OutputError(noise=noise), solver=SOLVERS[solver]
    )
    assert bool(ours.successful), ours.status
    np.testing.assert_allclose(ours.values, theirs.theta[:3], rtol=1e-6)
    np.testing.assert_allclose(ours.own.reshape(-1), theirs.theta[3:], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(ours.standard_errors, theirs.errors[:3], rtol=1e-6)
    np.testing.assert_allclose(ours.own_errors.reshape(-1), theirs.errors[3:], rtol=1e-6)
    np.testing.assert_allclose(ours.noise, theirs.R, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(ours.cost, theirs.cost, rtol=1e-9)


def problem_of(model, chosen, records, likelihood):
    records = stack(records)
    model = canonical(model)
    return Problem(
        model, chosen.positions(model), records, likelihood, Limits.of(chosen, records.n_cases)
    )


def test_known_sensitivities_save_first_pass_and_change_nothing(seed, monkeypatch):
    """With NaN for them they are made; with those of the start, none are made before the first
    step; the answer is one.
    """
    made = pendulum_records(np.random.default_rng(seed), gaps=True)
    model = Pendulum(stiffness=3.5, damping=0.2, torque=1.2)
    chosen = free(model, "stiffness", "damping", "torque", per_record=("initial_state",))
    problem = problem_of(model, chosen, as_records(made, model), OutputError())
    begin = Parameters(jnp.array([3.5, 0.2, 1.2]), jnp.array([[0.3, 0.1], [-0.1, 0.8]]))
    solver = GaussNewton(chord=True)
    _, S = sensitivities(problem, begin)
    passes, results = [], []

    def counted(*arguments):
        passes.append(1)
        return PROGRAMS.sensitivities(*arguments)

    counting = PROGRAMS._replace(sensitivities=counted)
    monkeypatch.setattr(host_iteration, "PROGRAMS", counting)
    for known in (jnp.full(S.shape, jnp.nan, float), S):
        passes.clear()
        end = host_iteration.minimise_by_steps(problem, begin, solver, known)
        ours, state = end.parameters, end.state
        assert bool(state.converged)
        assert len(passes) < int(state.accepted), "old sensitivities served for no step"
        results.append((ours, state.linearised.S, len(passes)))
    (ours, final, count), (theirs, also, fewer) = results
    assert fewer == count - 1
    np.testing.assert_allclose(theirs.shared, ours.shared, rtol=1e-12)
    np.testing.assert_allclose(also, final, rtol=1e-9, atol=1e-12)


def test_sensitivities_equal_complex_steps_and_finite_differences(seed):
    made = pendulum_records(np.random.default_rng(seed), gaps=True)
    model = Pendulum(stiffness=3.5, damping=0.2, torque=1.2)
    chosen = free(model, "stiffness", "damping", "torque", per_record=("initial_state",))
    problem = problem_of(model, chosen, as_records(made, model), OutputError())
    theta, own = np.array([3.5, 0.2, 1.2]), np.array([[0.3, 0.1], [-0.1, 0.8]])
    at = Parameters(jnp.asarray(theta), jnp.asarray(own))
    v, S = sensitivities(problem, at)
    for i, (t, u, z) in enumerate(made):
        y, expected = complex_step(
            lambda p, t=t, u=u: rk4(pendulum_rhs, t, u, p[:2], p[2:]), np.r_[own[i], theta]
        )
        np.testing.assert_allclose(S[i, : len(t)], expected, rtol=1e-10, atol=1e-11)
        np.testing.assert_allclose(
            v[i, : len(t)], np.where(np.isnan(z), 0.0, z - y), rtol=0, atol=1e-12
        )
    # Central differences of jaxid's own outputs: the rounding and the curvature of h = 1e-5 leave
    # about 1e-9.
    h = 1e-5
    for k in range(3):
        up, down = (Parameters(at.shared.at[k].add(sign * h), at.rows) for sign in (1, -1))
        difference = (outputs(problem, up) - outputs(problem, down)) / (2 * h)
        np.testing.assert_allclose(
            S[..., 2 + k], difference, rtol=0, atol=1e-8 * np.max(np.abs(difference))
        )


def test_gradient_of_information_equals_gradient_of_cost(seed):
    """With R re-estimated, `S'R^-1 v` at its own R is the exact gradient of the concentrated
    likelihood (Eq. 4.17).
    """
    made = pendulum_records(np.random.default_rng(seed), gaps=False)
    model = Pendulum(stiffness=3.5, damping=0.2, torque=1.2)
    chosen = free(
        model, "stiffness", "damping", per_record=("initial_state",), prior={"damping": (0.3, 0.1)}
    )
    at = Parameters(jnp.array([3.5, 0.2]), jnp.array([[0.3, 0.1], [-0.1, 0.8]]))
    h = 1e-5
    for noise in (DiagonalNoise(), FullNoise(), FixedNoise(KNOWN)):
        problem = problem_of(model, chosen, as_records(made, model), OutputError(noise=noise))
        shared, own = linearise(problem, at).information.gradient()
        for k in range(2):
            up, down = (
                cost(problem, Parameters(at.shared.at[k].add(s * h), at.rows)) for s in (1, -1)
            )
            np.testing.assert_allclose(shared[k], (up - down) / (2 * h), rtol=1e-6)
        up, down = (
            cost(problem, Parameters(at.shared, at.rows.at[1, 0].add(s * h))) for s in (1, -1)
        )
        np.testing.assert_allclose(own[1, 0], (up - down) / (2 * h), rtol=1e-6)


def test_sensitivities_of_lag_equal_closed_form():
    """First-order lag under a step: `x = x0 e + b/p (1 - e)`, `e = exp(-p t)`; four substeps leave
    1e-10.
    """
    p, b, x0 = 1.3, 0.7, 0.4
    t = 0.02 * np.arange(120)
    model = Lag(p=p, b=b)
    chosen = free(model, "p", "b", per_record=("initial_state",))
    likelihood = OutputError(hold=ZeroOrder(), stepper=RK4(4, unrolled=False))
    made = [record(t, np.ones(120), np.zeros(120), inputs=("u",), outputs=("x",))]
    v, S = sensitivities(
        problem_of(model, chosen, made, likelihood),
        Parameters(jnp.array([p, b]), jnp.array([[x0]])),
    )
    e = np.exp(-p * t)
    y = x0 * e + b / p * (1 - e)
    columns = [e, -t * e * (x0 - b / p) - b / p**2 * (1 - e), (1 - e) / p]
    np.testing.assert_allclose(-v[0, :, 0], y, rtol=0, atol=1e-9)
    np.testing.assert_allclose(S[0, :, 0], np.stack(columns, -1), rtol=0, atol=1e-9)
