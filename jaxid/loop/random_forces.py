"""Random forces along the motion without forces: innovations, and the most probable forces.

    dx_(i+1) = Phi_i dx_i + P_i d_i + Q_i d_(i+1),    v_i = C_i dx_i + D_i d_i + e_i
    d_(i+1) = a d_i + sqrt(1 - a^2) s w_i,    a = exp(-h / T)

(Kalman, J. Basic Engineering 82, 1960.) The filter that whitens the residual whitens the
sensitivity to every candidate as well, and the response to a force that follows a signal. A random
force follows none. Deviation `s` and time `T` of each force, and the sensor noise, minimise

    J = min_d sum_i 1/2 |L_i^-1 (v - S d)_i|^2 + log det L_i

with `(v - S d)_i` innovation i and `L_i L_i'` its covariance. `fit_forces` makes the step `d` of
the other parameters and computes the motion again. (Minimised in turns, noise and parameters end at
another minimum where gusts are strong.) No program holds the model but those of fits with white
noise, so that a search tries random forces without compiling a filter for them.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy

from .._foundation.compiler import fast_compile_jit
from .._foundation.host import to_device
from .._foundation.types import Array, Bool, Float
from ..diagnosis.free_form import Linear
from ..estimation.limits import Limits
from ..sensitivity.information import Information, gather, record_triangles
from .estimation_problem import free_of
from .hypothesis import ForceNoise, RandomForces
from .linear_motion import LinearMotion

# Chosen: factor by which a deviation or a time may differ from its starting value.
WIDEST_RANGE = 1e4
# Chosen: number of steps, smallest share of one, and fall of the cost below which none is made.
MOST_FORCE_STEPS, SHORTEST_STEP, LEAST_FALL = 20, 0.01, 0.05
# Chosen: fall of the cost, as a share of `LEAST_FALL`, at which L-BFGS-B ends. SciPy divides the
# fall by the cost, which is of the order of the number of samples.
FORCE_TOLERANCE = 0.1
# Chosen: cost in place of an infinite one, far above all others. From an infinite one the line
# search of L-BFGS-B finds no way back, and ends where it began.
BARRIER = 1e12
# Chosen: ratio of a refused step to the next one tried.
SHORTER = 0.25


class ForcedMotion(NamedTuple):
    """Linear models of the records along the motion without forces, with a disturbance at each
    place of a force.

    Attributes:
        linear: the linear models.
        t: sample times.
        mask: valid samples.
        v, S: residuals, and sensitivities to the per-record parameters and then to the others.
    """

    linear: Linear
    t: Float[Array, "case time"]
    mask: Bool[Array, "case time output"]
    v: Float[Array, "case time output"]
    S: Float[Array, "case time output column"]


class ForceEstimate(NamedTuple):
    """The most probable forces along one motion.

    Attributes:
        noise: their parameters, and those of the sensor noise.
        cost: negative log-likelihood before the step.
        fall: fall of the cost by the step, in the linear model.
        own, shared: step of the per-record parameters and of the others.
    """

    noise: ForceNoise
    cost: float
    fall: float
    own: Float[np.ndarray, "case own"]
    shared: Float[np.ndarray, " column"]


@fast_compile_jit
def force_innovations(
    motion: ForcedMotion, noise: ForceNoise
) -> tuple[Float[Array, "case time output"], Float[Array, "case time output column"]]:
    """Return the whitened innovations of the residuals and sensitivities along a motion."""
    white, *_ = _filtered(motion, motion.S, noise)
    return white[..., 0], white[..., 1:]


@fast_compile_jit
def predicted_states(motion: ForcedMotion, noise: ForceNoise) -> Float[Array, "case time state"]:
    """Return the states at each sample that the filter predicts from the samples before it.

    A column made of them is independent of the innovation of its sample.
    """
    *_, deviation = _filtered(motion, motion.S[..., :0], noise)
    return motion.linear.x + deviation[..., : motion.linear.x.shape[-1]]


def estimate_forces(
    motion: ForcedMotion, own: int, start: ForceNoise, longest: float
) -> ForceEstimate:
    """Return the most probable forces and sensor noise, by L-BFGS-B on logarithms, with the step of
    the free parameters.

    Along a motion that is far from the records the linear model takes its error for a slow force;
    within bounds the steps of the parameters take it away.

    Args:
        motion: the motion, with its sensitivities.
        own: number of the per-record parameters, whose columns are the first.
        start: starting values.
        longest: upper bound of the correlation times [s].
    """
    sizes = np.cumsum([part.size for part in start])[:-1]
    begin = np.concatenate([np.log(np.asarray(part)) for part in start])
    highest = begin + np.log(WIDEST_RANGE)
    highest[sizes[0] : sizes[1]] = np.log(longest)
    begin = np.minimum(begin, highest)

    def noise_at(logarithms) -> ForceNoise:
        return ForceNoise(*map(to_device, np.split(logarithms, sizes)))

    def objective(logarithms):
        (cost, _), slope = _cost_and_slope(noise_at(logarithms), motion, own)
        slope = np.concatenate([np.asarray(part) for part in slope])
        return (float(cost), slope) if np.isfinite(float(cost)) else (BARRIER, np.zeros_like(slope))

    bounds = [*zip(begin - np.log(WIDEST_RANGE), highest, strict=True)]
    ends = {"ftol": FORCE_TOLERANCE * LEAST_FALL / max(int(np.sum(np.asarray(motion.mask))), 1)}
    end = scipy.optimize.minimize(
        objective, begin, jac=True, method="L-BFGS-B", bounds=bounds, options=ends
    )
    (expected, rest), _ = _cost_and_slope(noise_at(end.x), motion, own)
    cost, own_step, shared = map(np.asarray, rest)
    noise = noise_at(np.exp(end.x))
    noise = noise._replace(time=jnp.minimum(noise.time, longest))  # the logarithm is rounded
    return ForceEstimate(noise, float(cost), float(cost) - float(expected), own_step, shared)


@fast_compile_jit
def _cost_and_slope(logarithms: ForceNoise, motion: ForcedMotion, own: int):
    """Return the cost after the best step of the other parameters, the cost before it and the step,
    and the derivatives of the first by the logarithms of the noise parameters.
    """

    def cost(logarithms: ForceNoise):
        noise = jax.tree.map(jnp.exp, logarithms)
        white, scale, _ = _filtered(motion, motion.S, jax.lax.stop_gradient(noise))
        before = 0.5 * jnp.sum(white[..., 0] ** 2) + jnp.sum(scale)
        # At the best step the derivative by the step is zero, so that it counts as constant.
        information = information_of(white[..., 0], white[..., 1:], own)
        d = jax.lax.stop_gradient(jnp.linalg.lstsq(information.triangle, information.rhs)[0])
        every = jax.lax.stop_gradient(information.own.solve(d))
        moved = jnp.einsum("ctjp,cp->ctj", motion.S[..., :own], every) + motion.S[..., own:] @ d
        after = motion._replace(v=motion.v - moved)
        white, scale, _ = _filtered(after, motion.S[..., :0], noise)
        return 0.5 * jnp.sum(white**2) + jnp.sum(scale), (before, every, d)

    return jax.value_and_grad(cost, has_aux=True)(logarithms)


def information_of(v, S, own: int) -> Information:
    """Return the information of whitened columns, the per-record ones eliminated."""
    triangles = record_triangles(S[..., :own], S[..., own:], v)
    shared = S.shape[-1] - own
    held = jnp.zeros((v.shape[0], own), bool), jnp.zeros(shared, bool)
    return gather(triangles, jnp.zeros((1, shared + 1)), *held)


def _filtered(
    motion: ForcedMotion, columns: Float[Array, "case time output column"], noise: ForceNoise
):
    """Return the whitened innovations of residuals and columns, zero for samples that are not
    valid, the logarithm of the determinant of each innovation's factor, and the predicted deviation
    of the states from the motion.
    """
    columns = jnp.concatenate([motion.v[..., None], columns], axis=-1)
    of_records = jax.vmap(_filtered_record, (0, 0, 0, 0, None))
    return of_records(motion.linear, motion.t, motion.mask, columns, noise)


def _filtered_record(
    linear: Linear,
    t: Float[Array, " time"],
    valid: Bool[Array, "time output"],
    columns: Float[Array, "time output column"],
    noise: ForceNoise,
):
    """Return `_filtered` of one record."""
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
        before = state[:, 0]
        K = jax.scipy.linalg.solve_triangular(L, cross.T, lower=True)
        state, covariance = state + K.T @ white, covariance - K.T @ K
        scale = jnp.sum(jnp.log(jnp.diagonal(L)))
        return (F @ state, F @ covariance @ F.T + W), (white, scale, before)

    start = jnp.diag(jnp.concatenate([jnp.zeros(n), noise.deviation**2]))
    first = jnp.zeros((n + p, columns.shape[-1]))
    return jax.lax.scan(step, (first, start), (H, R, F, W, columns))[1]


class ForceFit(NamedTuple):
    """The most probable random forces with the parameters of the model.

    Attributes:
        motion: the motion without forces at the parameters.
        noise: parameters of the forces and of the sensor noise.
        cost: negative log-likelihood.
    """

    motion: LinearMotion
    noise: ForceNoise
    cost: float


def forced_motion(motion: LinearMotion, noise: RandomForces, v, S) -> ForcedMotion:
    """Return a motion with its residuals and sensitivities, for random forces at their places."""
    linear = motion.without_absent_states(motion.linear_at(noise.places))
    return ForcedMotion(linear, motion.problem.train.t, motion.problem.train.mask, v, S)


def fit_forces(
    start: LinearMotion, noise: RandomForces, first: ForceNoise, steps: int = MOST_FORCE_STEPS
) -> ForceFit:
    """Return the most probable random forces and parameters, from a motion and the parameters of
    forces and sensor noise, in at most `steps` steps; an infinite cost if the start diverges.
    """
    columns, own, longest = start.problem.columns, start.own, start.problem.longest_memory
    chosen = columns.chosen(start.effects)
    names = tuple(columns.names[k] for k in chosen)
    best, step = ForceFit(start, first, np.inf), None
    motion, share = start, 1.0
    for _ in range(steps):
        v, S = motion.columns_of(names)
        finite = all(np.all(np.isfinite(np.asarray(part))) for part in (v, S))
        forced = forced_motion(motion, noise, v, S)
        here = estimate_forces(forced, own, best.noise, longest) if finite else None
        if here is not None and here.cost < best.cost:
            best, step, share = ForceFit(motion, here.noise, here.cost), here, 1.0
        else:
            share *= SHORTER
        if step is None or step.fall < LEAST_FALL or share < SHORTEST_STEP:
            break
        motion = _moved(best.motion, chosen, step, share)
    return best


def _moved(motion: LinearMotion, chosen, step: ForceEstimate, share: float) -> LinearMotion:
    """Return the motion after a share of a step, within the bounds."""
    problem = motion.problem
    limits = Limits.of(free_of(problem, motion.effects), problem.train.n_cases)
    values = motion.values.copy()
    shared = values[chosen] + share * step.shared
    values[chosen] = np.clip(
        shared, np.asarray(limits.lower.shared), np.asarray(limits.upper.shared)
    )
    rows = motion.rows + share * np.asarray(step.own)
    rows = np.clip(rows, np.asarray(limits.lower.rows), np.asarray(limits.upper.rows))
    return LinearMotion(problem, motion.effects, values, rows)
