"""Process noise: whether forces that cannot be predicted explain a residual, and what a filter leaves of it.

A random force in each uncertain equation, or a random motion of the air, of first order in time as turbulence is, moves the
outputs by the linear model along the trajectory (`free_form`). Its strengths, its correlation time and what is left for the
instruments are found by maximum likelihood on the innovations of a Kalman filter. The same filter then whitens the sensitivities
to absent effects: a score among innovations is one that accounts for the process noise (generalised least squares).

Errors of sensors that are of first order in time, coloured noise, are asked about in the same way; each has its own memory.
"""
# Pyright counts the arguments of functions that equinox and jaxtyping wrap in its own way; the tests execute them.
# pyright: reportCallIssue=false

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix

from .._foundation.quickly import quickly
from .._foundation.types import Array, Bool, Float
from ..estimation.problem import Problem
from ..models.free import Parameters
from ..sensitivity.information import gather, record_triangles
from .driven import driven, under
from .free_form import Linear, Places, answer, answers, linear_model
from .predictable import white_part
from .scores import sensitivities
from .validation import root_mean_square

STEPS = 80  # of the search for the noise: it is smooth, and a few per cent of its strengths decide nothing
TIMES = (1.0, 10.0, 100.0)  # typical steps: correlation times from which the search starts
TURNS = 12  # of noise, parameters and forces, at most
LITTLE = 1e-4  # of what the forces explain: a turn that brings less is the last
SHORTER = 0.25  # by which the way of a turn is shortened that made things worse
LAGS = (3.0, 15.0)  # typical steps: of signals that a force may follow late
FEW_SIGNALS = 8  # so many still have all their products tried
SILENT = -60.0  # the logarithm of no force


class Noise(NamedTuple):
    """Logarithms of what is unknown of the noise.

    Attributes:
        force: of the force's standard deviation at each place: in an equation [rate of the state], of the air [m/s], or of a
            sensor's error [unit of the channel].
        time: of its correlation time [s], one for all forces, or one for each sensor.
        instruments: of the instruments' variance, relative to that which was taken for granted.
    """

    force: Float[Array, " place"]
    time: Float[Array, " memory"]
    instruments: Float[Array, " output"]


class ProcessNoise(NamedTuple):
    """What a filter makes of a residual.

    Attributes:
        force: standard deviation of the force at each place, in the units of `Noise`.
        time: its correlation time [s], one for all forces, or one for each sensor.
        instruments: standard deviation of the instruments' white noise, relative to that which was taken for granted.
        gain: twice the rise of the log-likelihood over noise of the instruments alone.
        worth: the same over the noise without one of the forces, the rest as it is.
        v, S: innovations of the residuals and of the columns, white with variance one where the model is right.
        probes: of what forces would do that follow the signals in some simple way (`probing`).
    """

    force: Float[Array, " place"]
    time: Float[Array, " memory"]
    instruments: Float[Array, " output"]
    gain: Float[Array, ""]
    worth: Float[Array, " place"]
    v: Float[Array, "case time output"]
    S: Float[Array, "case time output column"]
    probes: Float[Array, "case time output probe"]


def process_noise(
    problem: Problem,
    parameters: Parameters,
    is_free: Bool[Array, " shared"],
    force: Float[Array, " place"],
    places: Places,
    known: bool,
) -> ProcessNoise:
    r"""Fit process noise and parameters to the records of a problem, and filter residuals and columns with it.

        dx_(i+1) = Phi_i dx_i + P_i d_i + Q_i d_(i+1),    d_(i+1) = a d_i + sqrt(1 - a^2) s w_i
        v_i = C_i dx_i + D_i d_i + S_i dtheta + e_i,    a = exp(-h / time)

    Output error takes strong forces for other parameters, and strong forces lead where the linear model along the trajectory
    without them does not hold. So noise, parameters and forces are found in turn: the noise on the linear model along the
    trajectory; one Gauss-Newton step `dtheta` on the innovations; the most probable forces `d`, given all samples; and then the
    trajectory under these forces and the linear model along it anew, an iterated extended Kalman smoother. The sensitivities
    `S` and the probes stay those of the motion without forces: they are known beforehand, where a motion that was found from
    the measurements holds their noise, and would be correlated with the innovations.

    Args:
        problem: with output error for likelihood; its shared parameters are all columns that are asked about.
        parameters: its solution.
        is_free: of the shared parameters, those that are free.
        force: its strength at each place, where the search starts: that of the disturbance which `where` finds there.
        places: equations, and then the air; or sensors alone.
        known: whether the instruments' noise is known; else its variances are estimated as well.

    Returns:
        Strengths, and the innovations of residuals and columns. (Maine & Iliff, NASA RP-1168, 1986, section 5; Kalman 1960;
        Bell, SIAM J. Optimization 4, 1994: the iterated smoother is Gauss-Newton on the forces.)
    """
    sensors, mask = of_sensors(places), problem.records.mask
    first = _residuals(problem, parameters)
    begin = _begin(force, force.size if sensors else 1, problem.records.t, problem.whiten(first, first), mask)
    pushed, asked = (problem, places) if sensors else driven(problem, places)
    signals = _signals(problem, parameters)

    def turn(parameters: Parameters, forces, begin: Noise) -> Turn:
        v, S = sensitivities(problem, parameters)
        at = pushed if sensors else under(pushed, asked, forces)
        v = v if sensors else _residuals(at, parameters)
        return _turn(at, parameters, (first, v, S), forces, signals, is_free, begin, asked, known)

    best = turn(parameters, jnp.zeros((*mask.shape[:2], force.size)), begin)
    without, way = best.without, 1.0
    for _ in range(TURNS - 1):
        parameters, forces = jax.tree.map(lambda old, new: old + way * (new - old), best.begin, best.end)  # noqa: B023
        found = turn(parameters, forces, _again(best.noise, begin))
        gain = float(best.cost - found.cost)
        # Gauss-Newton goes too far where the linear model does not hold so far: then less of the same way.
        best, way = (found, min(1.0, 2.0 * way)) if gain > 0 else (best, SHORTER * way)
        if abs(gain) <= LITTLE * float(without - best.cost):
            break
    instruments = jnp.where(known, 1.0, jnp.exp(0.5 * best.noise.instruments))
    strengths = (jnp.exp(best.noise.force), jnp.exp(best.noise.time), instruments)
    gain, worth = (2.0 * jnp.sum(mask) * (one - best.cost) for one in (without, best.without_one))
    return ProcessNoise(*strengths, gain, worth, best.white[..., 0], best.white[..., 1:], best.probes)


def of_sensors(places: Places) -> bool:
    """Whether all places are sensors, so that no state is moved."""
    return all(kind == "output" for kind, _ in places)


class Turn(NamedTuple):
    """One turn of `process_noise`.

    Attributes:
        noise: what is most likely along the trajectory.
        white, probes: innovations of residuals with columns, and of probes.
        begin: parameters and forces of the trajectory.
        end: those that are most probable, given this noise.
        without, cost: negative log-likelihood for each sample, without forces and with them.
        without_one: the same without one of them, the rest as it is.
    """

    noise: Noise
    white: Float[Array, "case time output column"]
    probes: Float[Array, "case time output probe"]
    begin: tuple[Parameters, Float[Array, "case time place"]]
    end: tuple[Parameters, Float[Array, "case time place"]]
    without: Float[Array, ""]
    cost: Float[Array, ""]
    without_one: Float[Array, " place"]


@quickly
def _turn(
    problem: Problem,
    parameters: Parameters,
    seen: tuple[
        Float[Array, "case time output"], Float[Array, "case time output"], Float[Array, "case time output column"]
    ],
    forces: Float[Array, "case time place"],
    signals: Float[Array, "case time signal"],
    is_free: Bool[Array, " shared"],
    begin: Noise,
    places: Places,
    known: bool,
) -> Turn:
    """The noise by maximum likelihood, and the parameters and forces that its filter finds.

    Args:
        seen: the residuals whose noise is the unit of all turns; residuals at these parameters under these forces; and
            sensitivities without them.
        forces: in the trajectory already; a sensor's error is not, as it moves nothing.
        signals: which a force may follow that is not random.
        begin: where the search starts, several such.
    """

    def one(own, case):
        return linear_model(problem, own, parameters.shared, case, places)

    linear = jax.vmap(one)(parameters.rows, problem.cases())
    first, *rows = seen
    linear = linear._replace(C=problem.whiten(first, linear.C), D=problem.whiten(first, linear.D))
    t, mask = problem.records.t, problem.records.mask
    white, S = (problem.whiten(first, one) for one in rows)
    linear = _without_states(linear) if of_sensors(places) else linear
    probes = jax.vmap(answers)(linear, probing(signals, t))
    # What the linear model says of the residuals without any force: what stands in the trajectory is no prior knowledge.
    white = white + jax.vmap(answer)(linear, forces)

    def filtered(noise: Noise, columns):
        return jax.vmap(lambda *case: _filtered(*case, noise))(linear, t, mask, columns)

    def told(noise: Noise) -> Noise:
        return noise._replace(instruments=jnp.where(known, 0.0, noise.instruments))

    def cost(noise: Noise, _=None):
        innovations, log_det = filtered(told(noise), white[..., None])
        return 0.5 * (jnp.sum(innovations**2) + jnp.sum(log_det)) / jnp.sum(mask)

    def search(begin: Noise):
        solver = optimistix.BFGS(rtol=1e-4, atol=1e-4)
        found = optimistix.minimise(cost, solver, begin, max_steps=STEPS, throw=False).value
        return found, cost(found)

    # One after the other: under vmap, BFGS of optimistix 0.1.0 took no step at all on the forces of an aircraft.
    tried, costs = jax.lax.map(search, begin)
    best = jnp.nanargmin(costs)
    noise = told(jax.tree.map(lambda one: one[best], tried))
    whole, _ = filtered(noise, jnp.concatenate([white[..., None], S], axis=-1))
    step, left = _step(whole[..., 0], whole[..., 1:], is_free, white, S)
    probable = jax.vmap(lambda *case: _most_probable(*case, noise))(linear, t, mask, left)
    end = (jax.tree.map(jnp.add, parameters, step), forces if of_sensors(places) else probable)
    without = Noise(jnp.full_like(noise.force, SILENT), noise.time, 2.0 * jnp.log(root_mean_square(white, mask)))
    innovations, _ = filtered(noise, probes.reshape(*mask.shape, -1))
    each = jnp.arange(noise.force.size)
    without_one = jax.lax.map(lambda place: cost(noise._replace(force=noise.force.at[place].set(SILENT))), each)
    return Turn(noise, whole, innovations, (parameters, forces), end, cost(without), costs[best], without_one)


@eqx.filter_jit
def _residuals(problem: Problem, parameters: Parameters) -> Float[Array, "case time output"]:
    """Those of all records, compiled."""
    return problem.residuals(parameters)


@eqx.filter_jit
def _signals(problem: Problem, parameters: Parameters) -> Float[Array, "case time signal"]:
    """States, inputs and outputs along the trajectories."""
    motion = problem.solve(parameters)
    return jnp.concatenate([motion.x, problem.records.u, motion.y], axis=-1)


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


def _step(v, S, is_free, white, columns) -> tuple[Parameters, Float[Array, "case time output"]]:
    """The Gauss-Newton step of the free parameters on filtered residuals, and what it leaves of those that are not filtered."""
    count = S.shape[-1] - is_free.size
    triangles = record_triangles(S[..., :count], S[..., count:], v)
    nothing = jnp.zeros((1, is_free.size + 1))
    information = gather(triangles, nothing, jnp.zeros((v.shape[0], count), bool), ~is_free)
    shared = jnp.linalg.pinv(information.triangle) @ information.rhs
    step = Parameters(shared, information.own.solve(shared))
    explained = jnp.einsum("ctok,ck->cto", columns[..., :count], step.rows)
    return step, white - explained - jnp.einsum("ctok,k->cto", columns[..., count:], shared)


def _most_probable(
    linear: Linear, t, seen, left: Float[Array, "time output"], noise: Noise
) -> Float[Array, "time place"]:
    """The forces of one case that are most probable, given all its samples: covariance times the slope of the cost.

    With the forces' covariance `Sigma` and the outputs' answers `H` to them, `Sigma H' (H Sigma H' + R)^-1 v`; the filter gives
    the last factors as the gradient of its cost in a force that would be known.
    """

    def cost(force):
        innovations, _ = _filtered(linear, t, seen, (left - answer(linear, force))[..., None], noise)
        return 0.5 * jnp.sum(innovations**2)

    toward = -jax.grad(cost)(jnp.zeros((t.size, noise.force.size)))
    a = jnp.broadcast_to(jnp.exp(-jnp.diff(t)[:, None] / jnp.exp(noise.time)[None]), toward[1:].shape)

    def carried(sum, now):
        a, one = now
        sum = a * sum + one
        return sum, sum

    # Their covariance falls by `a` from sample to sample in both directions.
    nothing = jnp.zeros_like(toward[:1])
    _, before = jax.lax.scan(carried, nothing[0], (jnp.concatenate([nothing, a]), toward))
    _, after = jax.lax.scan(carried, nothing[0], (jnp.concatenate([a, nothing]), toward), reverse=True)
    return jnp.exp(2.0 * noise.force)[None] * (before + after - toward)


def _without_states(linear: Linear) -> Linear:
    """The same without the states that nothing moves."""
    return linear._replace(
        Phi=linear.Phi[..., :0, :0], P=linear.P[..., :0, :], Q=linear.Q[..., :0, :], C=linear.C[..., :0]
    )


def _begin(force, memories, t, white, seen) -> Noise:
    """The given forces, with several correlation times; what is fast in the residual is the instruments'."""
    h = jnp.diff(t)
    fast = white_part(white, seen)
    times = jnp.array(TIMES) * jnp.nanmedian(jnp.where(h > 0, h, jnp.nan))
    each = [jnp.tile(jnp.log(one)[None], (times.size, 1)) for one in (force, fast + 1e-6)]
    return Noise(each[0], jnp.tile(jnp.log(times)[:, None], (1, memories)), each[1])


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
        state, P = state + K.T @ white, P - K.T @ K
        return (F @ state, F @ P @ F.T + Q), (white, 2.0 * jnp.sum(jnp.log(jnp.diagonal(L))))

    start = jnp.diag(jnp.concatenate([jnp.zeros(n), deviation**2]))
    _, (white, log_det) = jax.lax.scan(step, (jnp.zeros((n + p, columns.shape[-1])), start), (H, R, F, Q, columns))
    return white, log_det
