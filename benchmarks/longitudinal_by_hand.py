"""Longitudinal aircraft with all equations and derivatives written by hand, to check autodiff.

The aerodynamic model is that of the default flight,

    CX = CX0 + CX2 alpha^2,   CZ = CZ0 + CZa alpha + CZq qhat + CZe elevator,
    Cm = Cm0 + Cma alpha + Cmq qhat + Cme elevator,

and theta holds these ten coefficients and the four initial states. The sensitivities follow Eq. 4.6
to 4.9,

    d/dt (dx/dtheta) = f_x dx/dtheta + f_theta,    dy/dtheta = h_x dx/dtheta + h_theta,

from the derivative of the initial state (A.31), which is one in its own column and zero elsewhere.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

NAMES = (
    *("CX.1", "CX.alpha^2"),
    *("CZ.1", "CZ.alpha", "CZ.qhat", "CZ.elevator"),
    *("Cm.1", "Cm.alpha", "Cm.qhat", "Cm.elevator"),
    *("initial_state.u", "initial_state.w", "initial_state.q", "initial_state.pitch"),
)
GRAVITY = 9.80665  # m/s^2


class Constants(NamedTuple):
    """Known constants of the aircraft, in SI units."""

    mass: Any
    Iy: Any
    S: Any
    cbar: Any
    thrust: Any
    density: Any


class Flow(NamedTuple):
    """Quantities that determine forces and moment at an instant."""

    V: Any
    alpha: Any
    qhat: Any
    force: Any  # qbar S/m
    moment: Any  # qbar S cbar/Iy
    CX: Any
    CZ: Any
    Cm: Any


def flow(xp, c: Constants, theta, x, elevator) -> Flow:
    """Return the coefficients and the quantities they depend on.

    `xp` is numpy or jax.numpy; columns of `theta` and `x` are cases.
    """
    u, w, q, _ = x
    V = xp.sqrt(u * u + w * w)
    alpha, qhat = xp.arctan2(w, u), q * c.cbar / (2.0 * V)
    force = 0.5 * c.density * V * V * c.S / c.mass
    CX = theta[0] + theta[1] * alpha * alpha
    CZ = theta[2] + theta[3] * alpha + theta[4] * qhat + theta[5] * elevator
    Cm = theta[6] + theta[7] * alpha + theta[8] * qhat + theta[9] * elevator
    return Flow(V, alpha, qhat, force, force * c.mass * c.cbar / c.Iy, CX, CZ, Cm)


def rates(xp, c: Constants, theta, x, elevator):
    """Return the derivative of the state (App. D.1)."""
    u, w, q, pitch = x
    now = flow(xp, c, theta, x, elevator)
    udot = -q * w + now.force * now.CX + c.thrust / c.mass - GRAVITY * xp.sin(pitch)
    wdot = q * u + now.force * now.CZ + GRAVITY * xp.cos(pitch)
    return xp.stack([udot, wdot, now.moment * now.Cm, q])


def outputs(xp, c: Constants, theta, x, elevator):
    """Return alpha, q, pitch, ax, az, V."""
    now = flow(xp, c, theta, x, elevator)
    ax, az = now.force * now.CX + c.thrust / c.mass, now.force * now.CZ
    return xp.stack([now.alpha, x[2], x[3], ax, az, now.V])


class Partials(NamedTuple):
    """Gradients in (u, w, q) of the parts of the equations, and regressors of the coefficients."""

    alpha: Any
    V: Any
    X: Any  # of force * CX
    Z: Any  # of force * CZ
    M: Any  # of moment * Cm
    of_x_terms: Any  # force * (1, alpha^2)
    of_z_terms: Any  # force * (1, alpha, qhat, elevator)
    of_m_terms: Any


def partials(c: Constants, theta, x, elevator) -> Partials:
    """All partial derivatives at an instant."""
    u, w = x[0], x[1]
    now = flow(jnp, c, theta, x, elevator)
    zero, one = jnp.zeros(()), jnp.ones(())
    square = now.V * now.V
    of_alpha = jnp.stack([-w / square, u / square, zero])
    of_qhat = jnp.stack([-now.qhat * u / square, -now.qhat * w / square, c.cbar / (2.0 * now.V)])
    of_force = jnp.stack([c.density * c.S / c.mass * u, c.density * c.S / c.mass * w, zero])
    of_moment = of_force * (c.mass * c.cbar / c.Iy)
    line = jnp.stack([one, now.alpha, now.qhat, elevator])
    return Partials(
        alpha=of_alpha,
        V=jnp.stack([u / now.V, w / now.V, zero]),
        X=of_force * now.CX + now.force * 2.0 * theta[1] * now.alpha * of_alpha,
        Z=of_force * now.CZ + now.force * (theta[3] * of_alpha + theta[4] * of_qhat),
        M=of_moment * now.Cm + now.moment * (theta[7] * of_alpha + theta[8] * of_qhat),
        of_x_terms=now.force * jnp.stack([one, now.alpha * now.alpha]),
        of_z_terms=now.force * line,
        of_m_terms=now.moment * line,
    )


def sensitivity_rates(c: Constants, theta, x, dx_dtheta, elevator):
    """`f_x dx/dtheta + f_theta` (Eq. 4.6)."""
    u, w, q, pitch = x
    of = partials(c, theta, x, elevator)
    along = dx_dtheta[:3]
    du, dw, dq, dpitch = dx_dtheta
    udot = -q * dw - w * dq - GRAVITY * jnp.cos(pitch) * dpitch + of.X @ along
    wdot = q * du + u * dq - GRAVITY * jnp.sin(pitch) * dpitch + of.Z @ along
    qdot = of.M @ along
    return jnp.stack(
        [
            udot.at[0:2].add(of.of_x_terms),
            wdot.at[2:6].add(of.of_z_terms),
            qdot.at[6:10].add(of.of_m_terms),
            dq,
        ]
    )


def output_sensitivity(c: Constants, theta, x, dx_dtheta, elevator):
    """`h_x dx/dtheta + h_theta`."""
    of = partials(c, theta, x, elevator)
    along = dx_dtheta[:3]
    ax, az = (of.X @ along).at[0:2].add(of.of_x_terms), (of.Z @ along).at[2:6].add(of.of_z_terms)
    return jnp.stack([of.alpha @ along, dx_dtheta[2], dx_dtheta[3], ax, az, of.V @ along])


def sensitivities(c: Constants, t, elevator, theta):
    """Outputs and their sensitivities: states and `dx/dtheta` integrated together by the classical
    Runge-Kutta method.

    Args:
        c: known constants.
        t: sample times, shape (time,) [s].
        elevator: elevator at the samples, linear between them, shape (time,) [rad].
        theta: coefficients and initial state, shape (14,), in the order of `NAMES`.

    Returns:
        `y` of shape (time, 6) and `S` of shape (time, 6, 14).
    """

    def both(state, de):
        return rates(jnp, c, theta, state[0], de), sensitivity_rates(c, theta, *state, de)

    def ahead(state, length, slope):
        return state[0] + length * slope[0], state[1] + length * slope[1]

    def step(state, now):
        h, before, after = now
        middle = 0.5 * (before + after)
        k1 = both(state, before)
        k2 = both(ahead(state, h / 2, k1), middle)
        k3 = both(ahead(state, h / 2, k2), middle)
        k4 = both(ahead(state, h, k3), after)
        slope = jax.tree.map(lambda a, b, c, d: (a + 2 * b + 2 * c + d) / 6, k1, k2, k3, k4)
        state = ahead(state, h, slope)
        return state, state

    start = theta[10:], jnp.concatenate([jnp.zeros((4, 10)), jnp.eye(4)], axis=1)
    _, later = jax.lax.scan(step, start, (jnp.diff(t), elevator[:-1], elevator[1:]))
    x, dx = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), start, later)
    y = jax.vmap(lambda x, de: outputs(jnp, c, theta, x, de))(x, elevator)
    return y, jax.vmap(lambda x, dx, de: output_sensitivity(c, theta, x, dx, de))(x, dx, elevator)


def simulate_numpy(c: Constants, t, elevator, theta):
    """Outputs by NumPy, for many vectors of parameters at once.

    Args:
        theta: shape (14, case).

    Returns:
        Outputs of shape (time, 6, case).
    """
    x, y = theta[10:], [outputs(np, c, theta, theta[10:], elevator[0])]
    for h, before, after in zip(np.diff(t), elevator[:-1], elevator[1:], strict=True):
        middle = 0.5 * (before + after)
        k1 = rates(np, c, theta, x, before)
        k2 = rates(np, c, theta, x + h / 2 * k1, middle)
        k3 = rates(np, c, theta, x + h / 2 * k2, middle)
        k4 = rates(np, c, theta, x + h * k3, after)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        y.append(outputs(np, c, theta, x, after))
    return np.stack(y)


def finite_differences(c: Constants, t, elevator, theta, sizes):
    """Outputs and central differences by NumPy, all perturbed cases side by side.

    Args:
        sizes: typical size of each parameter, to which the step is proportional, shape (14,).

    Returns:
        `y` of shape (time, 6) and `S` of shape (time, 6, 14).
    """
    # above the textbook's eps^(1/3): some outputs hardly feel some parameters, and rounding shows
    steps = 1e-4 * sizes
    apart = np.diag(steps)
    cases = np.concatenate([theta[:, None] + apart, theta[:, None] - apart, theta[:, None]], axis=1)
    y = simulate_numpy(c, t, elevator, cases)
    count = theta.size
    return y[..., -1], (y[..., :count] - y[..., count : 2 * count]) / (2.0 * steps)
