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
from .scores import sensitivities
from .validation import root_mean_square

STEPS = 80  # of the search for the noise: it is smooth, and a few per cent of its strengths decide nothing
TIMES = (1.0, 10.0, 100.0)  # typical steps: correlation times from which the search starts
TURNS = 5  # of noise and parameters, at most
LITTLE = 1e-3  # of what the forces explain: a turn that brings less is the last
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


def process_noise(
    problem: Problem,
    parameters: Parameters,
    is_free: Bool[Array, " shared"],
    force: Float[Array, " place"],
    names: tuple[str, ...],
    known: bool,
) -> ProcessNoise:
    r"""Fit process noise and parameters to the records of a problem, and filter residuals and columns with it.

        dx_(i+1) = Phi_i dx_i + P_i d_i + Q_i d_(i+1),    d_(i+1) = a d_i + sqrt(1 - a^2) s w_i
        v_i = C_i dx_i + D_i d_i + S_i dtheta + e_i,    a = exp(-h / time)

    Output error takes strong forces for other parameters. So noise and parameters are found in turn: the noise on the linear
    model along the trajectory, then one Gauss-Newton step `dtheta` on the innovations, and the trajectory and the linear model
    anew, as filter error does it.

    Args:
        problem: with output error for likelihood; its shared parameters are all columns that are asked about.
        parameters: its solution.
        is_free: of the shared parameters, those that are free.
        force: its strength at each place, where the search starts: that of the disturbance which `where` finds there.
        names: of the places: states whose equation holds a random force, and then of what moves in the air.
        known: whether the instruments' noise is known; else its variances are estimated as well.

    Returns:
        Strengths, and the innovations of residuals and columns. (Maine & Iliff, NASA RP-1168, 1986, section 5; Kalman 1960.)
    """
    seen = sensitivities(problem, parameters)
    first, mask = seen[0], problem.records.mask
    begin, count = _begin(force, problem.records.t, problem.whiten(first, first), mask), jnp.sum(mask)
    found = [_turn(problem, parameters, first, seen, is_free, begin, names, known)]
    while len(found) < TURNS:
        parameters = jax.tree.map(jnp.add, parameters, found[-1].step)
        seen, again = sensitivities(problem, parameters), _again(found[-1].noise, begin)
        found.append(_turn(problem, parameters, first, seen, is_free, again, names, known))
        if not found[-2].cost - found[-1].cost > LITTLE * (found[0].without - found[-1].cost):
            break
    last = min(found, key=lambda turn: float(turn.cost))
    instruments = jnp.where(known, 1.0, jnp.exp(0.5 * last.noise.instruments))
    strengths = (jnp.exp(last.noise.force), jnp.exp(last.noise.time), instruments)
    gain = 2.0 * count * (found[0].without - last.cost)
    return ProcessNoise(*strengths, gain, last.white[..., 0], last.white[..., 1:], last.probes)


class Turn(NamedTuple):
    """One turn of `process_noise`: noise, innovations of residuals with columns, and of probes, the step of the parameters, and
    costs for each sample, without forces and with them."""

    noise: Noise
    white: Float[Array, "case time output column"]
    probes: Float[Array, "case time output probe"]
    step: Parameters
    without: Float[Array, ""]
    cost: Float[Array, ""]


@eqx.filter_jit
def _turn(
    problem: Problem,
    parameters: Parameters,
    first: Float[Array, "case time output"],
    seen: tuple[Float[Array, "case time output"], Float[Array, "case time output column"]],
    is_free: Bool[Array, " shared"],
    begin: Noise,
    names: tuple[str, ...],
    known: bool,
) -> Turn:
    """The noise by maximum likelihood, and the step of the parameters that its filter asks for.

    Args:
        first: the residuals whose noise is the unit of all turns.
        seen: residuals and sensitivities at these parameters.
        begin: where the search starts, several such.
    """

    def one(own, case):
        return linear_model(problem, own, parameters.shared, case, RANDOM, names)

    linear = jax.vmap(one)(parameters.rows, problem.cases())
    signals = jnp.concatenate([linear.x, problem.records.u, linear.y], axis=-1)
    linear = linear._replace(C=problem.whiten(first, linear.C), D=problem.whiten(first, linear.D))
    t, mask = problem.records.t, problem.records.mask
    white, S = (problem.whiten(first, rows) for rows in seen)
    probes = jax.vmap(answers)(linear, probing(signals, t))

    def filtered(noise: Noise, columns):
        noise = noise._replace(instruments=jnp.where(known, 0.0, noise.instruments))
        return jax.vmap(lambda *case: _filtered(*case, noise))(linear, t, mask, columns)

    def cost(noise: Noise, _=None):
        innovations, log_det = filtered(noise, white[..., None])
        return 0.5 * (jnp.sum(innovations**2) + jnp.sum(log_det)) / jnp.sum(mask)

    def search(begin: Noise):
        solver = optimistix.BFGS(rtol=1e-4, atol=1e-4)
        found = optimistix.minimise(cost, solver, begin, max_steps=STEPS, throw=False).value
        return found, cost(found)

    tried, costs = jax.vmap(search)(begin)
    best = jnp.nanargmin(costs)
    noise = jax.tree.map(lambda one: one[best], tried)
    whole, _ = filtered(noise, jnp.concatenate([white[..., None], S], axis=-1))
    step = _step(whole[..., 0], whole[..., 1:], is_free)
    without = Noise(jnp.full_like(noise.force, SILENT), noise.time, 2.0 * jnp.log(root_mean_square(white, mask)))
    innovations, _ = filtered(noise, probes.reshape(*mask.shape, -1))
    return Turn(noise, whole, innovations, step, cost(without), costs[best])


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


def _step(v, S, is_free) -> Parameters:
    """The Gauss-Newton step of the free parameters on filtered residuals."""
    count = S.shape[-1] - is_free.size
    triangles = record_triangles(S[..., :count], S[..., count:], v)
    nothing = jnp.zeros((1, is_free.size + 1))
    information = gather(triangles, nothing, jnp.zeros((v.shape[0], count), bool), ~is_free)
    shared = jnp.linalg.pinv(information.triangle) @ information.rhs
    return Parameters(shared, information.own.solve(shared))


def _begin(force, t, white, seen) -> Noise:
    """The given forces, with several correlation times; what is fast in the residual is the instruments'."""
    h = jnp.diff(t)
    fast = white_part(white, seen)
    times = jnp.array(TIMES) * jnp.nanmedian(jnp.where(h > 0, h, jnp.nan))
    each = [jnp.tile(jnp.log(one)[None], (times.size, 1)) for one in (force, fast + 1e-6)]
    return Noise(each[0], jnp.log(times), each[1])


def _again(noise: Noise, begin: Noise) -> Noise:
    """Where a search goes on: at the strengths that were found, with all correlation times; what has vanished gets a chance."""
    floor = begin.force - jnp.log(10.0)
    return Noise(
        jnp.maximum(jnp.broadcast_to(noise.force, floor.shape), floor),
        begin.time,
        jnp.broadcast_to(noise.instruments, begin.instruments.shape),
    )


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
