"""Equations of the aircraft for any array library (NumPy, JAX, CasADi), and their simulation.

    udot = r v - q w + qbar S CX/m + T/m - g sin(pitch)
    vdot = p w - r u + qbar S CY/m + g cos(pitch) sin(phi)
    wdot = q u - p v + qbar S CZ/m + g cos(pitch) cos(phi)
    I omegadot = qbar S (b Cl, cbar Cm, b Cn) - omega x I omega

with alpha = atan2(w, u), beta = asin(v/V), qbar = density V^2/2, the Euler angles in the order yaw,
pitch, roll, and polynomials for the coefficients. Source: report, App. E.
"""

import math
from typing import NamedTuple

import numpy as np

COUNT = 30  # free coefficients
# Standard acceleration of gravity (ISO 80000-3) [m/s^2].
GRAVITY = 9.80665


class Constants(NamedTuple):
    """Known numbers [SI]; Ixz is the product of inertia, positive for mass ahead and below."""

    mass: float
    Ix: float
    Iy: float
    Iz: float
    Ixz: float
    S: float
    b: float
    cbar: float
    density: float
    thrust: float

    @property
    def determinant(self) -> float:
        """Of the roll and yaw block of the inertia matrix."""
        return self.Ix * self.Iz - self.Ixz**2


class Air(NamedTuple):
    """Motion relative to the air: speed, angles, dynamic pressure, dimensionless rates."""

    V: object
    alpha: object
    beta: object
    qbar: object
    phat: object
    qhat: object
    rhat: object


def air(xp, c: Constants, x) -> Air:
    """Return the motion relative to the air of a state `x` of nine entries."""
    u, v, w, p, q, r = (x[i] for i in range(6))
    speed2 = u * u + v * v + w * w
    V = xp.sqrt(speed2)
    half = 0.5 / V
    alpha, beta = xp.arctan2(w, u), xp.arcsin(v / V)
    qbar = 0.5 * c.density * speed2
    return Air(V, alpha, beta, qbar, p * c.b * half, q * c.cbar * half, r * c.b * half)


def regressors(a: Air, d) -> list:
    """Return the 30 monomials in the order of the coefficients; `d` holds the three controls."""
    stabilator, aileron, rudder = d[0], d[1], d[2]
    alpha2 = a.alpha * a.alpha
    return [
        *(1.0, stabilator, alpha2),
        *(1.0, a.beta, rudder),
        *(1.0, a.alpha, alpha2, a.qhat, stabilator),
        *(1.0, a.beta, a.phat, a.rhat, aileron, rudder),
        *(1.0, a.alpha, alpha2, alpha2 * a.alpha, a.qhat, stabilator),
        *(1.0, a.beta, a.beta * a.beta * a.beta, a.phat, a.rhat, aileron, rudder),
    ]


# Columns of theta by coefficient.
CX, CY, CZ = range(0, 3), range(3, 6), range(6, 11)
CL, CM, CN = range(11, 17), range(17, 23), range(23, 30)


def coefficients(theta, terms) -> list:
    """Return CX, CY, CZ, Cl, Cm, Cn."""
    return [sum(theta[i] * terms[i] for i in columns) for columns in (CX, CY, CZ, CL, CM, CN)]


def rates(xp, c: Constants, theta, x, d) -> list:
    """Return the nine rates of the state; `xp` is the array library."""
    u, v, w, p, q, r, phi, pitch = (x[i] for i in range(8))
    now = air(xp, c, x)
    X, Y, Z, L, M, N = coefficients(theta, regressors(now, d))
    force = now.qbar * c.S / c.mass
    moment = now.qbar * c.S * c.b
    cp, sp, ct, st = xp.cos(phi), xp.sin(phi), xp.cos(pitch), xp.sin(pitch)
    # angular momentum Ix p - Ixz r, Iy q, Iz r - Ixz p
    roll = moment * L + (c.Iy - c.Iz) * q * r + c.Ixz * p * q
    yaw = moment * N + (c.Ix - c.Iy) * p * q - c.Ixz * q * r
    psidot = (q * sp + r * cp) / ct
    return [
        r * v - q * w + force * X + c.thrust / c.mass - GRAVITY * st,
        p * w - r * u + force * Y + GRAVITY * ct * sp,
        q * u - p * v + force * Z + GRAVITY * ct * cp,
        (c.Iz * roll + c.Ixz * yaw) / c.determinant,
        (now.qbar * c.S * c.cbar * M + (c.Iz - c.Ix) * p * r - c.Ixz * (p * p - r * r)) / c.Iy,
        (c.Ixz * roll + c.Ix * yaw) / c.determinant,
        p + st * psidot,
        q * cp - r * sp,
        psidot,
    ]


def outputs(xp, c: Constants, theta, x, d) -> list:
    """Return alpha, beta, p, q, r, the specific forces ax, ay, az [m/s^2], phi and pitch."""
    now = air(xp, c, x)
    X, Y, Z, *_ = coefficients(theta, regressors(now, d))
    force = now.qbar * c.S / c.mass
    specific = [force * X + c.thrust / c.mass, force * Y, force * Z]
    return [now.alpha, now.beta, x[3], x[4], x[5], *specific, x[6], x[7]]


class _Scalars:
    """Functions of Python floats under NumPy's names; ten times as fast as NumPy's on scalars."""

    sqrt, sin, cos = staticmethod(math.sqrt), staticmethod(math.sin), staticmethod(math.cos)
    arctan2, arcsin = staticmethod(math.atan2), staticmethod(math.asin)


def runge_kutta(rate, x, h, before, after):
    """Return the state after one classical Runge-Kutta step of length `h`.

    Args:
        rate: function of the state and the controls.
        x: state, an array.
        before, after: controls at both ends; linear between them.
    """
    middle = 0.5 * (before + after)
    k1 = rate(x, before)
    k2 = rate(x + 0.5 * h * k1, middle)
    k3 = rate(x + 0.5 * h * k2, middle)
    k4 = rate(x + h * k3, after)
    return x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def simulate(c: Constants, t, u, x0, theta) -> tuple[np.ndarray, np.ndarray]:
    """Return states (time, 9) and outputs (time, 10), by NumPy and Python floats."""
    theta = [float(value) for value in theta]

    def rate(x, d):
        return np.array(rates(_Scalars, c, theta, x.tolist(), d.tolist()))

    states = [np.asarray(x0, float)]
    for h, before, after in zip(np.diff(t), u[:-1], u[1:], strict=True):
        states.append(runge_kutta(rate, states[-1], h, before, after))
    x = np.stack(states)
    y = [outputs(np, c, theta, state, d) for state, d in zip(x, u, strict=True)]
    return x, np.array(y)
