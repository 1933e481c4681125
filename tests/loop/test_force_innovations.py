"""Innovations under random forces equal a dense Gaussian, with forces that follow signals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from searched_spring import NOISE, STEP, Spring

from jaxid import OutputError, free, record
from jaxid._foundation.location import LocationKind
from jaxid.diagnosis.free_form import linear_models
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.problem import Problem
from jaxid.loop.dependence import COSINES, probes
from jaxid.loop.hypothesis import ForceNoise
from jaxid.loop.random_forces import (
    ForcedMotion,
    _cost_and_slope,
    estimate_forces,
    force_innovations,
    predicted_states,
)
from jaxid.models.free import Parameters
from jaxid.simulation.simulate import simulate

SAMPLES, DEVIATION, TIME = 24, 0.3, 0.7


def pushed(force):
    """Outputs of the spring at rest under a force in straight lines between the samples."""
    t = STEP * jnp.arange(SAMPLES)
    return simulate(Spring(1.5, 0.2), t, force[:, None], jnp.zeros(2)).y


def response():
    """Response of both outputs at all samples to the force at each sample."""
    return np.asarray(jax.jacfwd(pushed)(jnp.zeros(SAMPLES))).reshape(-1, SAMPLES)


def covariance(H, noise):
    """Joint covariance of all outputs under a force with a memory, and sensor noise."""
    t = STEP * np.arange(SAMPLES)
    memory = np.exp(-np.abs(t[:, None] - t[None]) / float(noise.time[0]))
    sensors = np.diag(np.tile(np.asarray(noise.sensors) ** 2, SAMPLES))
    return float(noise.deviation[0]) ** 2 * H @ memory @ H.T + sensors


def motion_of(rng):
    """One record with a missing sample, random residuals and columns, and the force's noise."""
    t, u = STEP * np.arange(SAMPLES), np.zeros((SAMPLES, 1))
    v, S = rng.normal(size=(SAMPLES, 2)), rng.normal(size=(SAMPLES, 2, 3))
    z = np.array(v)
    z[5, 0] = np.nan
    one = as_stack([record(t, u, z, inputs=("force",), outputs=("x", "v"))]).anonymous()
    model = Spring(jnp.array(1.5), jnp.array(0.2))
    case = Problem.of(model, free(model, per_record=("initial_state",)), one, OutputError())
    parameters = Parameters(jnp.zeros(0), jnp.zeros((1, 2)))
    noise = ForceNoise(jnp.array([DEVIATION]), jnp.array([TIME]), jnp.asarray(NOISE))
    linear = linear_models(case, parameters, ((LocationKind.EQUATION, ("v",)),))
    motion = ForcedMotion(linear, one.t, one.mask, jnp.asarray(v)[None], jnp.asarray(S)[None])
    return motion, noise, v, S, z


def test_innovations_equal_dense_gaussian():
    """Products of whitened columns equal those with the inverse of the joint covariance."""
    rng = np.random.default_rng(2)
    motion, noise, v, S, z = motion_of(rng)
    signal = jnp.asarray(rng.normal(size=(1, SAMPLES, 1)))
    columns = jnp.concatenate([motion.S, probes(motion.linear, signal)], axis=-1)
    white_v, white_S = force_innovations(motion._replace(S=columns), noise)

    H, valid = response(), np.isfinite(z).reshape(-1)
    inverse = np.linalg.inv(covariance(H, noise)[np.ix_(valid, valid)])
    s = np.asarray(signal)[0, :, 0]
    s = (s - np.min(s)) / np.ptp(s)
    functions = np.cos(np.pi * s[:, None] * np.arange(1, COSINES + 1))
    dense = np.concatenate([v.reshape(-1, 1), S.reshape(-1, 3), H @ functions], axis=1)[valid]
    white = np.concatenate([white_v[0][..., None], white_S[0]], axis=-1).reshape(-1, 4 + COSINES)
    assert white_S.shape[-1] == 3 + COSINES
    np.testing.assert_allclose(white.T @ white, dense.T @ inverse @ dense, rtol=1e-7, atol=1e-9)


def test_predicted_states_equal_conditional_means():
    """Means of the states given the residuals of the samples before, by the joint covariance."""
    motion, noise, v, _, z = motion_of(np.random.default_rng(4))
    H, valid = response(), np.isfinite(z).reshape(-1)
    C, residuals = covariance(H, noise), v.reshape(-1)
    sensors = np.diag(np.tile(np.asarray(noise.sensors) ** 2, SAMPLES))
    x = np.asarray(predicted_states(motion, noise) - motion.linear.x)[0]
    for k in (1, 6, SAMPLES - 1):
        known, now = np.flatnonzero(valid[: 2 * k]), slice(2 * k, 2 * k + 2)
        joint = (C - sensors)[now][:, known]  # the outputs are the states
        mean = joint @ np.linalg.solve(C[np.ix_(known, known)], residuals[known])
        np.testing.assert_allclose(x[k], mean, rtol=1e-9, atol=1e-12)


def test_cost_slope_and_step_of_forces_equal_dense_gaussian():
    motion, noise, v, S, z = motion_of(np.random.default_rng(3))
    found = estimate_forces(motion, 2, noise, longest=1e6)
    H, valid = response(), np.isfinite(z).reshape(-1)
    v, S = v.reshape(-1)[valid], S.reshape(-1, 3)[valid]

    def cost(logarithms, v=v):
        at = ForceNoise(logarithms[:1], logarithms[1:2], logarithms[2:])
        C = covariance(H, jax.tree.map(np.exp, at))[np.ix_(valid, valid)]
        return 0.5 * (v @ np.linalg.solve(C, v) + np.linalg.slogdet(C)[1])

    def after_best_step(logarithms):
        at = ForceNoise(logarithms[:1], logarithms[1:2], logarithms[2:])
        C = covariance(H, jax.tree.map(np.exp, at))[np.ix_(valid, valid)]
        weighted = np.linalg.solve(C, S)
        return cost(logarithms, v - S @ np.linalg.solve(S.T @ weighted, weighted.T @ v))

    start, end = (np.log(np.concatenate([np.asarray(p) for p in n])) for n in (noise, found.noise))
    (value, (before, _, _)), slope = _cost_and_slope(jax.tree.map(jnp.log, noise), motion, 2)
    assert float(value) == pytest.approx(after_best_step(start), rel=1e-9)
    assert float(before) == pytest.approx(cost(start), rel=1e-9)
    pairs = [(start + step, start - step) for step in 1e-5 * np.eye(start.size)]
    differences = [(after_best_step(up) - after_best_step(down)) / 2e-5 for up, down in pairs]
    np.testing.assert_allclose(np.concatenate([*slope]), differences, rtol=1e-5)
    assert found.cost == pytest.approx(cost(end), rel=1e-9)
    moved = v - S @ np.concatenate([found.own[0], found.shared])
    assert found.fall == pytest.approx(found.cost - cost(end, moved), rel=1e-7)
    assert after_best_step(end) < after_best_step(start)


def test_correlation_times_stay_within_the_longest():
    motion, noise, *_ = motion_of(np.random.default_rng(3))
    free = estimate_forces(motion, 2, noise, longest=1e6)
    bound = 0.5 * float(free.noise.time[0])
    found = estimate_forces(motion, 2, noise, longest=bound)
    assert float(found.noise.time[0]) == bound
    assert found.cost - found.fall > free.cost - free.fall


def test_forces_are_found_from_where_the_first_trial_has_no_finite_cost(monkeypatch):
    """The first trial of L-BFGS-B goes to the bounds, where the filter overflows."""
    motion, noise, *_ = motion_of(np.random.default_rng(3))
    least, begin = 0.5, np.log(np.concatenate([np.asarray(part) for part in noise]))

    def parabola(logarithms: ForceNoise, motion, own):
        moved = np.concatenate([np.asarray(part) for part in logarithms]) - begin
        cost = np.sum((moved - least) ** 2) if np.max(np.abs(moved)) < 2.0 else np.inf
        slope = np.split(2.0 * (moved - least), np.cumsum([p.size for p in noise])[:-1])
        return (cost, (cost, np.zeros((1, 2)), np.zeros(1))), ForceNoise(*slope)

    monkeypatch.setattr("jaxid.loop.random_forces._cost_and_slope", parabola)
    found = estimate_forces(motion, 2, noise, longest=1e6)
    end = np.log(np.concatenate([np.asarray(part) for part in found.noise]))
    np.testing.assert_allclose(end - begin, least, atol=1e-2)
