"""Innovations: what a Kalman filter leaves of residuals and of columns, forces of first order in
time among its states.

    dx_(i+1) = Phi_i dx_i + P_i d_i + Q_i d_(i+1)
    d_(i+1) = a d_i + sqrt(1 - a^2) s w_i,    a = exp(-h / time)
    v_i = C_i dx_i + D_i d_i + e_i

(Kalman, J. Basic Engineering 82, 1960.)
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from .._foundation.types import Array, Bool, Float
from .free_form import Linear, answer


class Noise(NamedTuple):
    """Logarithms of what is unknown of the noise.

    Attributes:
        force: of the force's standard deviation at each place: in an equation [rate of the state],
            of the air [m/s], or of a sensor's error [unit of the channel].
        time: of its correlation time [s], one for all forces, or one for each sensor.
        instruments: of the instruments' variance, relative to that which was taken for granted.
    """

    force: Float[Array, " place"]
    time: Float[Array, " memory"]
    instruments: Float[Array, " output"]


def filtered(
    linear: Linear,
    t: Float[Array, " time"],
    seen: Bool[Array, "time output"],
    columns: Float[Array, "time output column"],
    noise: Noise,
) -> tuple[Float[Array, "time output column"], Float[Array, " time"], Float[Array, "time state"]]:
    """Whitened innovations of all columns of one case, the log-determinant of their covariance at
    each sample, and what the samples before it say of the state, by the first column."""
    deviation = jnp.exp(noise.force)
    h = jnp.concatenate([jnp.diff(t), jnp.zeros(1)])
    n, p = linear.P.shape[1:]
    H = jnp.concatenate([linear.C, linear.D], axis=-1)
    # Padding, and samples that are not valid, say nothing: no row, and a noise of one.
    R = jnp.where(seen, jnp.exp(noise.instruments)[None], 1.0)
    a = jnp.broadcast_to(jnp.exp(-h[:, None] / jnp.exp(noise.time)[None]), (h.size, p))

    def transition(Phi, a, before, after):
        F = jnp.block([[Phi, before + a[None] * after], [jnp.zeros((p, n)), jnp.diag(a)]])
        G = jnp.concatenate([after, jnp.eye(p)])
        return F, (G * ((1.0 - a**2) * deviation**2)[None]) @ G.T

    # Behind the last sample nothing moves any more.
    still = jnp.zeros((1, n, p))
    pushes = (jnp.concatenate([one, still]) for one in (linear.P, linear.Q))
    F, Q = jax.vmap(transition)(jnp.concatenate([linear.Phi, jnp.eye(n)[None]]), a, *pushes)

    def step(carry, now):
        state, P = carry
        H, R, F, Q, y = now
        cross = P @ H.T
        L = jnp.linalg.cholesky(H @ cross + jnp.diag(R))
        white = jax.scipy.linalg.solve_triangular(L, y - H @ state, lower=True)
        K = jax.scipy.linalg.solve_triangular(L, cross.T, lower=True)
        foreseen, state, P = state[:n, 0], state + K.T @ white, P - K.T @ K
        return (F @ state, F @ P @ F.T + Q), (
            white,
            2.0 * jnp.sum(jnp.log(jnp.diagonal(L))),
            foreseen,
        )

    start = jnp.diag(jnp.concatenate([jnp.zeros(n), deviation**2]))
    _, told = jax.lax.scan(
        step, (jnp.zeros((n + p, columns.shape[-1])), start), (H, R, F, Q, columns)
    )
    return told


def most_probable(
    linear: Linear, t, seen, left: Float[Array, "time output"], noise: Noise
) -> Float[Array, "time place"]:
    """The forces of one case that are most probable, given all its samples: covariance times the
    slope of the cost.

    With the forces' covariance `Sigma` and the outputs' answers `H` to them, `Sigma H' (H Sigma H'
    + R)^-1 v`; the filter gives the last factors as the gradient of its cost in a force that would
    be known.
    """

    def cost(force):
        innovations, *_ = filtered(
            linear, t, seen, (left - answer(linear, force))[..., None], noise
        )
        return 0.5 * jnp.sum(innovations**2)

    toward = -jax.grad(cost)(jnp.zeros((t.size, noise.force.size)))
    a = jnp.broadcast_to(
        jnp.exp(-jnp.diff(t)[:, None] / jnp.exp(noise.time)[None]), toward[1:].shape
    )

    def carried(sum, now):
        a, one = now
        sum = a * sum + one
        return sum, sum

    # Their covariance falls by `a` from sample to sample in both directions.
    nothing = jnp.zeros_like(toward[:1])
    _, before = jax.lax.scan(carried, nothing[0], (jnp.concatenate([nothing, a]), toward))
    _, after = jax.lax.scan(
        carried, nothing[0], (jnp.concatenate([a, nothing]), toward), reverse=True
    )
    return jnp.exp(2.0 * noise.force)[None] * (before + after - toward)
