"""Sensitivities of a fixed-step simulation by the linearisation of its steps.

The equations are linearised at every Runge-Kutta stage point of a simulated trajectory, for many
points at once: `A = df/dx`, `B_u = df/du`, `B = df/dtheta`. A step of the state's sensitivities
`X = dx/dtheta` is then linear, and only this recursion of small products is sequential:

    K_s = A_s (X + c_s h K_(s-1)) + B_s + B_u,s dU_s,    X + h/6 (K_1 + 2 K_2 + 2 K_3 + K_4)
        = Phi X + G
    S = dy/dtheta = H X + D

It is the derivative of the discrete simulation (in place of Eq. 4.6 to 4.9), exact to rounding.
Parameters that act on the input signal, or on the sampled outputs, do so in some leaves of the
model only; derivatives of these signals are taken by these leaves alone.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.dependence import depends_on, returns_argument
from .._foundation.types import Array, Float
from ..models.free_model import FreeModel, Leaves
from ..simulation.hold import AbstractHold
from ..simulation.simulate import effective_input
from ..simulation.steppers import RK4, rate, substeps_of
from .jacobians import Differentiation, Jacobians, by_elements

# Samples linearised at once, and elements of the derivatives at one stage of them (chosen): the
# arrays of one block stay in the processor's cache.
SAMPLES_AT_ONCE, ELEMENTS_AT_ONCE = 96, 100_000
# Groups into which the samples of a block are divided for the outputs, as the stages divide the
# equations: a loop over them separates the linearisation from its application.
OUTPUT_GROUPS = 4
# Columns at once through the effects on the sampled outputs, for the same reason, and the number of
# such groups from which the columns are divided (chosen).
COLUMNS_AT_ONCE, MIN_GROUPS = 16, 4
# Runge-Kutta stages: fraction of the step, weight of the rate, and index of the input in
# `AbstractInputSignal.stages`.
NODES, WEIGHTS, INPUTS = (0.0, 0.5, 0.5, 1.0), (1.0, 2.0, 2.0, 1.0), np.array([0, 1, 1, 2])


class Trajectory(NamedTuple):
    """A simulated record.

    Attributes:
        t: sample times [s].
        u: recorded inputs at the samples.
        x: simulated states at the samples.
        hold, stepper: those of the simulation.
    """

    t: Float[Array, " time"]
    u: Float[Array, "time input"]
    x: Float[Array, "time state"]
    hold: AbstractHold
    stepper: RK4


class Inputs(NamedTuple):
    """The effective input, and its derivatives by the leaves of the model that act on it.

    Attributes:
        at_stages: values at the stages of every step, by sample interval.
        at_samples: values with which the outputs are evaluated.
        d_stages, d_samples: their derivatives by the elements of these leaves; no element if no
            free parameter acts on the input.
    """

    at_stages: Float[Array, "time substep stage input"]
    at_samples: Float[Array, "time input"]
    d_stages: Float[Array, "time substep stage input element"]
    d_samples: Float[Array, "time input element"]


def trajectory_sensitivities(
    family: FreeModel, theta: Float[Array, " column"], trajectory: Trajectory
) -> Float[Array, "time output column"]:
    """Return the sensitivities of the outputs along a simulated trajectory.

    Args:
        family: the model as a function of its free parameters.
        theta: values of the free parameters with which the trajectory was simulated.
        trajectory: the simulated record.
    """
    leaves, t = family.leaves(theta), trajectory.t
    substeps = trajectory.stepper.substeps
    size = _block_size(t.size, trajectory.x.shape[1] * family.n_columns)
    acting, inputs = input_derivatives(family, leaves, trajectory)
    begin, length = substeps_of(jnp.append(t, t[-1]), substeps)
    steps = (begin.reshape(-1, substeps), length.reshape(-1, substeps))
    equations = equation_derivatives(family, leaves, trajectory, acting)
    outputs, by_rate = _outputs(family, leaves, trajectory, acting)

    def block(X, now):
        t, x, steps, inputs = now
        Phi, G, (dx, A, B) = _transition(equations, leaves, x, steps, inputs, acting)
        X, columns = jax.lax.scan(lambda X, now: (now[0] @ X + now[1], X), X, (Phi, G))
        if by_rate:
            x = jnp.concatenate([x, dx], axis=-1)
            columns = jnp.concatenate([columns, A @ columns + B], axis=-2)
        return X, _output_columns(outputs, leaves, (t, x, columns), inputs, acting)

    # the last sample, which fills the last block, has a step of no length
    now = jax.tree.map(lambda leaf: in_blocks(leaf, size), (t, trajectory.x, steps, inputs))
    y, S = jax.lax.scan(block, initial_sensitivities(family, leaves), now)[1]
    y, S = (leaf.reshape(-1, *leaf.shape[2:])[: t.size] for leaf in (y, S))
    return _observed(family, leaves, t, y, S)


def in_blocks(leaf: Array, size: int) -> Array:
    """Return an array in blocks of samples; the last sample is repeated to fill the last block."""
    n_blocks = -(-leaf.shape[0] // size)
    padding = ((0, n_blocks * size - leaf.shape[0]),) + ((0, 0),) * (leaf.ndim - 1)
    return jnp.pad(leaf, padding, mode="edge").reshape(n_blocks, size, *leaf.shape[1:])


def _block_size(samples: int, elements: int) -> int:
    """Return the number of samples linearised at once, a multiple of `OUTPUT_GROUPS`.

    Args:
        samples: samples of the record.
        elements: elements of the derivatives of the states at one sample.
    """
    groups = min(SAMPLES_AT_ONCE, max(ELEMENTS_AT_ONCE // elements, 1)) // OUTPUT_GROUPS
    return OUTPUT_GROUPS * min(max(groups, 1), -(-samples // OUTPUT_GROUPS))


def initial_sensitivities(family: FreeModel, leaves: Leaves) -> Float[Array, "state column"]:
    """Return the sensitivities of the initial state."""

    def push(tangent):
        return jax.jvp(lambda leaves: family.build(leaves)[1], (leaves,), (tangent,))[1]

    return jax.vmap(push, out_axes=-1)(family.tangents(range(len(leaves))))


def input_derivatives(
    family: FreeModel, leaves: Leaves, trajectory: Trajectory
) -> tuple[tuple[int, ...], Inputs]:
    """Return the leaves that act on the input, and the effective input with its derivatives."""
    t, u, _, hold, stepper = trajectory

    def values(*leaves):
        model, _ = family.build(leaves)
        path, at_samples = effective_input(model, hold, t, u)
        stages = path.stages(jnp.append(t, t[-1]), stepper.substeps)
        return stages.reshape(t.size, stepper.substeps, *stages.shape[1:]), at_samples

    acting = tuple(index for index, used in enumerate(depends_on(values, leaves)) if used)
    (at_stages, at_samples), derivatives = by_elements(values, leaves, acting)
    return acting, Inputs(at_stages, at_samples, *derivatives)


def equation_derivatives(family, leaves: Leaves, trajectory: Trajectory, acting) -> Differentiation:
    """Return how the equations of motion are differentiated."""

    def rates(t, x, u, leaves):
        return rate(family.build(leaves)[0], t, x, u)

    at = trajectory.t[0], trajectory.x[0], trajectory.u[0]
    return Differentiation.of(family, rates, at, leaves, by_input=bool(acting))


def _outputs(
    family, leaves: Leaves, trajectory: Trajectory, acting
) -> tuple[Differentiation, bool]:
    """Return how the outputs are differentiated, as functions of the state or, if they depend on it
    as well, of the state and its rate; and whether they depend on it.
    """
    t, x, u = trajectory.t[0], trajectory.x[0], trajectory.u[0]

    def given(x, dx, t=t, u=u, leaves=leaves):
        return family.build(leaves)[0].output_given(t, x, u, dx)

    _, by_rate = depends_on(given, (x, x))

    def outputs(t, state, u, leaves):
        x, dx = jnp.split(state, 2) if by_rate else (state, state)
        return given(x, dx, t, u, leaves)

    at = t, jnp.tile(x, 2) if by_rate else x, u
    return Differentiation.of(family, outputs, at, leaves, by_input=bool(acting)), by_rate


def _transition(equations: Differentiation, leaves: Leaves, x, steps, inputs: Inputs, acting):
    """Return the matrices `Phi` and `G` of all sample intervals of a block, and at the samples the
    rates with their derivatives by state and free parameters.
    """

    def substep(x, now):
        begin, length, u, du = now
        x, dx, _, jacobians = stage_jacobians(equations, leaves, x, begin, length, u[:, INPUTS, :])
        A, B_u, B = jacobians
        if B_u is None:
            return x, (*step(jacobians, None, length), (dx, A[0], B[0]))
        dU = equations.family.select(jnp.moveaxis(du, 1, 0), acting)[INPUTS]
        return x, (*step(jacobians, dU, length), (dx, A[0], B[0] + B_u[0] @ dU[0]))

    def then(before, after):
        return (after[0] @ before[0], after[0] @ before[1] + after[1]), None

    by_substep = jax.tree.map(
        lambda leaf: jnp.moveaxis(leaf, 1, 0), (*steps, inputs.at_stages, inputs.d_stages)
    )
    _, (Phi, G, rates) = jax.lax.scan(substep, x, by_substep)
    (interval_Phi, interval_G), _ = jax.lax.scan(then, (Phi[0], G[0]), (Phi[1:], G[1:]))
    return interval_Phi, interval_G, jax.tree.map(lambda leaf: leaf[0], rates)


def stage_jacobians(equations: Differentiation, leaves: Leaves, x, begin, length, u):
    """Return for many intervals the states after a step, the rates before it, and the states and
    the Jacobians at its four stages.
    """

    def stage(carry, now):
        k, total = carry
        node, weight, u = now
        at = x + (node * length)[:, None] * k
        k, linear = equations.linearise(leaves, begin + node * length, at, u)
        return (k, total + weight * k), (k, at, linear)

    zero = jnp.zeros_like(x)
    stages = (jnp.array(NODES), jnp.array(WEIGHTS), jnp.moveaxis(u, 1, 0))
    (_, total), (k, at, linear) = jax.lax.scan(stage, (zero, zero), stages)
    return x + length[:, None] / 6 * total, k[0], at, equations.apply_by_stage(linear)


def step(jacobians: Jacobians, dU, length):
    """Return `Phi` and `G` of many steps from the Jacobians at their stages.

    `M_s` is the derivative of the state after the step by the rate of stage s. `dU` are the
    derivatives of the input at the stages by the free parameters, None if it has none.
    """
    A, B_u, B = jacobians
    h, eye = length[:, None, None], jnp.eye(A.shape[-1])[None]
    M, Phi, G = h / 6 * eye, eye, 0.0
    for stage in (3, 2, 1, 0):
        product = M @ A[stage]
        Phi, G = Phi + product, G + M @ B[stage]
        if B_u is not None:
            G = G + (M @ B_u[stage]) @ dU[stage]
        if stage:
            M = h / 6 * WEIGHTS[stage - 1] * eye + NODES[stage] * h * product
    return Phi, G


def _output_columns(outputs: Differentiation, leaves: Leaves, samples, inputs: Inputs, acting):
    """Return the outputs at the samples of a block, and their sensitivities."""
    t, states, X = samples
    points = (t, states, inputs.at_samples)
    groups = jax.tree.map(
        lambda leaf: leaf.reshape(OUTPUT_GROUPS, t.size // OUTPUT_GROUPS, *leaf.shape[1:]), points
    )
    y, linear = jax.lax.map(lambda group: outputs.linearise(leaves, *group), groups)
    y, jacobians = jax.tree.map(
        lambda leaf: leaf.reshape(t.size, *leaf.shape[2:]),
        (y, outputs.apply_by_stage(linear)),
    )
    S = jacobians.A @ X + jacobians.B
    if jacobians.B_u is not None:
        S = S + jacobians.B_u @ outputs.family.select(inputs.d_samples, acting)
    return y, S


def _observed(family: FreeModel, leaves: Leaves, t, y, S) -> Float[Array, "time output column"]:
    """Return the sensitivities after the effects that act on the sampled outputs."""

    def observe(y, *leaves):
        return family.build(leaves)[0].observe(t, y)

    if returns_argument(lambda y: observe(y, *leaves), y):
        return S
    columns = _in_groups(jax.linearize(lambda y: observe(y, *leaves), y)[1], S)
    _, *used = depends_on(observe, (y, *leaves))
    acting = tuple(index for index, by_leaf in enumerate(used) if by_leaf)
    if not acting:
        return columns
    _, derivatives = by_elements(lambda *leaves: observe(y, *leaves), leaves, acting)
    return columns + family.select(derivatives, acting)


def _in_groups(function, columns: Float[Array, "*axes column"]) -> Float[Array, "*axes column"]:
    """Return the images of columns under a function, for a few columns at a time."""
    image = jax.vmap(function, in_axes=-1, out_axes=-1)
    n_columns, n_groups = columns.shape[-1], -(-columns.shape[-1] // COLUMNS_AT_ONCE)
    if n_groups < MIN_GROUPS:
        return image(columns)
    padding = ((0, 0),) * (columns.ndim - 1) + ((0, n_groups * COLUMNS_AT_ONCE - n_columns),)
    groups = jnp.pad(columns, padding).reshape(*columns.shape[:-1], n_groups, COLUMNS_AT_ONCE)
    images = jnp.moveaxis(jax.lax.map(image, jnp.moveaxis(groups, -2, 0)), 0, -2)
    return images.reshape(*columns.shape[:-1], -1)[..., :n_columns]
