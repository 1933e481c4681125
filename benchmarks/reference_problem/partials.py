"""Derivatives of the equations of motion, derived by hand, in JAX.

    f_x = df/dx,    f_theta = df/dtheta,    h_x = dh/dx,    h_theta = dh/dtheta

The coefficients depend on the state by alpha, beta and the dimensionless rates. With
`k = C_alpha dalpha/dx + ...` at constant V and the factor V^2 of the dynamic pressure,

    d(qbar C)/dx = qbar (k + 2 C/V dV/dx).
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from benchmarks.reference_problem.equations import (
    CL,
    CM,
    CN,
    COUNT,
    CX,
    CY,
    CZ,
    GRAVITY,
    Air,
    Constants,
    air,
    coefficients,
    regressors,
)

# Columns of each coefficient in theta, as masks of shape (6, 30).
MASKS = np.array([np.isin(np.arange(COUNT), columns) for columns in (CX, CY, CZ, CL, CM, CN)])


class Loads(NamedTuple):
    """Coefficients times the dynamic pressure and the area, with their derivatives.

    Attributes:
        air: motion relative to the air.
        alpha, beta: gradients of the angles by (u, v, w), shape (3,).
        values: qbar S C, shape (6,).
        by_state: by (u, v, w, p, q, r), shape (6, 6).
        by_theta: shape (6, 30).
    """

    air: Air
    alpha: jnp.ndarray
    beta: jnp.ndarray
    values: jnp.ndarray
    by_state: jnp.ndarray
    by_theta: jnp.ndarray


def loads(c: Constants, theta, x, d) -> Loads:
    """Return the loads at a state and controls."""
    u, v, w = x[0], x[1], x[2]
    now = air(jnp, c, x)
    terms = regressors(now, d)
    zero, V2 = jnp.zeros(()), now.V * now.V
    flat = jnp.sqrt(u * u + w * w)
    alpha = jnp.stack([-w, zero, u]) / (flat * flat)
    beta = jnp.stack([-u * v / flat, flat, -w * v / flat]) / V2
    relative = jnp.stack([u, v, w]) / V2  # dV/V
    values = jnp.stack(coefficients(theta, terms))
    by_alpha, by_beta = _slopes(theta, now)
    by_rates = _rate_slopes(theta)
    rates = jnp.stack([now.phat, now.qhat, now.rhat])
    lengths = jnp.stack([jnp.asarray(c.b), jnp.asarray(c.cbar), jnp.asarray(c.b)])
    # the dimensionless rates fall as V grows
    by_speed = 2.0 * values - by_rates @ rates
    by_velocity = (
        jnp.outer(by_alpha, alpha) + jnp.outer(by_beta, beta) + jnp.outer(by_speed, relative)
    )
    by_state = jnp.concatenate([by_velocity, by_rates * lengths[None] / (2.0 * now.V)], axis=1)
    pressure = now.qbar * c.S
    monomials = jnp.stack([jnp.asarray(term, float) for term in terms])
    by_theta = pressure * MASKS * monomials[None]
    return Loads(now, alpha, beta, pressure * values, pressure * by_state, by_theta)


def _slopes(theta, now: Air):
    """Derivatives of the six coefficients by alpha and by beta at constant V."""
    zero = jnp.zeros(())
    a, b = now.alpha, now.beta
    by_alpha = [
        2.0 * theta[2] * a,
        zero,
        theta[7] + 2.0 * theta[8] * a,
        zero,
        theta[18] + 2.0 * theta[19] * a + 3.0 * theta[20] * a * a,
        zero,
    ]
    by_beta = [zero, theta[4], zero, theta[12], zero, theta[24] + 3.0 * theta[25] * b * b]
    return jnp.stack(by_alpha), jnp.stack(by_beta)


def _rate_slopes(theta):
    """Derivatives of the six coefficients by phat, qhat, rhat, shape (6, 3)."""
    zero = jnp.zeros(())
    rows = [
        (zero, zero, zero),
        (zero, zero, zero),
        (zero, theta[9], zero),
        (theta[13], zero, theta[14]),
        (zero, theta[21], zero),
        (theta[26], zero, theta[27]),
    ]
    return jnp.stack([jnp.stack(row) for row in rows])


def rate_partials(c: Constants, theta, x, d):
    """Return f_x, shape (9, 9), and f_theta, shape (9, 30)."""
    of = loads(c, theta, x, d)
    to_rates = _load_to_rates(c)
    by_load = jnp.concatenate([to_rates @ of.by_state, jnp.zeros((6, 3))], axis=1)
    upper = by_load + jnp.concatenate([_kinetic(c, x), _gravity(x)], axis=1)
    f_theta = jnp.concatenate([to_rates @ of.by_theta, jnp.zeros((3, COUNT))])
    return jnp.concatenate([upper, _attitude(x)]), f_theta


def output_partials(c: Constants, theta, x, d):
    """Return h_x, shape (10, 9), and h_theta, shape (10, 30)."""
    of = loads(c, theta, x, d)
    angles = jnp.concatenate([jnp.stack([of.alpha, of.beta]), jnp.zeros((2, 6))], axis=1)
    forces = jnp.concatenate([of.by_state[:3] / c.mass, jnp.zeros((3, 3))], axis=1)
    identity = np.eye(9)
    h_x = jnp.concatenate([angles, identity[3:6], forces, identity[6:8]])
    zeros = np.zeros((5, COUNT))
    return h_x, jnp.concatenate([zeros, of.by_theta[:3] / c.mass, zeros[:2]])


def _load_to_rates(c: Constants) -> np.ndarray:
    """The constant matrix from loads qbar S C to the rates of u, v, w, p, q, r."""
    matrix = np.diag(np.repeat(1.0 / c.mass, 6))
    matrix[3:, 3:] = 0.0
    matrix[3, 3], matrix[3, 5] = c.Iz * c.b / c.determinant, c.Ixz * c.b / c.determinant
    matrix[5, 3], matrix[5, 5] = c.Ixz * c.b / c.determinant, c.Ix * c.b / c.determinant
    matrix[4, 4] = c.cbar / c.Iy
    return matrix


def _kinetic(c: Constants, x):
    """Derivatives of -omega x velocity and of the gyroscopic moments, shape (6, 6)."""
    u, v, w, p, q, r = (x[i] for i in range(6))
    zero = jnp.zeros(())
    velocity = [(zero, r, -q, zero, -w, v), (-r, zero, p, w, zero, -u), (q, -p, zero, -v, u, zero)]
    momentum = [
        (c.Ixz * q, (c.Iy - c.Iz) * r + c.Ixz * p, (c.Iy - c.Iz) * q),
        ((c.Iz - c.Ix) * r - 2.0 * c.Ixz * p, zero, (c.Iz - c.Ix) * p + 2.0 * c.Ixz * r),
        ((c.Ix - c.Iy) * q, (c.Ix - c.Iy) * p - c.Ixz * r, -c.Ixz * q),
    ]
    inverse = np.linalg.inv([[c.Ix, 0.0, -c.Ixz], [0.0, c.Iy, 0.0], [-c.Ixz, 0.0, c.Iz]])
    moments = inverse @ jnp.stack([jnp.stack(row) for row in momentum])
    lower = jnp.concatenate([jnp.zeros((3, 3)), moments], axis=1)
    return jnp.concatenate([jnp.stack([jnp.stack(row) for row in velocity]), lower])


def _gravity(x):
    """Derivatives of gravity by phi, pitch and psi, shape (6, 3)."""
    cp, sp, ct, st = jnp.cos(x[6]), jnp.sin(x[6]), jnp.cos(x[7]), jnp.sin(x[7])
    zero = jnp.zeros(())
    rows = [(zero, -ct, zero), (ct * cp, -st * sp, zero), (-ct * sp, -st * cp, zero)]
    upper = GRAVITY * jnp.stack([jnp.stack(row) for row in rows])
    return jnp.concatenate([upper, jnp.zeros((3, 3))])


def _attitude(x):
    """Derivatives of the rates of the Euler angles, shape (3, 9)."""
    q, r = x[4], x[5]
    cp, sp, ct, st = jnp.cos(x[6]), jnp.sin(x[6]), jnp.cos(x[7]), jnp.sin(x[7])
    zero, one, tan = jnp.zeros(()), jnp.ones(()), st / ct
    psidot, pitchdot = (q * sp + r * cp) / ct, q * cp - r * sp
    rows = [
        (one, sp * tan, cp * tan, pitchdot * tan, psidot / ct, zero),
        (zero, cp, -sp, -psidot * ct, zero, zero),
        (zero, sp / ct, cp / ct, pitchdot / ct, psidot * tan, zero),
    ]
    right = jnp.stack([jnp.stack(row) for row in rows])
    return jnp.concatenate([jnp.zeros((3, 3)), right], axis=1)
