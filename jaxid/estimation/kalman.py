r"""Extended Kalman filter of a `StochasticModel` for one record (A.16 to A.25).

Between samples the state runs through the Runge-Kutta steps of the simulation, and its covariance
through their exact derivative `Phi`:

    x <- step(x),    P <- Phi P Phi' + Qd,    Qd = int_0^h e^(A s) G G' e^(A' s) ds

with `A` and `G` at the middle of the step. The integral is its Taylor series,

    Qd = sum_k h^(k+1)/(k+1)! M_k,    M_0 = G G',    M_(k+1) = A M_k + M_k A'

which is Van Loan's integral to rounding for a linear model with steps of `h |A| < 0.2`, and second
order in the step otherwise. At a sample, in Joseph's form (Bucy & Joseph, 1968),

    B = H P H' + R = L L',    K = P H' B^-1,    w = L^-1 v,
    x <- x + K v,    P <- (I - K H) P (I - K H)' + K R K'

The covariance itself is carried, not a triangular factor: `P` is a smooth function of all
deviations also where it is singular (a known initial state, no process noise), where the
derivative of a factor does not exist. Joseph's form keeps it positive semidefinite.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular

from .._foundation.types import Array, Bool, Float
from ..data.record import Record
from ..models.stochastic import StochasticModel
from ..sensitivity.jacobian import value_and_jacobian
from ..simulation.hold import AbstractHold
from ..simulation.input_signal import substeps_of
from ..simulation.simulate import effective_input

SERIES_TERMS = 8  # derived: relative error of Qd below 1e-12 for h |A| = 0.1
RK4_STAGES = ((0.0, 1.0, 0), (0.5, 2.0, 1), (0.5, 2.0, 1), (1.0, 1.0, 2))


class Filtered(NamedTuple):
    """Result of the filter for one record.

    Attributes:
        y: predicted outputs, one sample ahead.
        v: innovations `z - y`, zero at missing samples.
        w: whitened innovations `L^-1 v`.
        L: Cholesky factor of the covariance of the innovations, with a row of the identity for
            each missing sample.
        x_predicted, P_predicted: state and covariance before the sample (A.19).
        x, P: state and covariance after the sample (A.24, A.25).
        Phi, Q: transition from each sample to the next, and the covariance of its noise.
    """

    y: Float[Array, "time output"]
    v: Float[Array, "time output"]
    w: Float[Array, "time output"]
    L: Float[Array, "time output output"]
    x_predicted: Float[Array, "time state"]
    P_predicted: Float[Array, "time state state"]
    x: Float[Array, "time state"]
    P: Float[Array, "time state state"]
    Phi: Float[Array, "time state state"]
    Q: Float[Array, "time state state"]


class Sample(NamedTuple):
    """Measurement of one instant."""

    t: Float[Array, ""]
    u: Float[Array, " input"]
    z: Float[Array, " output"]
    mask: Bool[Array, " output"]


class Steps(NamedTuple):
    """Runge-Kutta steps from one sample to the next."""

    begin: Float[Array, " substep"]
    length: Float[Array, " substep"]
    u: Float[Array, "substep stage input"]


def kalman_filter(
    model: StochasticModel,
    record: Record,
    initial_state: Float[Array, " state"],
    hold: AbstractHold,
    substeps: int,
    *,
    updates: int = 1,
    steady: bool = False,
) -> Filtered:
    """Return the filter's states and innovations for one record.

    Args:
        model: the model with its noises.
        record: a single record; missing samples change nothing.
        initial_state: mean of the state at the first sample.
        hold: interpolation of the inputs between their samples.
        substeps: Runge-Kutta steps from sample to sample.
        updates: number of linearisations of the outputs at each sample (iterated filter).
        steady: start in statistical steady state (A.45 to A.49), by the discrete Riccati equation
            at the first sample.
    """
    path, u = effective_input(model, hold, record.t, record.u)
    t = jnp.append(record.t, record.t[-1])
    begin, length = substeps_of(t, substeps)
    stages = Steps(begin, length, path.stages(t, substeps))
    steps = jax.tree.map(lambda leaf: leaf.reshape(-1, substeps, *leaf.shape[1:]), stages)
    samples = Sample(record.t, u, record.z, record.mask)
    deviations = model.sensor_deviations()
    first_sample, first_steps = jax.tree.map(lambda leaf: leaf[0], (samples, steps))
    P = model.initial_covariance()
    if steady:
        P = _steady_covariance(model, initial_state, first_sample, first_steps, deviations)

    def interval(carry, now):
        x, P = carry
        sample, steps = now
        update = _update(model, x, P, sample, deviations, updates)
        x_next, Phi, Q = _predict(model, update.x, steps)
        P_next = Phi @ update.P @ Phi.T + Q
        return (x_next, (P_next + P_next.T) / 2), Filtered(
            update.y, update.v, update.w, update.L, x, P, update.x, update.P, Phi, Q
        )

    return jax.lax.scan(interval, (initial_state, P), (samples, steps))[1]


class Update(NamedTuple):
    """State after a sample, with the innovation; the fields are those of `Filtered`."""

    y: Float[Array, " output"]
    v: Float[Array, " output"]
    w: Float[Array, " output"]
    L: Float[Array, "output output"]
    x: Float[Array, " state"]
    P: Float[Array, "state state"]


def _update(model, x, P, sample: Sample, deviations, updates: int) -> Update:
    """Return the state after a sample (A.20 to A.25)."""
    t, u, z, mask = sample

    def outputs(x):
        return model.output(t, x, u)

    R = jnp.diag(jnp.where(mask, deviations**2, 1.0))
    y, H = value_and_jacobian(outputs, x)
    H = jnp.where(mask[:, None], H, 0.0)
    v = jnp.where(mask, z - y, 0.0)
    L = jnp.linalg.cholesky(H @ P @ H.T + R)
    w = solve_triangular(L, v, lower=True)
    later, gain = x, _gain(P, H, L)
    later = x + gain @ v
    for _ in range(updates - 1):
        value, H = value_and_jacobian(outputs, later)
        H = jnp.where(mask[:, None], H, 0.0)
        gain = _gain(P, H, jnp.linalg.cholesky(H @ P @ H.T + R))
        later = x + gain @ (jnp.where(mask, z - value, 0.0) - H @ (x - later))
    remaining = jnp.eye(x.size) - gain @ H
    P = remaining @ P @ remaining.T + gain @ R @ gain.T
    return Update(y, v, w, L, later, (P + P.T) / 2)


def _gain(P, H, L):
    """Return `P H' (L L')^-1`."""
    half = solve_triangular(L, H @ P, lower=True)
    return solve_triangular(L, half, lower=True, trans=1).T


def _predict(model, x, steps: Steps):
    """Return the state at the next sample, the transition to it and the covariance of its noise."""

    def substep(carry, now):
        x, Phi, Q = carry
        begin, h, u = now
        x_next, own = value_and_jacobian(lambda x: _step(model, x, begin, h, u), x)
        middle = (begin + h / 2, (x + x_next) / 2, u[1])
        _, A = value_and_jacobian(lambda x: model.rhs(middle[0], x, middle[2]), middle[1])
        Q = own @ Q @ own.T + _integral(A, model.diffusion(*middle), h)
        return (x_next, own @ Phi, (Q + Q.T) / 2), None

    begin = (x, jnp.eye(x.size), jnp.zeros((x.size, x.size)))
    return jax.lax.scan(substep, begin, steps)[0]


def _step(model, x, t, h, u):
    """Return the state after a step of the classical Runge-Kutta method."""
    k, total = jnp.zeros_like(x), jnp.zeros_like(x)
    for node, weight, at in RK4_STAGES:
        k = model.rhs(t + node * h, x + node * h * k, u[at])
        total = total + weight * k
    return x + h / 6 * total


def _integral(A, G, h):
    """Return the covariance `Qd` that white noise adds over a step."""
    term = h * (G @ G.T)
    total = term
    for k in range(1, SERIES_TERMS):
        product = A @ term
        term = h / (k + 1) * (product + product.T)
        total = total + term
    return total


def _steady_covariance(model, x, sample: Sample, steps: Steps, deviations):
    """Return the steady covariance before a sample, for the model linearised at one point.

    By the doubling algorithm (Anderson, International Journal of Control 28, 1978), which squares
    the transition at each iteration.
    """
    _, Phi, Q = _predict(model, x, steps)
    _, H = value_and_jacobian(lambda x: model.output(sample.t, x, sample.u), x)
    white = H / deviations[:, None]
    eye = jnp.eye(x.size)

    def double(state, _):
        A, G, P = state
        inverse = jnp.linalg.inv(eye + G @ P)
        half = A @ inverse
        return (half @ A, G + half @ G @ A.T, P + A.T @ P @ inverse @ A), None

    (_, _, P), _ = jax.lax.scan(double, (Phi.T, white.T @ white, Q), None, length=DOUBLINGS)
    return (P + P.T) / 2


DOUBLINGS = 30  # chosen: 2^30 samples
