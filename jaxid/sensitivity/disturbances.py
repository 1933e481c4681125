"""`disturbed_motion`: linear model of a simulation under disturbances of its equations and inputs.

    dx_(i+1) = Phi_i dx_i + P_i d_i + Q_i d_(i+1),    dy_i = C_i dx_i + D_i d_i

along the trajectory of one record, with disturbances `d` in straight lines between the samples.
For `RK4` it is the derivative of the discrete simulation, exact to rounding; the disturbance at
stage s of a step is `(1 - c_s) d_i + c_s d_(i+1)`. For another stepper the equations are linearised
at the samples: their Jacobian `A` by the state is averaged over each interval of length h, that by
the disturbance, `E`, runs straight between both ends. This is accurate to the square of h, and
stable for stiff models:

    [Phi G0 G1 G2; 0 I I I; 0 0 I 2I; 0 0 0 I] = exp [h A  h I  0 0; 0 0 I 0; 0 0 0 2I; 0 0 0 0]
    P = G0 E_i + G1 (E_(i+1) - 2 E_i) - G2 (E_(i+1) - E_i),    Q = G1 E_i + G2 (E_(i+1) - E_i)
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Float
from ..models.base import AbstractModel
from ..simulation.hold import AbstractHold
from ..simulation.simulate import effective_input
from ..simulation.steppers import RK4, AbstractStepper, rate, substeps_of
from .jacobian import value_and_jacobian
from .jacobians import Jacobians
from .linearisation import INPUTS, NODES, SAMPLES_AT_ONCE, WEIGHTS, in_blocks, step


class DisturbedMotion(NamedTuple):
    """Linear model along a trajectory, with a disturbance in each equation and then on each input.

    Attributes:
        x, y: the trajectory.
        u: inputs with which the outputs are evaluated.
        Phi, C: transition and output matrices.
        P, Q, D: matrices of the disturbances.
    """

    x: Float[Array, "time state"]
    y: Float[Array, "time output"]
    u: Float[Array, "time input"]
    Phi: Float[Array, "step state state"]
    P: Float[Array, "step state push"]
    Q: Float[Array, "step state push"]
    C: Float[Array, "time output state"]
    D: Float[Array, "time output push"]


def disturbed_motion(
    model: AbstractModel,
    initial_state: Float[Array, " state"],
    t: Float[Array, " time"],
    u: Float[Array, "time input"],
    hold: AbstractHold,
    stepper: AbstractStepper,
) -> DisturbedMotion:
    """Return the linear model along the trajectory of a model.

    Args:
        model: the model.
        initial_state: its state at the first sample.
        t: sample times [s].
        u: recorded inputs at the samples.
        hold, stepper: those of the simulation.
    """
    path, u = effective_input(model, hold, t, u)
    x, _ = stepper.states(model, t, path, initial_state)

    def at_samples(t, x, u, dx, A, E):
        """Return an output, and its derivatives by state and disturbance."""
        y, (by_x, by_u, by_dx) = _with_jacobians(partial(model.output_given, t), x, u, dx)
        return y, by_x + by_dx @ A, by_dx @ E + jnp.pad(by_u, ((0, 0), (x.size, 0)))

    def of_step(t, x, u, steps):
        Phi, PQ, (dx, A, E) = _transition(model, x, steps)
        return at_samples(t, x, u, dx, A, E), (Phi, PQ)

    def of_sample(t, x, u):
        dx, A, E = _rate(model, t, x, u)
        return at_samples(t, x, u, dx, A, E), (A, E)

    if isinstance(stepper, RK4):
        # a last step of no length gives the outputs at the last sample
        extended, substeps = jnp.append(t, t[-1]), stepper.substeps
        steps = (*substeps_of(extended, substeps), path.stages(extended, substeps))
        steps = jax.tree.map(lambda leaf: leaf.reshape(t.size, substeps, *leaf.shape[1:]), steps)
        (y, C, D), (Phi, PQ) = _blockwise(of_step, (t, x, u, steps))
        Phi, P, Q = Phi[:-1], *jnp.split(PQ[:-1], 2, axis=-1)
    else:
        (y, C, D), (A, E) = _blockwise(of_sample, (t, x, u))
        Phi, P, Q = jax.vmap(_held)(jnp.diff(t), (A[:-1] + A[1:]) / 2.0, E[:-1], E[1:])
    is_step = (jnp.diff(t) > 0)[:, None, None]
    Phi = jnp.where(is_step, Phi, jnp.eye(x.shape[1])[None])
    P, Q = (jnp.where(is_step, part, 0.0) for part in (P, Q))
    return DisturbedMotion(x, y, u, Phi, P, Q, C, D)


def _rate(model: AbstractModel, t, x, u):
    """Return the rate, and its derivatives by the state and by disturbances of the equations and
    the inputs.
    """
    dx, (A, B_u) = _with_jacobians(lambda x, u: rate(model, t, x, u), x, u)
    return dx, A, jnp.concatenate([jnp.eye(x.size), B_u], axis=1)


def _with_jacobians(function, *arguments):
    """Return the value of a function and its Jacobians by all arguments, in one pass."""
    cuts = np.cumsum([argument.size for argument in arguments])[:-1]
    value, columns = value_and_jacobian(
        lambda joined: function(*jnp.split(joined, cuts)), jnp.concatenate(arguments)
    )
    return value, jnp.split(columns, cuts, axis=-1)


def _transition(model: AbstractModel, x, steps):
    """Return the matrices `Phi` and `[P Q]` of an interval, and at its start the rate with its
    derivatives by state and disturbance.
    """
    n = x.size

    def stage(carry, now):
        k, total, x, h = carry
        node, weight, t, u = now
        k, A, E = _rate(model, t + node * h, x + node * h * k, u)
        return (k, total + weight * k, x, h), (k, A, E)

    def substep(carry, now):
        x, Phi, PQ = carry
        t, h, u, first, last = now
        nodes = jnp.array(NODES), jnp.array(WEIGHTS), jnp.full(4, t), u[INPUTS]
        start = (jnp.zeros(n), jnp.zeros(n), x, h)
        (_, total, *_), (k, A, E) = jax.lax.scan(stage, start, nodes)
        share = (first + jnp.array(NODES) * (last - first))[:, None, None]
        pushed = jnp.concatenate([(1.0 - share) * E, share * E], axis=-1)
        (own,), (push,) = step(Jacobians(A[:, None], None, pushed[:, None]), None, h[None])
        return (x + h / 6 * total, own @ Phi, own @ PQ + push), (k[0], A[0], E[0])

    begin, length, u = steps
    edges = jnp.arange(begin.size + 1) / begin.size
    still = x, jnp.eye(n), jnp.zeros((n, 2 * (n + u.shape[-1])))
    (_, Phi, PQ), rates = jax.lax.scan(substep, still, (begin, length, u, edges[:-1], edges[1:]))
    return Phi, PQ, jax.tree.map(lambda leaf: leaf[0], rates)


def _held(h, A, before, after):
    """Return `Phi`, `P` and `Q` of one interval with a constant Jacobian by the state."""
    n, eye = A.shape[0], jnp.eye(A.shape[0])
    block = jnp.zeros((4 * n, 4 * n)).at[:n, :n].set(h * A).at[:n, n : 2 * n].set(h * eye)
    block = block.at[n : 2 * n, 2 * n : 3 * n].set(eye).at[2 * n : 3 * n, 3 * n :].set(2.0 * eye)
    Phi, constant, linear, square = jnp.split(jax.scipy.linalg.expm(block)[:n], 4, axis=1)
    change = after - before
    P = constant @ before + linear @ (change - before) - square @ change
    return Phi, P, linear @ before + square @ change


def _blockwise(function, samples):
    """Return the values of a function at all samples, computed in blocks of them."""
    count = samples[0].shape[0]
    size = min(SAMPLES_AT_ONCE, count)
    blocks = jax.tree.map(lambda leaf: in_blocks(leaf, size), samples)
    values = jax.lax.map(lambda block: jax.vmap(function)(*block), blocks)
    return jax.tree.map(lambda leaf: jax.lax.collapse(leaf, 0, 2)[:count], values)
