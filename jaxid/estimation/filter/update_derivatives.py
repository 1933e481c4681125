r"""Derivatives of a filter's update at the measurements, for many samples at once.

With `B = L L'`, `V = L^-1 H`, `U = P V'`, `K = U L^-1`, `w = L^-1 v`, `q = U w`, `N = I - K H` and
the covariance `P+ = N P` after the measurement,

    L^-1 dy = V dx + L^-1 y_p
    L^-1 dB L^-T = V dP V' + D + D' + L^-1 dR L^-T,    D = L^-1 dH U
    dx+ = N (dx + dP V' w) - K y_p + P+ dH' L^-T w - K dH q - K dR L^-T w
    dP+ = N dP N' - (K dH P+ + P+ dH' K') + K dR K'

The derivative of `P` has no derivative of the gain, because the optimal gain makes `P` stationary
in Joseph's form (A.31 differentiates the gain too; the result is the same). The last two lines are
one symmetric form `F + F'`, `F = [-K; w' L^-1] dH [P+ q]`; its last column belongs to x.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..._foundation.types import Array, Float
from ...models.free_model import FreeModel, Leaves
from ...sensitivity.jacobians import Differentiation
from .filter_run import Measured
from .innovation_rows import white_rows
from .kalman import inverse_cholesky
from .prediction_derivatives import Partials


class Update(NamedTuple):
    """Linear functions at a measurement.

    Attributes:
        V: `L^-1 H`.
        N: `I - K H`, with a last row `w' V`.
        rows: derivatives of the rows of the information at constant P, from `white_rows`.
        moments: derivatives of the covariance after the measurement, at constant P, with those of
            the state as last row and column.
    """

    V: Float[Array, "sample output state"]
    N: Float[Array, "sample row state"]
    rows: Partials
    moments: Partials


def output_derivatives(family: FreeModel, leaves: Leaves, at, acting) -> Differentiation:
    """Return how the outputs are differentiated; `at` are time, state and input of any point."""

    def outputs(t, x, u, leaves):
        return family.build(leaves)[0].output(t, x, u)

    return Differentiation.of(family, outputs, at, leaves, by_input=bool(acting))


def differentiate_update(
    outputs: Differentiation,
    leaves: Leaves,
    acting: tuple[int, ...],
    now: Measured,
    d_inputs: Float[Array, "sample input element"],
    dR: Float[Array, "output parameter"],
) -> Update:
    """Return the derivatives of the update at each sample.

    Args:
        outputs: from `output_derivatives`.
        leaves: the leaves that hold free parameters.
        acting: indices of the leaves that act on the input.
        now: the filter at the samples.
        d_inputs: derivatives of the inputs by the elements of these leaves.
        dR: derivatives of the variances of the sensors.
    """
    H, y_p, d_u = measured_jacobians(outputs, leaves, acting, now, d_inputs)
    inverse = inverse_cholesky(now.B)
    V = inverse @ H
    w = jnp.einsum("tij,tj->ti", inverse, now.v)
    U = now.P @ jnp.swapaxes(V, 1, 2)
    K = U @ inverse
    weighted = jnp.einsum("ti,tij->tj", w, inverse)[:, None]
    N = jnp.concatenate([jnp.eye(H.shape[-1])[None] - K @ H, weighted @ H], axis=1)
    rows = jnp.concatenate([-K, weighted], axis=1)
    q = jnp.einsum("tji,ti->tj", U, w)[..., None]
    after = jnp.concatenate([now.P_after, q], axis=2)
    mask = now.mask[:, None]
    forms = ((rows * mask, after), (inverse * mask, U))
    moments, B = _symmetric_forms(outputs, leaves, (now.t, now.x, now.u), d_u, forms)
    dR = jnp.where(now.mask[:, :, None], dR[None], 0.0)
    constant = moments.p.at[:, :-1, -1].add(-(K @ y_p)) + noise_forms(rows, dR)
    moments = Partials(moments.x, constant)
    rows = Partials(white_rows(V, B.x), white_rows(inverse @ y_p, B.p + noise_forms(inverse, dR)))
    return Update(V, N, rows, moments)


def measured_jacobians(
    outputs: Differentiation,
    leaves: Leaves,
    acting: tuple[int, ...],
    now: Measured,
    d_inputs: Float[Array, "sample input element"],
):
    """Return the derivatives of the outputs by the state and by the parameters, zero at missing
    samples; and of the inputs by the parameters, None if none acts on them.

    Args: as in `differentiate_update`.
    """
    H, B_u, y_p = outputs.apply(outputs.linearise(leaves, now.t, now.x, now.u)[1])
    d_u = None
    if B_u is not None:
        d_u = outputs.family.select(d_inputs, acting)
        y_p = y_p + B_u @ d_u
    valid = now.mask[:, :, None]
    return jnp.where(valid, H, 0.0), jnp.where(valid, y_p, 0.0), d_u


def noise_forms(
    rows: Float[Array, "sample row output"], dR: Float[Array, "sample output parameter"]
) -> Float[Array, "sample row row parameter"]:
    """Return `rows dR rows'` for each parameter."""
    products = rows[:, :, None] * rows[:, None]
    return products @ dR[:, None]


def _symmetric_forms(outputs: Differentiation, leaves: Leaves, points, d_u, factors):
    """Return the derivatives of `F + F'`, `F = rows dH directions`, for several pairs of factors.

    All are filled with zeros to one size, so that the outputs are differentiated once.
    """
    size = max(rows.shape[1] for rows, _ in factors)
    count = points[0].shape[0]

    def filled(leaf, axis):
        padding = [(0, 0)] * 3
        padding[axis] = (0, size - leaf.shape[axis])
        return jnp.moveaxis(jnp.pad(leaf, padding), axis, 0)

    rows = jnp.concatenate([filled(rows, 1) for rows, _ in factors], axis=1)
    directions = jnp.concatenate([filled(part, 2) for _, part in factors], axis=1)
    at = jax.tree.map(lambda leaf: jnp.concatenate([leaf] * len(factors)), points)
    A, B_u, B = outputs.derivatives_of_forms(leaves, at, rows, directions)
    made = []
    for index, (own, _) in enumerate(factors):
        part, k = slice(index * count, (index + 1) * count), own.shape[1]

        def symmetric(leaf, part=part, k=k):
            form = leaf[:k, :k, part]
            return jnp.moveaxis(form + jnp.swapaxes(form, 0, 1), 2, 0)

        by_parameter = outputs.columns(symmetric(B), leaves)
        if d_u is not None:
            by_parameter = by_parameter + jnp.einsum("tabu,tup->tabp", symmetric(B_u), d_u)
        made.append(Partials(symmetric(A), by_parameter))
    return made
