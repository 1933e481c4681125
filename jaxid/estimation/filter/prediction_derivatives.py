r"""Derivatives of a filter's prediction, for many samples at once.

In a Runge-Kutta step with the Jacobians `A_s = df/dx` and `B_s` (by the parameters) at its stages
`x_s`, let `X_s` be the derivatives of a stage by the state before the step and the parameters, and
`M_s` the derivative of the state after the step by the rate of stage s. Then

    X_s = [I 0] + c_s h K_(s-1),    K_s = A_s X_s + [0 B_s],    [Phi G] = [I 0] + h/6 sum_s w_s K_s
    d(Phi P Phi') = Phi dP Phi' + sum_s (M_s dA_s W_s + its transpose),    W_s = X_s [I 0]' P Phi'

The noise `Qd = h sum_jk L_j L_k'/(j + k + 1)` of the module `kalman` depends on `A` and `G` at the
middle stage: with `a = h A`, `N_j = h sum_k L_k/(j + k + 1)`,

    dQd = sum_j dL_j N_j' + its transpose,    dL_j = sum_i h a^i k!/j! dA L_k + a^j/j! dG,
                                              k = j - 1 - i
"""

from math import factorial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.types import Array, Float
from ...models.free_model import FreeModel, Leaves
from ...models.stochastic import StochasticModel
from ...sensitivity.jacobians import Differentiation, Jacobians
from ...sensitivity.linearisation import INPUTS, NODES, WEIGHTS, stage_jacobians
from ...simulation.steppers import rate
from .kalman import SERIES_TERMS, SERIES_WEIGHTS, Steps

# Stages in the order in which their second derivatives are kept: the middle one, last, enters the
# noise as well.
STAGE_ORDER = np.array([0, 1, 3, 2])


class Partials(NamedTuple):
    """Partials derivatives, on the last axis.

    Attributes:
        x: by the state.
        p: by the free parameters.
    """

    x: Float[Array, "*axes state"]
    p: Float[Array, "*axes parameter"]

    @classmethod
    def of(cls, columns: Float[Array, "*axes column"], states: int) -> "Partials":
        """Return the derivatives with the given columns, those by the state first."""
        return cls(columns[..., :states], columns[..., states:])

    def along(self, dx: Float[Array, "*batch state parameter"]) -> Float[Array, "*axes parameter"]:
        """Return the total derivatives by the parameters, with those of the state."""
        return self.x @ dx + self.p


class Prediction(NamedTuple):
    """Derivatives of state and covariance after a step, at constant covariance before it.

    Attributes:
        x: of the state, `Phi` and `G`.
        P: of the covariance.
    """

    x: Partials
    P: Partials


class Stages(NamedTuple):
    """Runge-Kutta stages of a step, in the notation of the module; `d_u` is None if no
    parameter acts on the input.
    """

    t: Float[Array, "stage sample"]
    x: Float[Array, "stage sample state"]
    u: Float[Array, "stage sample input"]
    A: Float[Array, "stage sample state state"]
    M: Float[Array, "stage sample state state"]
    W: Float[Array, "stage sample state state"]
    X: Float[Array, "stage sample state column"]
    d_u: Float[Array, "stage sample input parameter"] | None


class PredictionModel(NamedTuple):
    """The parts of a model that the prediction differentiates.

    Attributes:
        equations: the rates of the states.
        diffusion: the elements of the noise's matrix `G`.
        leaves: the leaves that hold free parameters.
        acting: indices of the leaves that act on the input.
    """

    equations: Differentiation
    diffusion: Differentiation
    leaves: Leaves
    acting: tuple[int, ...]

    @classmethod
    def of(cls, family: FreeModel, leaves: Leaves, at, acting) -> "PredictionModel":
        """Return the parts of a family's model; `at` are time, state and input of any point."""

        def rates(t, x, u, leaves):
            return rate(family.build(leaves)[0], t, x, u)

        def diffusion(t, x, u, leaves):
            model = family.build(leaves)[0]
            assert isinstance(model, StochasticModel), "a model from `prepared`"
            return model.diffusion(t, x, u).reshape(-1)

        by_input = bool(acting)
        equations = Differentiation.of(family, rates, at, leaves, by_input)
        noise = Differentiation.of(family, diffusion, at, leaves, by_input)
        return cls(equations, noise, leaves, acting)


def differentiate_prediction(
    model: PredictionModel,
    x: Float[Array, "sample state"],
    P: Float[Array, "sample state state"],
    steps: Steps,
    d_inputs: Float[Array, "sample substep stage input element"],
) -> Prediction:
    """Return the derivatives of the prediction from each sample to the next.

    Args:
        model: the parts of the model.
        x, P: state and covariance after the measurement at each sample.
        steps: the steps to the next samples.
        d_inputs: derivatives of the inputs by the elements of the leaves that act on them.
    """

    def substep(carry, now):
        x, P = carry
        x, P, step = _step(model, x, P, *now)
        return (x, P), step

    def then(before: Prediction, after: Prediction):
        Phi, by_state = after.x.x, after.P.x
        columns = [Phi @ before.x.x, after.x.along(before.x.p)]

        def moved(own, dx):
            return jnp.einsum("tai,tijc,tbj->tabc", Phi, own, Phi) + _times(by_state, dx)

        P = Partials(moved(before.P.x, before.x.x), moved(before.P.p, before.x.p) + after.P.p)
        return Prediction(Partials(*columns), P), None

    now = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 1, 0), (steps, d_inputs))
    _, parts = jax.lax.scan(substep, (x, P), now)
    first, rest = (jax.tree.map(lambda leaf, at=at: leaf[at], parts) for at in (0, slice(1, None)))
    return jax.lax.scan(then, first, rest)[0]


def _step(model: PredictionModel, x, P, steps: Steps, d_inputs):
    """Return state and covariance after a step, and their derivatives."""
    begin, length, u = steps
    n, h = x.shape[-1], length[:, None, None]
    family, leaves = model.equations.family, model.leaves
    x_next, _, at, jacobians = stage_jacobians(
        model.equations, leaves, x, begin, length, u[:, INPUTS, :]
    )
    A, B_u, B = jacobians
    d_u = None
    if B_u is not None:
        d_u = family.select(jnp.moveaxis(d_inputs, 1, 0), model.acting)[INPUTS]
        B = B + B_u @ d_u
    X, after = _stage_columns(A, B, h)
    M, Phi = _by_rates(A, h), after[..., :n]
    W = X[..., :n] @ (P @ jnp.swapaxes(Phi, 1, 2))[None]
    times = begin[None] + np.array(NODES)[:, None] * length[None]
    stages = Stages(times, at, jnp.moveaxis(u, 1, 0)[INPUTS], A, M, W, X, d_u)
    C, Q = _covariance(model, jax.tree.map(lambda leaf: leaf[STAGE_ORDER], stages), h)
    P = Phi @ P @ jnp.swapaxes(Phi, 1, 2) + Q
    return x_next, P, Prediction(Partials.of(after, n), C)


def _stage_columns(A, B, h):
    """Return `X` of all stages and `[Phi G]`."""
    n = A.shape[-1]
    eye = jnp.broadcast_to(jnp.eye(n), A.shape[1:])
    start = jnp.concatenate([eye, jnp.zeros_like(B[0])], axis=-1)
    K, after, stages = jnp.zeros_like(start), start, []
    for stage, (node, weight) in enumerate(zip(NODES, WEIGHTS, strict=True)):
        stages.append(start + node * h * K)
        K = (A[stage] @ stages[-1]).at[..., n:].add(B[stage])
        after = after + weight / 6 * h * K
    return jnp.stack(stages), after


def _by_rates(A, h):
    """Return `M` of all stages."""
    eye = jnp.broadcast_to(jnp.eye(A.shape[-1]), A.shape[1:])
    M = [h / 6 * eye]
    for stage in (3, 2, 1):
        M.append(h / 6 * WEIGHTS[stage - 1] * eye + NODES[stage] * h * (M[-1] @ A[stage]))
    return jnp.stack(M[::-1])


def _forms(model: PredictionModel, stages: Stages) -> Jacobians:
    """Return the derivatives of `M_s A_s W_s`, and for the middle stage those of `A` itself.

    Shapes (state, state, stage, sample, element).
    """
    eye = jnp.eye(stages.A.shape[-1])
    parts = (stages.t, stages.x, stages.u, stages.M.at[-1].set(eye), stages.W.at[-1].set(eye))
    *points, rows, columns = (leaf.reshape(-1, *leaf.shape[2:]) for leaf in parts)
    forms = model.equations.derivatives_of_forms(
        model.leaves, points, jnp.moveaxis(rows, 1, 0), jnp.moveaxis(columns, 2, 0)
    )
    return jax.tree.map(
        lambda leaf: leaf.reshape(*leaf.shape[:2], *stages.t.shape, leaf.shape[-1]), forms
    )


def _covariance(model: PredictionModel, stages: Stages, h):
    """Return the derivatives of the covariance after the step, and the covariance of its noise.

    Only the upper triangles of the symmetric derivatives are computed.
    """
    samples, n = stages.A.shape[1:3]
    forms, d_u = _forms(model, stages), stages.d_u
    d_G, by_A, by_G, Q = _noise(model, stages, h)
    (row, column), position = np.triu_indices(n), _positions(n)

    def symmetric(leaf):
        """Return the upper triangle of `leaf + its transpose`, samples first."""
        leaf = leaf[row, column] + leaf[column, row]
        return jnp.moveaxis(leaf, 1, 0).reshape(samples, row.size, -1)

    by_A, by_G = symmetric(by_A), symmetric(by_G)

    def last(leaf):
        return by_A @ jnp.moveaxis(leaf[:, :, -1], 2, 0).reshape(samples, n * n, -1)

    def coefficients(leaf):
        return [symmetric(jnp.moveaxis(leaf[:, :, :-1], 2, 3)), last(leaf)]

    def stacked(columns):
        return jnp.moveaxis(columns, 0, 1).reshape(samples, -1, columns.shape[-1])

    noise = Partials.of(d_G.A @ stages.X[-1], n)
    d_noise = noise.p + d_G.B
    if d_u is not None and d_G.B_u is not None:
        d_noise = d_noise + d_G.B_u @ d_u[-1]
    chain = Partials.of(stacked(stages.X), n)
    linear = jnp.concatenate([*coefficients(forms.A), by_G], axis=-1)
    C_x = linear @ jnp.concatenate([chain.x, noise.x], axis=1)
    C_p = linear @ jnp.concatenate([chain.p, d_noise], axis=1)
    elements = symmetric(jnp.sum(forms.B[:, :, :-1], axis=2)) + last(forms.B)
    C_p = C_p + model.equations.columns(elements, model.leaves)
    if d_u is not None:
        C_p = C_p + jnp.concatenate(coefficients(forms.B_u), axis=-1) @ stacked(d_u)
    return Partials(C_x[:, position], C_p[:, position]), Q


def _positions(n: int) -> np.ndarray:
    """Return the positions of the elements of a symmetric matrix in its upper triangle."""
    position = np.zeros((n, n), int)
    position[np.triu_indices(n)] = np.arange(n * (n + 1) // 2)
    return np.maximum(position, position.T)


def _noise(model: PredictionModel, stages: Stages, h):
    """Return the derivatives of `G`; the linear functions that turn the derivatives of `A` and `G`
    at the middle stage into half of those of the covariance; and `Qd`.
    """
    t, x, u, A, M, W = (part[-1] for part in stages[:6])
    values, linear = model.diffusion.linearise(model.leaves, t, x, u)
    samples, n = A.shape[:2]
    G = values.reshape(samples, 1, n, -1)
    powers = [jnp.broadcast_to(jnp.eye(n), A.shape)]
    for j in range(1, SERIES_TERMS):
        powers.append(h / j * (A @ powers[-1]))
    powers = jnp.stack(powers, axis=1)  # (h A)^j / j!
    L = powers @ G
    N = h[..., None] * jnp.tensordot(L, SERIES_WEIGHTS, [1, 1])
    N = jnp.moveaxis(N, -1, 1)
    right = jnp.einsum("ikj,tkar,tjbr->tiab", PRODUCTS, L, h[..., None] * N)
    left = jnp.concatenate([powers[:, :-1], M[:, None]], axis=1)
    right = jnp.concatenate([right, W[:, None]], axis=1)
    by_A = jnp.einsum("tiak,tijb->abtkj", left, right)
    by_G = jnp.einsum("tjai,tjbr->abtir", powers, N)
    Q = jnp.einsum("tjar,tjbr->tab", L, N)
    return model.diffusion.apply(linear), by_A, by_G, Q


def _products() -> np.ndarray:
    """Return the factors `k! i!/j!` of `a^i/i! dA L_k` in `dL_j`, shape (i, k, j)."""
    factors = np.zeros((SERIES_TERMS - 1, SERIES_TERMS, SERIES_TERMS))
    for j in range(1, SERIES_TERMS):
        for i in range(j):
            factors[i, j - 1 - i, j] = factorial(j - 1 - i) * factorial(i) / factorial(j)
    return factors


PRODUCTS = _products()


def _times(tensor: Float[Array, "sample a b row"], columns: Float[Array, "sample row column"]):
    """Return the product over the last axis of a tensor."""
    flat = tensor.reshape(tensor.shape[0], -1, tensor.shape[-1])
    return (flat @ columns).reshape(*tensor.shape[:3], columns.shape[-1])
