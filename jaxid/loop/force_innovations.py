"""Innovations of residuals and sensitivities under random forces: generalised least squares along
the motion without forces.

    dx_(i+1) = Phi_i dx_i + P_i d_i + Q_i d_(i+1),    v_i = C_i dx_i + D_i d_i + e_i
    d_(i+1) = a d_i + sqrt(1 - a^2) s w_i,    a = exp(-h / T)

(Kalman, J. Basic Engineering 82, 1960.) The filter that whitens the residual whitens the
sensitivity to every candidate as well, and the response to a force that follows a signal. A random
force follows none.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from .._foundation.compiler import fast_compile_jit
from .._foundation.types import Array, Bool, Float
from ..diagnosis.free_form import Linear, Places, answers, linear_model
from ..estimation.problem import Problem
from ..models.free import Parameters

# Chosen: steepness of the function that stands for the sign of a signal, in its range.
SIGN_STEEPNESS = 10.0
FUNCTIONS = ("square", "cube", "signed square", "sign")


class ForceNoise(NamedTuple):
    """Parameters of random forces and white sensor noise.

    Attributes:
        deviation, time: standard deviation and correlation time of the force at each place.
        sensors: standard deviation of the noise of each sensor.
    """

    deviation: Float[Array, " place"]
    time: Float[Array, " place"]
    sensors: Float[Array, " output"]


@fast_compile_jit
def force_innovations(
    problem: Problem,
    parameters: Parameters,
    places: Places,
    noise: ForceNoise,
    v: Float[Array, "case time output"],
    S: Float[Array, "case time output column"],
    signals: Float[Array, "case time signal"],
) -> tuple[
    Float[Array, "case time output"],
    Float[Array, "case time output column"],
    Float[Array, "case time output probe"],
]:
    """Return the whitened innovations of residuals, sensitivities, and responses to forces that
    follow signals, place by place, signal by signal, function by function.

    Args:
        problem: model with the effects of a fit and free per-record parameters, output error.
        parameters: its parameters.
        places: where the forces act.
        noise: forces and sensor noise.
        v, S: residuals and sensitivities along the motion without forces.
        signals: signals that a force might follow.
    """

    def of_one(own, case, v, S, probes):
        _, record = case
        linear = linear_model(problem, own, parameters.shared, case, places)
        forced = answers(linear, probes).reshape(*v.shape, -1)
        columns = jnp.concatenate([v[..., None], S, forced], axis=-1)
        white = _filtered(linear, record.t, record.mask, columns, noise)
        return white[..., 0], white[..., 1 : 1 + S.shape[-1]], white[..., 1 + S.shape[-1] :]

    probes = _functions(signals)
    return jax.vmap(of_one)(parameters.rows, problem.cases(), v, S, probes)


def _functions(signals):
    """Return functions of each signal, centred and scaled to its range."""
    centred = signals - jnp.mean(signals, axis=(0, 1))[None, None]
    size = jnp.max(jnp.abs(centred), axis=(0, 1))
    s = centred / jnp.where(size > 0, size, 1.0)[None, None]
    functions = [s**2, s**3, jnp.abs(s) * s, jnp.tanh(SIGN_STEEPNESS * s)]
    return jnp.stack(functions, axis=-1).reshape(*s.shape[:2], -1)


def _filtered(
    linear: Linear,
    t: Float[Array, " time"],
    valid: Bool[Array, "time output"],
    columns: Float[Array, "time output column"],
    noise: ForceNoise,
):
    """Return the whitened innovations of columns; zero for samples that are not valid."""
    h = jnp.append(jnp.diff(t), 0.0)
    n, p = linear.P.shape[1:]
    H = jnp.where(valid[..., None], jnp.concatenate([linear.C, linear.D], axis=-1), 0.0)
    R = jnp.where(valid, noise.sensors[None] ** 2, 1.0)
    columns = jnp.where(valid[..., None], columns, 0.0)
    a = jnp.exp(-h[:, None] / noise.time[None])

    def transition(Phi, a, before, after):
        F = jnp.block([[Phi, before + a[None] * after], [jnp.zeros((p, n)), jnp.diag(a)]])
        G = jnp.concatenate([after, jnp.eye(p)])
        return F, (G * ((1.0 - a**2) * noise.deviation**2)[None]) @ G.T

    rest = jnp.zeros((1, n, p))  # behind the last sample nothing moves
    P, Q = (jnp.concatenate([part, rest]) for part in (linear.P, linear.Q))
    F, W = jax.vmap(transition)(jnp.concatenate([linear.Phi, jnp.eye(n)[None]]), a, P, Q)

    def step(carry, now):
        state, covariance = carry
        H, R, F, W, y = now
        cross = covariance @ H.T
        L = jnp.linalg.cholesky(H @ cross + jnp.diag(R))
        white = jax.scipy.linalg.solve_triangular(L, y - H @ state, lower=True)
        K = jax.scipy.linalg.solve_triangular(L, cross.T, lower=True)
        state, covariance = state + K.T @ white, covariance - K.T @ K
        return (F @ state, F @ covariance @ F.T + W), white

    start = jnp.diag(jnp.concatenate([jnp.zeros(n), noise.deviation**2]))
    first = jnp.zeros((n + p, columns.shape[-1]))
    return jax.lax.scan(step, (first, start), (H, R, F, W, columns))[1]
