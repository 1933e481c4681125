r"""Extended Kalman filter of a `StochasticModel` for one record (A.16 to A.25).

Between samples the state runs through the Runge-Kutta steps of the simulation, and its covariance
through their exact derivative `Phi`:

    x <- step(x),    P <- Phi P Phi' + Qd,    Qd = int_0^h e^(A s) G G' e^(A' s) ds

with `A` and `G` at the third stage of the step, its middle. The integral is its Taylor series,

    Qd = h sum_jk L_j L_k' / (j + k + 1),    L_j = (h A)^j G / j!,    j + k < 8

which is Van Loan's integral to rounding for a linear model with steps of `h |A| < 0.2`, and second
order in the step otherwise. At a sample, in Joseph's form (Bucy & Joseph, 1968),

    B = H P H' + R = L L',    K = P H' B^-1,    w = L^-1 v,
    x <- x + K v,    P <- (I - K H) P (I - K H)' + K R K'

The covariance itself is carried, not a triangular factor: `P` is a smooth function of all
deviations also where it is singular (a known initial state, no process noise), where the
derivative of a factor does not exist. Joseph's form keeps it positive semidefinite.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import solve_triangular

from ..._foundation.checks import require
from ..._foundation.dependence import returns_argument
from ..._foundation.types import Array, Bool, Float
from ...data.record import Record
from ...effects.augmented import split_effects
from ...effects.present import acts_in
from ...models.base import AbstractModel
from ...models.stochastic import StochasticModel
from ...sensitivity.jacobian import value_and_jacobian
from ...sensitivity.linearisation import INPUTS, NODES, WEIGHTS
from ...simulation.hold import AbstractHold
from ...simulation.input_signal import substeps_of
from ...simulation.simulate import effective_input

SERIES_TERMS = 8  # derived: relative error of Qd below 1e-12 for h |A| = 0.1
_ORDERS = np.add.outer(np.arange(SERIES_TERMS), np.arange(SERIES_TERMS))
SERIES_WEIGHTS = np.where(_ORDERS < SERIES_TERMS, 1.0 / (_ORDERS + 1.0), 0.0)
MIDDLE = 2  # the stage at which the covariance of the noise is formed


class Filtered(NamedTuple):
    """Result of the filter for one record.

    Attributes:
        y: predicted outputs, one sample ahead.
        v: innovations `z - y`, zero at missing samples.
        B: covariance of the innovations, with a row of the identity for each missing sample.
        x_predicted, P_predicted: state and covariance before the sample (A.19).
        x, P: state and covariance after the sample (A.24, A.25).
        Phi, Q: transition from each sample to the next, and the covariance of its noise.
        score: `H' B^-1 v`, the gradient of the log-likelihood of a sample by the predicted state.
        remaining: `I - K H`, with the H of `P H' = cov(x, y)`.
    """

    y: Float[Array, "time output"]
    v: Float[Array, "time output"]
    B: Float[Array, "time output output"]
    x_predicted: Float[Array, "time state"]
    P_predicted: Float[Array, "time state state"]
    x: Float[Array, "time state"]
    P: Float[Array, "time state state"]
    Phi: Float[Array, "time state state"]
    Q: Float[Array, "time state state"]
    score: Float[Array, "time state"]
    remaining: Float[Array, "time state state"]


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
    unscented: bool = False,
) -> Filtered:
    """Return the filter's states and innovations for one record.

    Args:
        model: the model with its noises.
        record: a single record; missing samples change nothing.
        initial_state: mean of the state at the first sample.
        hold: interpolation of the inputs between their samples.
        substeps: Runge-Kutta steps from sample to sample.
        updates: number of linearisations of the outputs at each sample (iterated filter).
        unscented: update by differences of the outputs (`unscented_update`).
        steady: start in statistical steady state (A.45 to A.49), by the discrete Riccati equation
            at the first sample.
    """
    samples, steps = filter_signals(model, record, hold, substeps)
    deviations = model.sensor_deviations()
    begin = initial_moments(model, record, initial_state, hold, substeps, steady)

    def interval(carry, now):
        x, P = carry
        sample, steps = now
        if unscented:
            update = unscented_update(model, x, P, sample, deviations)
        else:
            update = _update(model, x, P, sample, deviations, updates)
        x_next, Phi, Q = predicted(model, update.x, steps)
        P_next = congruence(Phi, update.P) + Q
        return (x_next, (P_next + P_next.T) / 2), Filtered(
            *(update.y, update.v, update.B, x, P, update.x, update.P, Phi, Q),
            *(update.score, update.remaining),
        )

    return jax.lax.scan(interval, begin, (samples, steps))[1]


def filter_signals(
    model: AbstractModel, record: Record, hold: AbstractHold, substeps: int
) -> tuple[Sample, Steps]:
    """Return the measurements of all samples, and the steps after them.

    A step of length zero follows the last sample.
    """
    path, u = effective_input(model, hold, record.t, record.u)
    t = jnp.append(record.t, record.t[-1])
    begin, length = substeps_of(t, substeps)
    stages = Steps(begin, length, path.stages(t, substeps))
    steps = jax.tree.map(lambda leaf: leaf.reshape(-1, substeps, *leaf.shape[1:]), stages)
    return Sample(record.t, u, record.z, record.mask), steps


def require_outputs_without_memory(model: AbstractModel, records: Record) -> None:
    """Refuse sensors with a memory, which a filter does not carry."""
    one = jnp.zeros((records.t.shape[-1], len(model.outputs)))
    t = records.t.reshape(-1, records.t.shape[-1])[0]
    declared, effects = split_effects(model)
    remembering = [e.name for e in effects if acts_in("observe")(e) and not e.card.each_sample]
    require(
        not remembering and returns_argument(lambda y: declared.observe(t, y), one),
        f"{', '.join(remembering) or type(declared).__name__} acts on a history of sampled outputs "
        "(`observe`: a sensor's lag, delay or drift), a memory that the filter does not carry. Use "
        "OutputError, or remove it.",
    )


def initial_moments(
    model: StochasticModel,
    record: Record,
    initial_state: Float[Array, " state"],
    hold: AbstractHold,
    substeps: int,
    steady: bool,
) -> tuple[Float[Array, " state"], Float[Array, "state state"]]:
    """Return the mean and the covariance of the state before the first sample."""
    if not steady:
        return initial_state, model.initial_covariance()
    signals = filter_signals(model, record, hold, substeps)
    sample, steps = jax.tree.map(lambda leaf: leaf[0], signals)
    deviations = model.sensor_deviations()
    return initial_state, _steady_covariance(model, initial_state, sample, steps, deviations)


class Update(NamedTuple):
    """State after a sample, with the innovation; the fields are those of `Filtered`."""

    y: Float[Array, " output"]
    v: Float[Array, " output"]
    B: Float[Array, "output output"]
    x: Float[Array, " state"]
    P: Float[Array, "state state"]
    score: Float[Array, " state"]
    remaining: Float[Array, "state state"]


def _update(model, x, P, sample: Sample, deviations, updates: int) -> Update:
    """Return the state after a sample (A.20 to A.25)."""
    t, u, z, mask = sample

    def outputs(x):
        return model.output(t, x, u)

    R = jnp.where(mask, deviations**2, 1.0)
    y, H = value_and_jacobian(outputs, x)
    H = jnp.where(mask[:, None], H, 0.0)
    v = jnp.where(mask, z - y, 0.0)
    B, gain = _gain(P, H, R)
    innovation, later = v, x + product(gain, v)
    for _ in range(updates - 1):
        value, H = value_and_jacobian(outputs, later)
        H = jnp.where(mask[:, None], H, 0.0)
        _, gain = _gain(P, H, R)
        innovation = jnp.where(mask, z - value, 0.0) - product(H, x - later)
        later = x + product(gain, innovation)
    remaining = jnp.eye(x.size) - product(gain, H)
    P = congruence(remaining, P) + product(gain * R[None], gain.T)
    # H' B^-1 v = H' R^-1 (v - H K v)
    score = product(H.T, (innovation - product(H, later - x)) / R)
    return Update(y, v, B, later, (P + P.T) / 2, score, remaining)


def unscented_update(model, x, P, sample: Sample, deviations) -> Update:
    r"""Return the state after a sample, from outputs at points around the predicted state.

    With `P = S S'`, columns `s_j` of S, points `y_j(+/-) = y(x +/- sqrt(3) s_j)`, and
    `d_j = (y_j(+) - y_j(-)) / (2 sqrt(3))`, `e_j = sqrt(2) (y_j(+) + y_j(-) - 2 y(x)) / 6`,

        mean of y = y(x) + sum_j e_j / sqrt(2),    B = D D' + E E' + R,    K = S D' B^-1
        P <- (S - K D) (S - K D)' + K (E E' + R) K'

    The mean is the one of the unscented transform with three as the sum of dimension and kappa, and
    B has no negative weights (M. Norgaard, N. Poulsen, O. Ravn, Automatica 36, 2000). Exact for
    outputs that are sums of quadratic functions of single components of `S^-1 x`. `score` and
    `remaining` have the slope `H = D S^-1`, for which `P H'` is the covariance of x and y.
    """
    t, u, z, mask = sample
    S = cholesky(P)
    points = jnp.concatenate([x[None] + np.sqrt(3.0) * S.T, x[None] - np.sqrt(3.0) * S.T])
    plus, minus = jnp.split(jax.vmap(lambda x: model.output(t, x, u))(points), 2)
    y, present = model.output(t, x, u), mask[:, None]
    D = jnp.where(present, (plus - minus).T / (2.0 * np.sqrt(3.0)), 0.0)
    E = jnp.where(present, np.sqrt(2.0) / 6.0 * (plus + minus - 2.0 * y[None]).T, 0.0)
    y = y + jnp.sum(E, axis=1) / np.sqrt(2.0)
    v = jnp.where(mask, z - y, 0.0)
    noise = product(E, E.T) + jnp.diag(jnp.where(mask, deviations**2, 1.0))
    B = product(D, D.T) + noise
    inverse = inverse_cholesky(B)
    gain = product(product(S, product(inverse, D).T), inverse)
    rest = S - product(gain, D)
    after = product(rest, rest.T) + congruence(gain, noise)
    empty = jnp.diag(jnp.where(jnp.diagonal(S) > 0.0, 0.0, 1.0))  # columns of S and of D are zero
    H = solve_triangular(S + empty, D.T, trans="T", lower=True).T
    score = product(H.T, product(inverse.T, product(inverse, v)))
    remaining = jnp.eye(x.size) - product(gain, H)
    return Update(y, v, B, x + product(gain, v), (after + after.T) / 2, score, remaining)


def cholesky(P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Return a lower factor `S` with `S S' = P`, with zero columns where P is singular."""
    columns = []
    for j in range(P.shape[0]):
        positive = P[j, j] > 0.0
        column = P[:, j] / jnp.sqrt(jnp.where(positive, P[j, j], 1.0))
        column = jnp.where(positive & (np.arange(P.shape[0]) >= j), column, 0.0)
        columns.append(column)
        P = P - column[:, None] * column[None]
    return jnp.stack(columns, axis=1) if columns else P


def _gain(P, H, R):
    """Return the covariance of the innovations, and the gain `P H' B^-1`."""
    projected = product(H, P)
    B = product(projected, H.T) + jnp.diag(R)
    inverse = inverse_cholesky(B)
    return B, product(product(inverse, projected).T, inverse)


def predicted(model: StochasticModel, x: Float[Array, " state"], steps: Steps):
    """Return the state at the next sample, the transition to it and the covariance of its noise."""

    def substep(carry, now):
        x, Phi, Q = carry
        begin, h, u = now
        k, slope, points = jnp.zeros_like(x), jnp.zeros_like(x), []
        for node, weight, column in zip(NODES, WEIGHTS, INPUTS, strict=True):
            points.append(x + node * h * k)
            k = model.rhs(begin + node * h, points[-1], u[column])
            slope = slope + weight * k
        t, at = begin + np.array(NODES) * h, jnp.stack(points)
        A = jax.vmap(partial(_rate_jacobian, model))(t, at, u[INPUTS])
        eye = jnp.eye(x.size)
        K, own = jnp.zeros_like(eye), eye
        for stage, (node, weight) in enumerate(zip(NODES, WEIGHTS, strict=True)):
            K = product(A[stage], eye + node * h * K)
            own = own + h / 6 * weight * K
        G = model.diffusion(t[MIDDLE], at[MIDDLE], u[1])
        Q = congruence(own, Q) + _integral(A[MIDDLE], G, h)
        return (x + h / 6 * slope, product(own, Phi), (Q + Q.T) / 2), None

    begin = (x, jnp.eye(x.size), jnp.zeros((x.size, x.size)))
    if steps.begin.size == 1:
        return substep(begin, jax.tree.map(lambda leaf: leaf[0], steps))[0]
    return jax.lax.scan(substep, begin, steps)[0]


def _rate_jacobian(model, t, x, u):
    return value_and_jacobian(lambda x: model.rhs(t, x, u), x)[1]


def _integral(A, G, h):
    """Return the covariance `Qd` that white noise adds over a step."""
    factors = [G]
    for k in range(1, SERIES_TERMS):
        factors.append(h / k * product(A, factors[-1]))
    L = jnp.stack(factors)
    return h * jnp.einsum("jk,jar,kbr->ab", SERIES_WEIGHTS, L, L)


def _steady_covariance(model, x, sample: Sample, steps: Steps, deviations):
    """Return the steady covariance before a sample, for the model linearised at one point.

    By the doubling algorithm (Anderson, International Journal of Control 28, 1978), which squares
    the transition at each iteration.
    """
    _, Phi, Q = predicted(model, x, steps)
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


def product(a, b):
    """Return `a @ b` for small matrices.

    As a sum of products, which XLA fuses with its neighbours: in the loop over the samples the call
    of a matrix product costs more than its arithmetic.
    """
    if b.ndim == 1:
        return jnp.sum(a * b[None], axis=1)
    return jnp.sum(a[:, :, None] * b[None], axis=1)


def congruence(a, P):
    """Return `a P a'`."""
    return product(product(a, P), a.T)


def inverse_cholesky(B: Float[Array, "*batch n n"]) -> Float[Array, "*batch n n"]:
    """Return the inverse of the lower Cholesky factor of a small matrix, `L^-1` with `B = L L'`.

    Column by column, with the rows of the identity eliminated alongside. NaN where B is not
    positive definite.
    """
    n = B.shape[-1]
    rest, inverse = B, jnp.broadcast_to(jnp.eye(n), B.shape)
    rows = []
    for j in range(n):
        pivot = 1.0 / jnp.sqrt(rest[..., j, j])
        row = inverse[..., j, :] * pivot[..., None]
        column = rest[..., :, j] * pivot[..., None]
        rows.append(row)
        inverse = inverse - column[..., :, None] * row[..., None, :]
        rest = rest - column[..., :, None] * column[..., None, :]
    return jnp.stack(rows, axis=-2)
