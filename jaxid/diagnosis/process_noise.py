"""Process noise: whether forces that cannot be predicted explain a residual, and what a filter leaves of it.

A random force in each uncertain equation, or a random motion of the air, of first order in time as turbulence is, moves the
outputs by the linear model along the trajectory (`free_form`). Its strengths, its correlation time and what is left for the
instruments are found by maximum likelihood on the innovations of a Kalman filter. The same filter then whitens the sensitivities
to absent effects: a score among innovations is one that accounts for the process noise (generalised least squares).
"""
# Pyright counts the arguments of functions that equinox and jaxtyping wrap in its own way; the tests execute them.
# pyright: reportCallIssue=false

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix

from .._foundation.types import Array, Bool, Float
from ..estimation.problem import Problem
from ..models.free import Parameters
from ..sensitivity.information import gather, record_triangles
from .free_form import RANDOM, Linear, answers, linear_model
from .predictable import white_part
from .validation import root_mean_square

STEPS = 80  # of the search for the noise: it is smooth, and a few per cent of its strengths decide nothing
TIMES = (1.0, 10.0, 100.0)  # typical steps: correlation times from which the search starts
TURNS = 3  # of noise and parameters
LAGS = (3.0, 15.0)  # typical steps: of signals that a force may follow late
FEW_SIGNALS = 8  # so many still have all their products tried
SILENT = -60.0  # the logarithm of no force


class Noise(NamedTuple):
    """Logarithms of what is unknown of the noise.

    Attributes:
        force: of the force's standard deviation at each place: in an equation [rate of the state], or of the air [m/s].
        time: of its correlation time [s].
        instruments: of the instruments' variance, relative to that which was taken for granted.
    """

    force: Float[Array, " place"]
    time: Float[Array, ""]
    instruments: Float[Array, " output"]


class ProcessNoise(NamedTuple):
    """What a filter makes of a residual.

    Attributes:
        force: standard deviation of the force at each place: in an equation [rate of the state], or of the air [m/s].
        time: its correlation time [s].
        instruments: standard deviation of the instruments' noise, relative to that which was taken for granted.
        gain: twice the rise of the log-likelihood over noise of the instruments alone.
        v, S: innovations of the residuals and of the columns, white with variance one where the model is right.
        probes: of what forces would do that follow the signals in some simple way (`probing`).
    """

    force: Float[Array, " place"]
    time: Float[Array, ""]
    instruments: Float[Array, " output"]
    gain: Float[Array, ""]
    v: Float[Array, "case time output"]
    S: Float[Array, "case time output column"]
    probes: Float[Array, "case time output probe"]


@eqx.filter_jit
def process_noise(
    problem: Problem,
    parameters: Parameters,
    S: Float[Array, "case time output column"],
    is_free: Bool[Array, " shared"],
    force: Float[Array, " place"],
    names: tuple[str, ...],
    known: bool,
) -> ProcessNoise:
    r"""Fit process noise to the residuals of a problem, and filter residuals and columns with it.

        dx_(i+1) = Phi_i dx_i + P_i d_i + Q_i d_(i+1),    d_(i+1) = a d_i + sqrt(1 - a^2) s w_i
        v_i = C_i dx_i + D_i d_i + S_i dtheta + e_i,    a = exp(-h / time)

    What the free parameters took of the forces is given back: noise and linear step `dtheta` are found in turn.

    Args:
        problem: with output error for likelihood.
        parameters: its solution.
        S: sensitivities to any columns, in units of the instruments' noise, each record's own unknowns first.
        is_free: of the last columns, the shared ones, which are free.
        force: its strength at each place, where the search starts: that of the disturbance which `where` finds there.
        names: of the places: states whose equation holds a random force, and then of what moves in the air.
        known: whether the instruments' noise is known; else its variances are estimated as well.

    Returns:
        Strengths, and the innovations of residuals and columns. (Maine & Iliff, NASA RP-1168, 1986, section 5; Kalman 1960.)
    """
    v = problem.residuals(parameters)

    def one(own, case):
        return linear_model(problem, own, parameters.shared, case, RANDOM, names)

    linear = jax.vmap(one)(parameters.rows, problem.cases())
    signals = jnp.concatenate([linear.x, problem.records.u, linear.y], axis=-1)
    linear = linear._replace(C=problem.whiten(v, linear.C), D=problem.whiten(v, linear.D))
    t, seen = problem.records.t, problem.records.mask
    probes = jax.vmap(answers)(linear, probing(signals, t))
    probes = probes.reshape(*seen.shape, -1)

    def filtered(noise: Noise, columns):
        noise = noise._replace(instruments=jnp.where(known, 0.0, noise.instruments))
        return jax.vmap(lambda *case: _filtered(*case, noise))(linear, t, seen, columns)

    def cost(noise: Noise, white):
        innovations, log_det = filtered(noise, white[..., None])
        return 0.5 * (jnp.sum(innovations**2) + jnp.sum(log_det)) / jnp.sum(seen)

    def search(white, begin: Noise):
        solver = optimistix.BFGS(rtol=1e-4, atol=1e-4)
        found = optimistix.minimise(cost, solver, begin, args=white, max_steps=STEPS, throw=False).value
        return found, cost(found, white)

    def turn(white, _):
        found, costs = jax.vmap(lambda begin: search(white, begin))(_begin(force, t, white, seen))
        noise = jax.tree.map(lambda one: one[jnp.nanargmin(costs)], found)
        whole, _ = filtered(noise, jnp.concatenate([white[..., None], S], axis=-1))
        return white - _imitated(whole[..., 0], whole[..., 1:], S, is_free), (noise, white, whole)

    white = problem.whiten(v, v)
    _, turns = jax.lax.scan(turn, white, None, TURNS)
    noise, last, whole = jax.tree.map(lambda one: one[-1], turns)
    without = Noise(jnp.full_like(noise.force, SILENT), noise.time, 2.0 * jnp.log(root_mean_square(white, seen)))
    gain = 2.0 * jnp.sum(seen) * (cost(without, white) - cost(noise, last))
    instruments = jnp.where(known, 1.0, jnp.exp(0.5 * noise.instruments))
    strengths = (jnp.exp(noise.force), jnp.exp(noise.time), instruments)
    return ProcessNoise(*strengths, gain, whole[..., 0], whole[..., 1:], filtered(noise, probes)[0])


def probing(signals: Float[Array, "case time signal"], t: Float[Array, "case time"]) -> Float[Array, "case time probe"]:
    """Simple functions of signals, which a force would follow that is not random: powers, sign, lags, and products of few.

    Args:
        signals: states, inputs and outputs along the trajectories.
        t: time [s].
    """
    size = jnp.max(jnp.abs(signals - jnp.mean(signals, axis=(0, 1))[None, None]), axis=(0, 1))
    s = (signals - jnp.mean(signals, axis=(0, 1))[None, None]) / jnp.where(size > 0, size, 1.0)[None, None]
    h = jnp.diff(t)
    typical = jnp.nanmedian(jnp.where(h > 0, h, jnp.nan))
    lags = [jax.vmap(lambda t, s, lag=lag: _lagged(t, s, lag * typical))(t, s) for lag in LAGS]
    functions = [s, s**2, s**3, jnp.abs(s) * s, jnp.tanh(20.0 * s), *lags]
    if s.shape[-1] <= FEW_SIGNALS:
        first, second = np.triu_indices(s.shape[-1], 1)
        functions.append(s[..., first] * s[..., second])
    return jnp.concatenate(functions, axis=-1)


def _lagged(t: Float[Array, " time"], s: Float[Array, "time signal"], lag) -> Float[Array, "time signal"]:
    """Signals behind a first-order lag, at rest at the start."""

    def follow(w, now):
        h, target = now
        w = target + (w - target) * jnp.exp(-h / lag)
        return w, w

    return jnp.concatenate([s[:1], jax.lax.scan(follow, s[0], (jnp.diff(t), s[:-1]))[1]])


def _imitated(v, filtered, S, is_free) -> Float[Array, "case time output"]:
    """What the free parameters explain of filtered residuals, before the filter."""
    count = S.shape[-1] - is_free.size
    triangles = record_triangles(filtered[..., :count], filtered[..., count:], v)
    nothing = jnp.zeros((1, is_free.size + 1))
    information = gather(triangles, nothing, jnp.zeros((v.shape[0], count), bool), ~is_free)
    shared = jnp.linalg.pinv(information.triangle) @ information.rhs
    own = information.own.solve(shared)
    return S[..., count:] @ shared + jnp.einsum("ctoj,cj->cto", S[..., :count], own)


def _begin(force, t, white, seen) -> Noise:
    """The given forces, with several correlation times; what is fast in the residual is the instruments'."""
    h = jnp.diff(t)
    fast = white_part(white, seen)
    times = jnp.array(TIMES) * jnp.nanmedian(jnp.where(h > 0, h, jnp.nan))
    each = [jnp.tile(jnp.log(one)[None], (times.size, 1)) for one in (force, fast + 1e-6)]
    return Noise(each[0], jnp.log(times), each[1])


def _filtered(
    linear: Linear,
    t: Float[Array, " time"],
    seen: Bool[Array, "time output"],
    columns: Float[Array, "time output column"],
    noise: Noise,
) -> tuple[Float[Array, "time output column"], Float[Array, " time"]]:
    """Whitened innovations of all columns of one case, and the log-determinant of their covariance at each sample."""
    deviation = jnp.exp(noise.force)
    h = jnp.concatenate([jnp.diff(t), jnp.zeros(1)])
    n, p = linear.P.shape[1:]
    H = jnp.concatenate([linear.C, linear.D], axis=-1)
    # Padding, and samples that are not valid, say nothing: no row, and a noise of one.
    R = jnp.where(seen, jnp.exp(noise.instruments)[None], 1.0)
    a = jnp.exp(-h / jnp.exp(noise.time))

    def transition(Phi, a, before, after):
        F = jnp.block([[Phi, before + a * after], [jnp.zeros((p, n)), a * jnp.eye(p)]])
        G = jnp.concatenate([after, jnp.eye(p)])
        return F, (1.0 - a**2) * (G * deviation[None] ** 2) @ G.T

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
        state, P = state + K.T @ white, P - K.T @ K
        return (F @ state, F @ P @ F.T + Q), (white, 2.0 * jnp.sum(jnp.log(jnp.diagonal(L))))

    start = jnp.diag(jnp.concatenate([jnp.zeros(n), deviation**2]))
    _, (white, log_det) = jax.lax.scan(step, (jnp.zeros((n + p, columns.shape[-1])), start), (H, R, F, Q, columns))
    return white, log_det
