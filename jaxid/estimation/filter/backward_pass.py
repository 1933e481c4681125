r"""Backward pass of the smoother through the filter of one record.

Backwards through the filter of a record (Rauch, Tung & Striebel, AIAA Journal 3, 1965), with
triangular factors of all covariances, `P = F F'`:

    C_i = P(i|i) Phi_i' P(i+1|i)^-1
    x_s(i) = x(i|i) + C_i (x_s(i+1) - x(i+1|i))
    P_s(i) = (I - C_i Phi_i) P(i|i) (I - C_i Phi_i)' + C_i (Q_i + P_s(i+1)) C_i'

The last line is a sum of squares, so that its factor is the triangle of the stacked factors, and no
variance becomes negative. A singular `P(i+1|i)` is inverted on its range.
"""

import jax
import jax.numpy as jnp

from ..._foundation.types import Array, Float
from .kalman import Filtered


def smooth_filtered(
    filtered: Filtered,
) -> tuple[Float[Array, "time state"], Float[Array, "time state state"]]:
    """Return smoothed states and the factors of their covariances for one record."""

    def back(later, now):
        x_later, F_later = later
        x, P, Phi, Q, x_next, P_next = now
        gain = P @ Phi.T @ _pseudoinverse(P_next)
        x_smooth = x + gain @ (x_later - x_next)
        parts = [(jnp.eye(x.size) - gain @ Phi) @ _factor(P), gain @ _factor(Q), gain @ F_later]
        triangle = jnp.linalg.qr(jnp.concatenate(parts, axis=1).T, mode="r").T
        return (x_smooth, triangle), (x_smooth, triangle)

    before = (filtered.x[:-1], filtered.P[:-1], filtered.Phi[:-1], filtered.Q[:-1])
    ahead = (filtered.x_predicted[1:], filtered.P_predicted[1:])
    last = (filtered.x[-1], _factor(filtered.P[-1]))
    _, (x, F) = jax.lax.scan(back, last, (*before, *ahead), reverse=True)
    return jnp.concatenate([x, last[0][None]]), jnp.concatenate([F, last[1][None]])


def _factor(P):
    """Return a square factor `F` with `F F' = P`, for a singular P too."""
    scale = _scale(P)
    values, vectors = jnp.linalg.eigh(P / scale[:, None] / scale[None])
    return scale[:, None] * vectors * jnp.sqrt(jnp.maximum(values, 0.0))[None]


def _pseudoinverse(P):
    scale = _scale(P)
    inverse = jnp.linalg.pinv(P / scale[:, None] / scale[None], hermitian=True)
    return inverse / scale[:, None] / scale[None]


def _scale(P):
    """Return the standard deviations of a covariance, one in place of zero."""
    deviations = jnp.sqrt(jnp.maximum(jnp.diagonal(P), 0.0))
    return jnp.where(deviations > 0.0, deviations, 1.0)
