"""White noise through the forming filters of the Dryden gusts, discretised exactly at any sample
times.

Each filter is a stationary Gauss-Markov process `dx = A x dt + B dW` with covariance P, and over a
step h

    x(t+h) = F x(t) + e,    F = expm(A h),    cov(e) = P - F P F'

which starts from N(0, P), so that the covariance is P at every sample, whatever the step.
"""

import math

import jax
import jax.numpy as jnp

from ..._foundation.types import Array, Float

ROOT3 = 3.0**0.5
# Series of (e^x - 1)/x, of (e^x - 1 - x)/x^2 and of the derivative of the first, which are the
# divided differences at near poles.
ONCE = tuple(1.0 / math.factorial(k + 1) for k in range(14))
TWICE = tuple(1.0 / math.factorial(k + 2) for k in range(14))
TWICE_TURNED = tuple((k + 1.0) / math.factorial(k + 2) for k in range(14))
# A pivot below this part of the covariance is rounding: in so short a step its direction has no
# noise. Chosen: about 45 times the rounding of double precision.
ROUNDING_PIVOT = 1e-14


def first_order(
    noise: Float[Array, " time"], step: Float[Array, " interval"], pole: Float[Array, ""]
) -> Float[Array, " time"]:
    """A signal of unit variance with correlation `exp(-pole |tau|)`, at sample times.

    Args:
        noise: independent standard normal numbers, one for each sample.
        step: times between the samples, zero where time stands still [s].
        pole: [rad/s].

    Returns:
        The signal, shape (time,).
    """
    keep = jnp.exp(-pole * step)
    left = -jnp.expm1(-2.0 * pole * step)
    # The square root has no derivative at zero.
    spread = jnp.where(left > 0, jnp.sqrt(jnp.where(left > 0, left, 1.0)), 0.0)

    def advance(x, now):
        f, e = now
        return f * x + e, f * x + e

    _, x = jax.lax.scan(advance, noise[0], (keep, spread * noise[1:]))
    return jnp.concatenate([noise[:1], x])


def second_order(
    noise: Float[Array, "time 3"],
    step: Float[Array, " interval"],
    pole: Float[Array, ""],
    rate_pole: Float[Array, ""],
) -> tuple[Float[Array, " time"], Float[Array, " time"]]:
    r"""A transverse Dryden gust of unit variance and its lagged derivative, at sample times.

        v = (1 + sqrt(3) s/a)/(1 + s/a)^2 n/sqrt(a),    r = s/(1 + s/c) v

    with n white noise of unit strength, `a = V/L`.

    Args:
        noise: independent standard normal numbers, shape (time, 3).
        step: times between the samples, zero where time stands still [s].
        pole: a [rad/s].
        rate_pole: c [rad/s].

    Returns:
        v, shape (time,), and r, shape (time,) [1/s].
    """
    P = covariance(pole, rate_pole)
    F = jax.vmap(transition, (0, None, None))(step, pole, rate_pole)
    e = jnp.einsum("tij,tj->ti", factor(P[None] - F @ P @ F.transpose(0, 2, 1)), noise[1:])

    def advance(x, now):
        f, e = now
        x = f @ x + e
        return x, x

    first = factor(P) @ noise[0]
    _, rest = jax.lax.scan(advance, first, (F, e))
    x = jnp.concatenate([first[None], rest])
    v = ROOT3 * x[:, 0] + (1.0 - ROOT3) * x[:, 1]
    return v, rate_pole * (v - x[:, 2])


def covariance(a: Float[Array, ""], c: Float[Array, ""]) -> Float[Array, "3 3"]:
    """Return the covariance P of the states of `second_order`: `x1 = n sqrt(a)/(s + a)`, `x2 = a
    x1/(s + a)`, `f = c v/(s + c)`.

    It is the closed-form solution of `A P + P A' + B B' = 0`.
    """
    P1f = c * (1.0 + ROOT3) / (4.0 * (a + c))
    P2f = (a * P1f + c / 4.0) / (a + c)
    Pff = ROOT3 * P1f + (1.0 - ROOT3) * P2f
    half, quarter = jnp.full_like(P1f, 0.5), jnp.full_like(P1f, 0.25)
    return jnp.stack([half, quarter, P1f, quarter, quarter, P2f, P1f, P2f, Pff]).reshape(3, 3)


def transition(
    h: Float[Array, ""], a: Float[Array, ""], c: Float[Array, ""]
) -> Float[Array, "3 3"]:
    """Return `expm(A h)` of the states of `second_order`, by divided differences of the exponential
    over the poles a, a, c.

    Divided differences stay accurate at nearly equal poles, which occur in low flight (a = c at
    `L = 4b/pi`).
    """
    slow, x = jnp.exp(-jnp.minimum(a, c) * h), jnp.abs(c - a) * h
    # The closed forms lose less than a digit above 0.5; below, the series err by less than 1e-17.
    far = x > 0.5
    y, near = jnp.where(far, x, 1.0), jnp.where(far, 0.0, x)
    once = jnp.where(far, -jnp.expm1(-y) / y, _series(ONCE, -near))
    after = jnp.where(far, (y - 1.0 + jnp.exp(-y)) / y**2, _series(TWICE, -near))
    before = jnp.where(far, (1.0 - (1.0 + y) * jnp.exp(-y)) / y**2, _series(TWICE_TURNED, -near))
    d_ac, d_aac = h * slow * once, h**2 * slow * jnp.where(c >= a, after, before)
    zero, keep = jnp.zeros_like(slow), jnp.exp(-a * h)
    last = [
        c * (ROOT3 * d_ac + (1.0 - ROOT3) * a * d_aac),
        (1.0 - ROOT3) * c * d_ac,
        jnp.exp(-c * h),
    ]
    return jnp.stack([keep, zero, zero, a * h * keep, keep, zero, *last]).reshape(3, 3)


def _series(coefficients: tuple[float, ...], x: Float[Array, ""]) -> Float[Array, ""]:
    """Return the value of a power series, by Horner's rule."""
    value = jnp.zeros_like(x)
    for coefficient in reversed(coefficients):
        value = value * x + coefficient
    return value


def factor(Q: Float[Array, "*step 3 3"]) -> Float[Array, "*step 3 3"]:
    """Return the lower triangular root of covariances of order one, zero in directions in which the
    covariance is below rounding.

    In the third direction the variance is proportional to the fifth power of the step. In a short
    step it is below the rounding of Q, and the usual Cholesky factorisation gives NaN.
    """
    columns, rest = [], Q
    for k in range(3):
        pivot = rest[..., k, k]
        there = pivot > ROUNDING_PIVOT
        root = jnp.where(there, jnp.sqrt(jnp.where(there, pivot, 1.0)), 1.0)
        below = jnp.arange(3) >= k
        column = jnp.where(
            there[..., None] & below.reshape((1,) * there.ndim + (3,)),
            rest[..., k] / root[..., None],
            0.0,
        )
        columns.append(column)
        rest = rest - column[..., :, None] * column[..., None, :]
    return jnp.stack(columns, axis=-1)
