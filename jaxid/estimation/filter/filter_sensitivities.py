r"""Derivatives of the innovations of a filter and of their covariances with respect to parameters.

The filter runs once. Along its states the equations are differentiated in parallel, in blocks of
samples, in the directions of the parameters and of the state:

    dy = y_p + H dx,    dH = H_p + H_x dx,    dPhi = Phi_p + Phi_x dx,    dQ = Q_p + Q_x dx

After that the derivatives follow a linear recursion of matrices, in which the model has no part:

    dB = d(H P H') + dR,    dx <- dx + d(P H') w - K dB w - K dy,    w = B^-1 v
    dP <- N dP N' - (K dH P N' + N P dH' K') + K dR K',    N = I - K H
    dx <- Phi dx + x_p,    dP <- Phi dP Phi' + dPhi P Phi' + Phi P dPhi' + dQ

The derivative of the gain does not enter that of `P`, because the optimal gain makes `P` stationary
in Joseph's form (A.31 differentiates the gain too; the result is the same).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..._foundation.types import Array, Bool, Float
from ...data.record import Record
from ...models.free_model import FreeModel
from ...models.stochastic import StochasticModel
from ...sensitivity.jacobian import value_and_jacobian
from ...simulation.hold import AbstractHold
from .kalman import (
    Filtered,
    Sample,
    Steps,
    filter_signals,
    initial_moments,
    inverse_cholesky,
    kalman_filter,
    predicted,
)

SAMPLES_TOGETHER = 32  # samples differentiated at once; chosen: some megabytes for 40 parameters


class FilterSensitivities(NamedTuple):
    """Result of a filter, with derivatives by the parameters.

    Attributes:
        filtered: the filter's states and innovations.
        innovation: derivatives of the innovations.
        covariance: derivatives of their covariances.
    """

    filtered: Filtered
    innovation: Float[Array, "time output parameter"]
    covariance: Float[Array, "time output output parameter"]


class Moments(NamedTuple):
    """Values of the equations at one sample and over the step after it.

    The last axis of their derivatives counts directions: first the parameters, then the states.
    """

    y: Float[Array, "..."]
    H: Float[Array, "..."]
    x: Float[Array, "..."]
    Phi: Float[Array, "..."]
    Q: Float[Array, "..."]


class Nominal(NamedTuple):
    """Values of the filter at a sample, before (`P`) and after (`P_after`) its measurement."""

    v: Float[Array, " output"]
    B: Float[Array, "output output"]
    P: Float[Array, "state state"]
    P_after: Float[Array, "state state"]
    mask: Bool[Array, " output"]


def filter_sensitivities(
    family: FreeModel,
    theta: Float[Array, " parameter"],
    record: Record,
    hold: AbstractHold,
    substeps: int,
    *,
    steady: bool,
) -> FilterSensitivities:
    """Return the derivatives for one record; the arguments are those of `kalman_filter`.

    Args:
        family: the model and the initial state as functions of the parameters.
        theta: values of the parameters.
        record, hold, substeps, steady: as in `kalman_filter`.
    """

    def built(theta) -> tuple[StochasticModel, Float[Array, " state"]]:
        model, x0 = family(theta)
        assert isinstance(model, StochasticModel), "a model from `prepared`"
        return model, x0

    model, x0 = built(theta)
    filtered = kalman_filter(model, record, x0, hold, substeps, steady=steady)

    def begin(theta):
        model, x0 = built(theta)
        return jnp.concatenate(
            [
                part.reshape(-1)
                for part in initial_moments(model, record, x0, hold, substeps, steady)
            ]
        )

    n, p = x0.size, theta.size
    start = value_and_jacobian(begin, theta)[1]
    dR = value_and_jacobian(lambda theta: built(theta)[0].sensor_deviations() ** 2, theta)[1]

    def inputs(theta):
        samples, steps = filter_signals(built(theta)[0], record, hold, substeps)
        return samples.u, steps.u

    samples, steps = filter_signals(model, record, hold, substeps)
    tangents = jax.vmap(lambda e: jax.jvp(inputs, (theta,), (e,))[1], out_axes=1)(jnp.eye(p))
    nominal = Nominal(filtered.v, filtered.B, filtered.P_predicted, filtered.P, record.mask)
    states = (filtered.x_predicted, filtered.x)

    def block(carry, now):
        at, tangents, states, nominal = now
        value, derivative = _moments(family, theta, at, tangents, states)
        return jax.lax.scan(
            lambda carry, now: _sample(carry, *now, dR), carry, (nominal, value, derivative)
        )

    rows = jax.tree.map(_in_blocks, ((samples, steps), tangents, states, nominal))
    begin_at = (start[:n], start[n:].reshape(n, n, p))
    _, (dv, dB) = jax.lax.scan(block, begin_at, rows)
    count = record.t.size
    dv, dB = (part.reshape(-1, *part.shape[2:])[:count] for part in (dv, dB))
    return FilterSensitivities(filtered, dv, dB)


def _in_blocks(leaf: Array) -> Array:
    """Return an array over time in blocks, the last one filled with the last sample."""
    fill = -leaf.shape[0] % SAMPLES_TOGETHER
    padded = jnp.concatenate([leaf, jnp.repeat(leaf[-1:], fill, axis=0)])
    return padded.reshape(-1, SAMPLES_TOGETHER, *leaf.shape[1:])


def _moments(
    family: FreeModel,
    theta: Float[Array, " parameter"],
    at: tuple[Sample, Steps],
    tangents: tuple[Float[Array, "time parameter input"], Float[Array, "time parameter ..."]],
    states: tuple[Float[Array, "time state"], Float[Array, "time state"]],
) -> tuple[Moments, Moments]:
    """Return the moments of a block of samples, and their derivatives.

    Args:
        family, theta: as in `filter_sensitivities`.
        at: signals of the block.
        tangents: derivatives of the inputs at the samples and in the steps.
        states: states before and after each measurement.
    """
    n, p = states[0].shape[-1], theta.size

    def moments(theta, sample_inputs, step_inputs, before, after):
        model, _ = family(theta)
        assert isinstance(model, StochasticModel), "a model from `prepared`"
        samples, steps = at[0]._replace(u=sample_inputs), at[1]._replace(u=step_inputs)

        def one(sample, steps, before, after):
            t, u, _, mask = sample
            y, H = value_and_jacobian(lambda x: model.output(t, x, u), before)
            return Moments(y, jnp.where(mask[:, None], H, 0.0), *predicted(model, after, steps))

        return jax.vmap(one)(samples, steps, before, after)

    still = jnp.zeros((n, p))
    by_theta, by_state = (
        jnp.concatenate([jnp.eye(p), still]),
        jnp.concatenate([still.T, jnp.eye(n)]),
    )
    by_sample, by_step = (_with_states(jnp.moveaxis(tangent, 1, 0), n) for tangent in tangents)

    def push(dtheta, dsample, dstep, dx):
        dx = jnp.broadcast_to(dx, states[0].shape)
        point = (theta, at[0].u, at[1].u, *states)
        return jax.jvp(moments, point, (dtheta, dsample, dstep, dx, dx))

    return jax.vmap(push, out_axes=(None, -1))(by_theta, by_sample, by_step, by_state)


def _with_states(tangent: Array, n: int) -> Array:
    """Return derivatives of a signal with those by the n states, which are zero."""
    return jnp.concatenate([tangent, jnp.zeros((n, *tangent.shape[1:]))])


def _sample(carry, nominal: Nominal, value: Moments, derivative: Moments, dR):
    """Return the derivatives after a sample and a step, and those of the innovation."""
    dx, dP = carry
    p = dx.shape[-1]
    (v, B, P, P_after, mask), (_, H, _, Phi, _) = nominal, value
    by_parameter = jax.tree.map(lambda leaf: leaf[..., :p], derivative)
    by_state = jax.tree.map(lambda leaf: leaf[..., p:], derivative)
    dR = jnp.where(mask[:, None], dR, 0.0)
    inverse = inverse_cholesky(B)
    weight = inverse.T @ inverse
    w, PH = weight @ v, P @ H.T
    K = PH @ weight
    N = jnp.eye(H.shape[1]) - K @ H
    dy = by_parameter.y + H @ dx
    dH = by_parameter.H + by_state.H @ dx
    dPH = _right(dP, H.T) + _left(P, jnp.swapaxes(dH, 0, 1))
    at = jnp.arange(mask.size)
    dB = (_left(H, dPH) + _right(dH, PH)).at[at, at].add(dR)
    dv = jnp.where(mask[:, None], -dy, 0.0)
    dx = dx + jnp.einsum("imp,m->ip", dPH, w) - K @ jnp.einsum("mlp,l->mp", dB, w) + K @ dv
    turned = _right(_left(K, dH), P @ N.T)
    noise = jnp.einsum("im,mp,jm->ijp", K, dR, K)
    dP = _left(N, _right(dP, N.T)) - turned - jnp.swapaxes(turned, 0, 1) + noise
    dPhi = by_parameter.Phi + by_state.Phi @ dx
    dQ = by_parameter.Q + by_state.Q @ dx
    moved = _right(dPhi, P_after @ Phi.T)
    dP = _left(Phi, _right(dP, Phi.T)) + moved + jnp.swapaxes(moved, 0, 1) + dQ
    return (Phi @ dx + by_parameter.x, dP), (dv, dB)


def _left(a: Float[Array, "i j"], d: Float[Array, "j k p"]) -> Float[Array, "i k p"]:
    """Return `a d` for each parameter."""
    return (a @ d.reshape(d.shape[0], -1)).reshape(a.shape[0], *d.shape[1:])


def _right(d: Float[Array, "i j p"], b: Float[Array, "j k"]) -> Float[Array, "i k p"]:
    """Return `d b` for each parameter."""
    return jnp.einsum("ijp,jk->ikp", d, b)
