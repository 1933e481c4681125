r"""Information of one record with the gain of the filter frozen.

In the derivatives by the parameters of the model, the gains `K_i` and the covariances `P_i`, `B_i`
of the filter at the present parameters are constants (A.58 with `dK/d theta = 0`):

    S_i = H X + y_p,    X <- Phi (X - K S_i) + G,    rows [ L^-1 S_i,  w ]

In the derivatives by the parameters of the noise, `Phi` and `H` do not change with the state:

    dP+ = N dP N' + K dR K',    X+ = X - K S + N dP V' w - K dR L^-T w
    dP <- Phi dP+ Phi' + d(Phi) P+ Phi' + Phi P+ d(Phi)' + dQd,    X <- Phi X+ + G
    rows [ vec(V dP V' + L^-1 dR L^-T)/sqrt(2),  vec(I - w w')/sqrt(2) ]

with the symbols of `update_derivatives`; for a linear model these are exact. Not contained are the
derivatives of gain and covariances by the parameters of the model, which need all second
derivatives of the model.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..._foundation.dependence import depends_on
from ..._foundation.linalg import triangle
from ..._foundation.types import Array, Float
from ...data.record import Record
from ...models.free_model import FreeModel, Leaves
from ...models.names import array_leaves
from ...models.stochastic import StochasticModel
from ...sensitivity.jacobians import Differentiation, by_elements
from ...sensitivity.linearisation import (
    INPUTS,
    Inputs,
    equation_derivatives,
    in_blocks,
    initial_sensitivities,
    stage_jacobians,
    step,
)
from ...simulation.hold import AbstractHold
from ..likelihoods import Folded
from .filter_run import SAMPLES_TOGETHER, FilterRun, Measured, stochastic
from .innovation_rows import innovation_rows, pairs
from .kalman import (
    MIDDLE,
    SERIES_TERMS,
    SERIES_WEIGHTS,
    Steps,
    initial_moments,
    inverse_cholesky,
    predicted,
)
from .matrix_derivatives import congruence, left_product
from .update_derivatives import (
    measured_jacobians,
    noise_forms,
    output_derivatives,
)


class Derivatives(NamedTuple):
    """How the model is differentiated.

    Attributes:
        family: the model as a function of its free parameters.
        leaves: the leaves that hold free parameters.
        acting: indices of the leaves that act on the input.
        noise: indices of the leaves that are parameters of the noises, one number each.
        in_diffusion: noise leaves on which the diffusion depends, and the rates do not.
        in_rates: noise leaves on which the rates of the states depend: correlation times.
        equations, outputs: the rates of the states and the outputs.
        variances: derivatives of the variances of the sensors by the parameters of the noises.
    """

    family: FreeModel
    leaves: Leaves
    acting: tuple[int, ...]
    noise: tuple[int, ...]
    in_diffusion: tuple[int, ...]
    in_rates: tuple[int, ...]
    equations: Differentiation
    outputs: Differentiation
    variances: Float[Array, "output noise"]


class Block(NamedTuple):
    """Samples that are differentiated at once.

    Attributes:
        measured: the filter at the samples.
        x: states after them.
        steps: steps to the next samples.
        inputs: the effective input with its derivatives.
        rows: `w` and `vec(I - w w')/sqrt(2)`.
        weight: zero for samples that only fill the block.
    """

    measured: Measured
    x: Float[Array, "sample state"]
    steps: Steps
    inputs: Inputs
    rows: Float[Array, "sample row"]
    weight: Float[Array, " sample"]


class Recursion(NamedTuple):
    """Recursion from a sample to the next, `X <- A X + C`, `dP <- A dP A' + D`.

    The last columns of X belong to the parameters of the noises, and receive `A dP b` too.
    """

    A: Float[Array, "sample state state"]
    b: Float[Array, "sample state"]
    C: Float[Array, "sample state column"]
    D: Float[Array, "sample state state noise"]


class Rows(NamedTuple):
    """Linear functions from X and dP to the rows: `V X + y`, `V dP V' + B`."""

    V: Float[Array, "sample output state"]
    y: Float[Array, "sample output parameter"]
    B: Float[Array, "sample output output noise"]


def frozen_gain(
    family: FreeModel,
    theta: Float[Array, " parameter"],
    record: Record,
    hold: AbstractHold,
    substeps: int,
    *,
    steady: bool,
) -> Folded:
    """Return rows and triangle of one record with the gain frozen.

    Args:
        family: the model and the initial state as functions of the parameters.
        theta: values of the parameters.
        record, hold, substeps, steady: as in `kalman_filter`.
    """
    leaves, m = family.leaves(theta), record.z.shape[-1]
    run = FilterRun.of(family, leaves, record, hold, substeps, steady=steady)
    filtered = run.filtered
    derivatives = _derivatives(family, leaves, run.trajectory, run.acting)
    rows = innovation_rows(filtered.v, inverse_cholesky(filtered.B), record.mask)
    block = Block(
        *(run.measured, filtered.x, run.steps, run.inputs),
        *(rows[:, : m * (m + 3) // 2], jnp.ones_like(record.t)),
    )
    block = jax.tree.map(lambda leaf: in_blocks(leaf, SAMPLES_TOGETHER), block)
    index = jnp.arange(block.weight.size).reshape(block.weight.shape)
    block = block._replace(weight=(index < record.t.size) * 1.0)

    def start(*leaves):
        model, _ = stochastic(family, leaves)
        return initial_moments(model, record, run.initial_state, hold, substeps, steady)[1]

    X = initial_sensitivities(family, leaves)
    dP = by_elements(start, leaves, derivatives.noise)[1]
    X = jnp.concatenate([X, jnp.zeros(dP.shape[1:])], axis=1)
    return Folded(rows, _folded(derivatives, (X, dP), block))


def _derivatives(family: FreeModel, leaves: Leaves, trajectory, acting) -> Derivatives:
    """Return how the model is differentiated."""
    assert isinstance(family.model, StochasticModel), "a model from `prepared`"
    own, every = len(array_leaves(family.model.model)), len(array_leaves(family.model))
    noise = tuple(i for i, leaf in enumerate(family.positions.leaves) if own <= leaf < every)
    at = trajectory.t[0], trajectory.x[0], trajectory.u[0]

    def acts(function):
        used = depends_on(lambda *leaves: function(stochastic(family, leaves)[0]), leaves)
        return tuple(index for index in noise if used[index])

    def variances(*leaves):
        return stochastic(family, leaves)[0].sensor_deviations() ** 2

    in_rates = acts(lambda model: model.rhs(*at))
    in_diffusion = acts(lambda model: model.diffusion(*at))
    return Derivatives(
        *(family, leaves, acting, noise),
        *(tuple(index for index in in_diffusion if index not in in_rates), in_rates),
        equation_derivatives(family, leaves, trajectory, acting),
        output_derivatives(family, leaves, at, acting),
        by_elements(variances, leaves, noise)[1],
    )


def _folded(derivatives: Derivatives, begin, blocks: Block) -> Float[Array, "column column"]:
    """Return the triangle of all blocks of samples."""
    family, noise, m = derivatives.family, derivatives.noise, blocks.measured.v.shape[-1]

    def block(carry, now: Block):
        moments, first, second = carry
        recursion, rows = _linearised(derivatives, now)
        moments, (X, dP) = jax.lax.scan(_step, moments, recursion)
        X = X[..., : -len(noise)] + family.select(X[..., -len(noise) :], noise) if noise else X
        S = jnp.concatenate([rows.V @ X + rows.y, now.rows[:, :m, None]], axis=-1)
        dB = jax.vmap(congruence)(rows.V, dP) + rows.B
        spread = jnp.concatenate([-pairs(dB), now.rows[:, m:, None]], axis=-1)
        return (moments, _added(first, S, now.weight), _added(second, spread, now.weight)), None

    def empty(width):
        return jnp.zeros((width, width))

    start = begin, empty(family.n_columns + 1), empty(len(noise) + 1)
    (_, first, second), _ = jax.lax.scan(block, start, blocks)
    if not noise:
        return first
    columns = family.select(second[:, :-1], noise)
    return triangle(jnp.concatenate([first, jnp.column_stack([columns, second[:, -1]])]))


def _added(factor, rows: Float[Array, "sample row column"], weight):
    """Return the triangle with further rows."""
    rows = (rows * weight[:, None, None]).reshape(-1, rows.shape[-1])
    return triangle(jnp.concatenate([factor, rows]))


def _linearised(derivatives: Derivatives, now: Block) -> tuple[Recursion, Rows]:
    """Return the recursion and the rows of a block as linear functions of X and dP."""
    leaves, acting, measured = derivatives.leaves, derivatives.acting, now.measured
    d_samples = now.inputs.d_samples
    H, y_p, _ = measured_jacobians(derivatives.outputs, leaves, acting, measured, d_samples)
    inverse = inverse_cholesky(measured.B)
    V = inverse @ H
    K = measured.P @ jnp.swapaxes(V, 1, 2) @ inverse
    w = jnp.einsum("tij,tj->ti", inverse, measured.v)
    dR = jnp.where(measured.mask[:, :, None], derivatives.variances[None], 0.0)
    Phi, G, dQ = _transition(derivatives, now)
    moved = Phi @ K
    weighted = jnp.einsum("ti,tij->tj", w, inverse)
    by_noise = -moved @ (dR * weighted[..., None])
    recursion = Recursion(
        Phi @ (jnp.eye(K.shape[1])[None] - K @ H),
        jnp.einsum("tij,ti->tj", V, w),
        jnp.concatenate([G - moved @ y_p, by_noise], axis=-1),
        noise_forms(moved, dR) + dQ,
    )
    return recursion, Rows(V, inverse @ y_p, noise_forms(inverse, dR))


def _transition(derivatives: Derivatives, now: Block):
    """Return `Phi` and `G` from each sample to the next, and the derivatives of `Phi P+ Phi' + Qd`
    by the parameters of the noises, at constant P+ and state.
    """
    family, leaves, equations = derivatives.family, derivatives.leaves, derivatives.equations

    def substep(x, now):
        (begin, length, u), du = now
        points = begin, length, u[:, INPUTS, :]
        x_next, _, at, jacobians = stage_jacobians(equations, leaves, x, *points)
        dU = None
        if jacobians.B_u is not None:
            dU = family.select(jnp.moveaxis(du, 1, 0), derivatives.acting)[INPUTS]
        middle = begin + length / 2, at[MIDDLE], u[:, 1]
        dQ = _noise_of_steps(derivatives, middle, jacobians.A[MIDDLE], length)
        return x_next, (*step(jacobians, dU, length), dQ)

    def then(before, after):
        Phi, G, dQ = after
        moved = jax.vmap(congruence)(Phi, before[2]) + dQ
        return (Phi @ before[0], Phi @ before[1] + G, moved), None

    by_substep = jax.tree.map(
        lambda leaf: jnp.moveaxis(leaf, 1, 0), (now.steps, now.inputs.d_stages)
    )
    _, parts = jax.lax.scan(substep, now.x, by_substep)
    first, rest = (jax.tree.map(lambda leaf, at=at: leaf[at], parts) for at in (0, slice(1, None)))
    (Phi, G, dQ), _ = jax.lax.scan(then, first, rest)
    return Phi, G, dQ + _by_rates(derivatives, now)


def _noise_of_steps(derivatives: Derivatives, points, A, length):
    """Return the derivatives of `Qd` of a step by the parameters of the diffusion alone.

    With the factors `L_j` of `Qd`, `dQd = h sum_jk dL_j L_k' / (j + k + 1)` and its transpose.
    """

    def diffusion(*leaves):
        return jax.vmap(stochastic(derivatives.family, leaves)[0].diffusion)(*points)

    G, dG = by_elements(diffusion, derivatives.leaves, derivatives.in_diffusion)
    both, h = jnp.concatenate([G[..., None], dG], axis=-1), length[:, None, None]
    samples, n, width = G.shape[0], G.shape[1], both[0, 0].size
    L = [both.reshape(samples, n, width)]
    for j in range(1, SERIES_TERMS):
        L.append(h / j * (A @ L[-1]))
    L = jnp.stack(L, axis=1).reshape(samples, SERIES_TERMS, *both.shape[1:])
    weighted = jnp.einsum("jk,tkbr->tjbr", SERIES_WEIGHTS, h[..., None] * L[..., 0])
    half = jnp.einsum("tjarq,tjbr->tabq", L[..., 1:], weighted)
    return _placed(derivatives, half + jnp.swapaxes(half, 1, 2), derivatives.in_diffusion)


def _by_rates(derivatives: Derivatives, now: Block):
    """Return the derivatives of `Phi P+ Phi' + Qd` by the parameters of the rates."""

    def covariance(*leaves):
        model, _ = stochastic(derivatives.family, leaves)

        def one(x, P, steps):
            _, Phi, Q = predicted(model, x, steps)
            return Phi @ P @ Phi.T + Q

        return jax.vmap(one)(now.x, now.measured.P_after, now.steps)

    if not derivatives.in_rates:
        return 0.0
    _, columns = by_elements(covariance, derivatives.leaves, derivatives.in_rates)
    return _placed(derivatives, columns, derivatives.in_rates)


def _placed(derivatives: Derivatives, columns, which: tuple[int, ...]):
    """Return derivatives by some noise parameters as columns of all, zero for the others."""
    at = [derivatives.noise.index(index) for index in which]
    shape = (*columns.shape[:-1], len(derivatives.noise))
    return jnp.zeros(shape).at[..., at].set(columns)


def _step(carry, now: Recursion):
    """Return the derivatives at the next sample, and those at this one."""
    X, dP = carry
    count = dP.shape[-1]
    turned = left_product(now.A, dP)
    driven = jnp.einsum("iaq,a->iq", turned, now.b)
    later = (now.A @ X + now.C).at[:, X.shape[1] - count :].add(driven)
    later_P = left_product(now.A, jnp.swapaxes(turned, 0, 1)) + now.D
    return (later, later_P), carry
