"""The reference problem: an aircraft in output error with 30 free coefficients.

Nine states, ten outputs, three controls, 15 s at 50 samples a second. The states are integrated by
the classical Runge-Kutta method with one step per sample and inputs linear between samples (a
first-order hold). R is diagonal and re-estimated at each evaluation.

The record is simulated from the model itself, so that every program solves a problem of known
answer. Its first sample has no noise: the initial state is known, and a model that takes it from
the measurements finds it there.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import fsolve

from benchmarks.reference_problem import equations
from benchmarks.reference_problem.equations import COUNT, Constants

# Mass, moments of inertia and size: Garza and Morelli, NASA/TM-2003-212145, the F-4, as in
# `jaxid.aircraft.airframes.f4`. Factors: the foot is exactly 0.3048 m, the pound 0.45359237 kg, the
# slug 14.59390294 kg.
FOOT, POUND, SLUG = 0.3048, 0.45359237, 14.59390294
MASS = 38924.0 * POUND
INERTIA = {
    name: value * SLUG * FOOT**2
    for name, value in {"Ix": 24970.0, "Iy": 122190.0, "Iz": 139800.0, "Ixz": 1175.0}.items()
}
AREA, SPAN, CHORD = 530.0 * FOOT**2, 38.67 * FOOT, 16.04 * FOOT
# Chosen: 600 ft/s in the density of the standard atmosphere (1976) at 30,000 ft.
SPEED, ALTITUDE, DENSITY = 600.0 * FOOT, 30000.0 * FOOT, 0.4583

# Chosen: of the size of a fighter's coefficients at 5 to 20 deg, with all motions stable enough for
# 15 s without a pilot.
TRUE = {
    "CX": {"1": -0.035, "stabilator": 0.04, "alpha^2": 0.55},
    "CY": {"1": 0.001, "beta": -0.55, "rudder": 0.10},
    "CZ": {"1": -0.06, "alpha": -2.8, "alpha^2": 2.2, "qhat": -3.0, "stabilator": -0.45},
    "Cl": {
        "1": -0.0002,
        "beta": -0.07,
        "phat": -0.20,
        "rhat": 0.08,
        "aileron": -0.03,
        "rudder": 0.006,
    },
    "Cm": {
        "1": 0.02,
        "alpha": -0.30,
        "alpha^2": 0.35,
        "alpha^3": -1.2,
        "qhat": -5.5,
        "stabilator": -0.46,
    },
    "Cn": {
        "1": 0.0003,
        "beta": 0.08,
        "beta^3": 0.6,
        "phat": -0.03,
        "rhat": -0.40,
        "aileron": -0.004,
        "rudder": -0.05,
    },
}
NAMES = tuple(f"{name}.{term}" for name, terms in TRUE.items() for term in terms)
THETA = np.array([value for terms in TRUE.values() for value in terms.values()])

INPUTS = ("stabilator", "aileron", "rudder")
STATES = ("u", "v", "w", "p", "q", "r", "phi", "pitch", "psi")
OUTPUTS = ("alpha", "beta", "p", "q", "r", "ax", "ay", "az", "phi", "pitch")
# Standard deviations of the noise [rad, rad/s, m/s^2]; chosen, near those of test instruments.
G = equations.GRAVITY
NOISE = np.array([0.002, 0.002, 0.004, 0.004, 0.003, 0.003 * G, 0.003 * G, 0.01 * G, 0.002, 0.002])

SAMPLES, DURATION = 751, 15.0
NOISE_SEED, START_SEED = 1, 7
START_ERROR = 0.2  # relative, with random signs
# Pulses by control: (begin, end, sign) [s], and the amplitude [rad]; chosen to excite all motions.
PULSES = {
    "stabilator": (
        0.045,
        (
            (1.0, 2.8, 1),
            (2.8, 4.0, -1),
            (4.0, 4.6, 1),
            (4.6, 5.2, -1),
            (9.5, 10.1, -1),
            (10.1, 10.7, 1),
        ),
    ),
    "aileron": (0.12, ((5.5, 6.3, 1), (6.3, 7.1, -1), (11.0, 11.6, -1), (11.6, 12.2, 1))),
    "rudder": (0.10, ((7.5, 8.3, 1), (8.3, 9.1, -1), (12.5, 13.0, 1), (13.0, 13.5, -1))),
}


class ReferenceProblem(NamedTuple):
    """A record and what is known of it.

    Attributes:
        constants: mass, size, density and thrust.
        t: sample times, shape (time,) [s].
        u: controls, shape (time, 3) [rad].
        z: measured outputs, shape (time, 10).
        x0: initial state, shape (9,).
        start: coefficients at which a fit starts, shape (30,).
    """

    constants: Constants
    t: np.ndarray
    u: np.ndarray
    z: np.ndarray
    x0: np.ndarray
    start: np.ndarray


def make_problem(samples: int = SAMPLES, seed: int = NOISE_SEED) -> ReferenceProblem:
    """Return the problem; another number of samples covers the same 15 s."""
    constants, x0, stabilator = trim()
    t = np.linspace(0.0, DURATION, samples)
    u = controls(t, stabilator)
    _, y = equations.simulate(constants, t, u, x0, THETA)
    noise = NOISE * np.random.default_rng(seed).standard_normal(y.shape)
    noise[0] = 0.0
    signs = np.where(np.random.default_rng(START_SEED).random(COUNT) < 0.5, -1.0, 1.0)
    return ReferenceProblem(constants, t, u, y + noise, x0, THETA * (1.0 + START_ERROR * signs))


def trim() -> tuple[Constants, np.ndarray, float]:
    """Return the constants with the thrust of level flight, the state and the stabilator there."""

    def unbalance(unknown):
        alpha, stabilator, thrust = unknown
        x = _level(alpha)
        dx = equations.rates(np, _constants(1e5 * thrust), THETA, x, (stabilator, 0.0, 0.0))
        return [dx[0], dx[2], 10.0 * dx[4]]

    alpha, stabilator, thrust = fsolve(unbalance, [0.18, -0.05, 0.3], xtol=1e-14)
    return _constants(1e5 * float(thrust)), _level(float(alpha)), float(stabilator)


def controls(t: np.ndarray, stabilator: float) -> np.ndarray:
    """Return the pulses of the three controls about the trimmed stabilator [rad]."""
    columns = []
    for name in INPUTS:
        amplitude, pulses = PULSES[name]
        # a sample on an edge, but for rounding, belongs to the pulse that begins there
        shape = sum(sign * ((t >= a - 1e-9) & (t < b - 1e-9)) for a, b, sign in pulses)
        columns.append(amplitude * shape + (stabilator if name == "stabilator" else 0.0))
    return np.stack(columns, axis=1)


def _constants(thrust: float) -> Constants:
    return Constants(MASS, *INERTIA.values(), AREA, SPAN, CHORD, DENSITY, thrust)


def _level(alpha: float) -> np.ndarray:
    x = np.zeros(len(STATES))
    x[[0, 2, 7]] = SPEED * np.cos(alpha), SPEED * np.sin(alpha), alpha
    return x
