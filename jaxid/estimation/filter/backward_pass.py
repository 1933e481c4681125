r"""Backward pass of the smoother through the filter of one record.

States by the adjoint `l` of the filter (Bryson & Frazier, 1963), which inverts no covariance, so
that the states are smooth functions of the parameters also where one is singular:

    x_s(i) = x(i|i) + P(i|i) Phi_i' l_(i+1),    l_i = H' B^-1 v_i + (I - K H)' Phi_i' l_(i+1)

Covariances with triangular factors, `P = F F'` (Rauch, Tung & Striebel, AIAA Journal 3, 1965):

    C_i = P(i|i) Phi_i' P(i+1|i)^-1
    P_s(i) = (I - C_i Phi_i) P(i|i) (I - C_i Phi_i)' + C_i (Q_i + P_s(i+1)) C_i'

a sum of squares, so that its factor is the triangle of the stacked factors, and no variance becomes
negative. A singular `P(i+1|i)` is inverted on its range.
"""

import jax
import jax.numpy as jnp

from ..._foundation.types import Array, Float
from .kalman import Filtered


def smooth_filtered(
    filtered: Filtered,
) -> tuple[Float[Array, "time state"], Float[Array, "time state state"]]:
    """Return smoothed states and the factors of their covariances for one record."""

    return _smoothed_states(filtered), _factors(filtered)


def _smoothed_states(filtered: Filtered) -> Float[Array, "time state"]:
    def back(adjoint, now):
        x, P, Phi, score, remaining = now
        carried = Phi.T @ adjoint
        return score + remaining.T @ carried, x + P @ carried

    samples = (filtered.x, filtered.P, filtered.Phi, filtered.score, filtered.remaining)
    return jax.lax.scan(back, jnp.zeros_like(filtered.x[0]), samples, reverse=True)[1]


def _factors(filtered: Filtered) -> Float[Array, "time state state"]:
    def back(F_later, now):
        P, Phi, Q, P_next = now
        gain = P @ Phi.T @ _pseudoinverse(P_next)
        parts = [
            (jnp.eye(P.shape[0]) - gain @ Phi) @ square_factor(P),
            gain @ square_factor(Q),
            gain @ F_later,
        ]
        triangle = jnp.linalg.qr(jnp.concatenate(parts, axis=1).T, mode="r").T
        return triangle, triangle

    before = (filtered.P[:-1], filtered.Phi[:-1], filtered.Q[:-1], filtered.P_predicted[1:])
    last = square_factor(filtered.P[-1])
    _, F = jax.lax.scan(back, last, before, reverse=True)
    return jnp.concatenate([F, last[None]])


def square_factor(P):
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
