"""Innovations under random forces equal a dense Gaussian, with forces that follow signals."""

import jax
import jax.numpy as jnp
import numpy as np
from searched_spring import NOISE, STEP, Spring

from jaxid import OutputError, free, record
from jaxid._foundation.location import LocationKind
from jaxid.diagnosis.free_form import linear_models
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.problem import Problem
from jaxid.loop.hypothesis import ForceNoise
from jaxid.loop.random_forces import FUNCTIONS, ForcedMotion, force_innovations
from jaxid.models.free import Parameters
from jaxid.simulation.simulate import simulate

SAMPLES, DEVIATION, TIME = 24, 0.3, 0.7


def pushed(force):
    """Outputs of the spring at rest under a force in straight lines between the samples."""
    t = STEP * jnp.arange(SAMPLES)
    return simulate(Spring(1.5, 0.2), t, force[:, None], jnp.zeros(2)).y


def test_innovations_equal_dense_gaussian():
    """Products of whitened columns equal those with the inverse of the joint covariance."""
    rng = np.random.default_rng(2)
    t, u = STEP * np.arange(SAMPLES), np.zeros((SAMPLES, 1))
    v, S = rng.normal(size=(SAMPLES, 2)), rng.normal(size=(SAMPLES, 2, 3))
    z = np.array(v)
    z[5, 0] = np.nan
    one = as_stack([record(t, u, z, inputs=("force",), outputs=("x", "v"))]).anonymous()
    model = Spring(jnp.array(1.5), jnp.array(0.2))
    case = Problem.of(model, free(model, per_record=("initial_state",)), one, OutputError())
    parameters = Parameters(jnp.zeros(0), jnp.zeros((1, 2)))
    noise = ForceNoise(jnp.array([DEVIATION]), jnp.array([TIME]), jnp.asarray(NOISE))
    signal = jnp.asarray(rng.normal(size=(1, SAMPLES, 1)))
    places = ((LocationKind.EQUATION, ("v",)),)
    linear = linear_models(case, parameters, places)
    motion = ForcedMotion(linear, one.t, one.mask, jnp.asarray(v)[None], jnp.asarray(S)[None])
    white_v, white_S, probes = force_innovations(motion, noise, signal)

    H = np.asarray(jax.jacfwd(pushed)(jnp.zeros(SAMPLES))).reshape(-1, SAMPLES)
    memory = np.exp(-np.abs(t[:, None] - t[None]) / TIME)
    covariance = DEVIATION**2 * H @ memory @ H.T + np.diag(np.tile(NOISE**2, SAMPLES))
    valid = np.isfinite(z).reshape(-1)
    inverse = np.linalg.inv(covariance[np.ix_(valid, valid)])
    s = np.asarray(signal)[0, :, 0] - np.mean(np.asarray(signal))
    s = s / np.max(np.abs(s))
    functions = np.stack([s**2, s**3, np.abs(s) * s, np.tanh(10.0 * s)], axis=1)
    dense = np.concatenate([v.reshape(-1, 1), S.reshape(-1, 3), H @ functions], axis=1)[valid]
    white = np.concatenate([white_v[0][..., None], white_S[0], probes[0]], axis=-1).reshape(-1, 8)
    assert probes.shape[-1] == len(FUNCTIONS)
    np.testing.assert_allclose(white.T @ white, dense.T @ inverse @ dense, rtol=1e-7, atol=1e-9)
