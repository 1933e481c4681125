"""Simulated flights of a small polynomial aircraft, written in the layouts of SIDPAC and of DLR,
and their true parameters.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from scipy.io import savemat

from jaxid.aircraft import (
    GUSTS,
    Aircraft,
    Airframe,
    ConstantThrust,
    Engine,
    Instruments,
    MassProperties,
    MeasuredSurfaces,
    PolynomialAerodynamics,
    dryden,
)
from jaxid.aircraft.flight.simulate_flight import simulate_flight as fly
from jaxid.aircraft.physics.frames import quaternion, velocity

FOOT, POUND, G0, DEG = 0.3048, 4.4482216152605, 9.80665, np.pi / 180
SLUG = POUND / FOOT
# The size of a propeller aircraft with two engines, with invented coefficients; the constant of Cm
# trims it at 5 deg with -2 deg of elevator.
MASS = {"mass": 5000.0, "Ix": 21000.0, "Iy": 32000.0, "Iz": 48000.0, "Ixz": 1500.0}
SIZE = {"S": 39.0, "b": 19.8, "cbar": 1.98}
TRUE = {
    "CX": {"1": -0.035, "alpha": 0.25, "alpha^2": 2.2},
    "CY": {"beta": -0.85, "rudder": 0.18, "rhat": 0.4},
    "CZ": {"1": -0.30, "alpha": -5.2, "qhat": -12.0, "stabilator": -0.5},
    "Cl": {"beta": -0.11, "phat": -0.52, "rhat": 0.2, "aileron": -0.18, "rudder": 0.02},
    "Cm": {"1": 0.062, "alpha": -1.3, "qhat": -28.0, "stabilator": -1.5},
    "Cn": {"beta": 0.09, "phat": -0.06, "rhat": -0.19, "rudder": -0.085, "aileron": 0.008},
}
THRUST, V0, HEIGHT = 4100.0, 75.0, 1500.0
SURFACES = ("stabilator", "aileron", "rudder")
NOISE = {
    **dict.fromkeys(("alpha", "beta"), 0.0015),
    **dict.fromkeys(("p", "q", "r"), 0.0008),
    **dict.fromkeys(("phi", "pitch", "psi"), 0.001),
    **{"V": 0.25, "ax": 0.03, "ay": 0.03, "az": 0.06, "altitude": 1.0},
}


@functools.cache
def aircraft() -> Aircraft:
    frame = Airframe(
        name="twin",
        mass_properties=MassProperties(**MASS),
        S=SIZE["S"],
        b=SIZE["b"],
        cbar=SIZE["cbar"],
        aerodynamics=PolynomialAerodynamics(TRUE),
        limits=dict.fromkeys(("stabilator", "aileron", "rudder"), (-0.5, 0.5)),
    )
    return Aircraft(
        frame,
        engines=(Engine(ConstantThrust(THRUST)),),
        controls=MeasuredSurfaces(),
        instruments=Instruments(("V",)),
    )


def doublets(t, start, width, size, count=1):
    """Pulses up and down, as a pilot gives them: corners rounded over 0.1 s."""
    signal = np.zeros_like(t)
    for k in range(2 * count):
        inside = (t >= start + k * width) & (t < start + (k + 1) * width)
        signal = signal + np.where(inside, size * (-1) ** k, 0.0)
    wide = max(round(0.1 / (t[1] - t[0])), 1)
    return np.convolve(
        np.pad(signal, wide, mode="edge"), np.ones(2 * wide + 1) / (2 * wide + 1), mode="valid"
    )


def surfaces(t, which=SURFACES):
    """Doublets one surface after another, again and again to the end."""
    given = {"stabilator": -0.035 + 0 * t, "aileron": 0 * t, "rudder": 0 * t}
    shapes = {"stabilator": (0.5, 0.03), "aileron": (0.6, 0.06), "rudder": (0.9, 0.06)}
    start, k = 1.0, 0
    while start < t[-1] - 3.0:
        name = which[k % len(which)]
        width, size = shapes[name]
        given[name] = given[name] + doublets(
            t, start, width * (1 + 0.4 * (k % 2)), size * (-1) ** (k // 3), 1
        )
        start, k = start + 5.0, k + 1
    return given


def flight(
    seconds=30.0, step=0.04, which=SURFACES, seed=0, gusts=None, bias=None, scale=None, noise=1.0
):
    """Measured channels of a flight in which the surfaces move one after another, in SI units, with
    `t`.

    Speed is the true airspeed, beta the sideslip, accelerations are those of the centre of gravity.

    Args:
        seconds, step: length and time between samples [s].
        which: surfaces that are moved.
        seed: of noise and gusts.
        gusts: severity of turbulence, "light" and so on; still air when left out.
        bias, scale: errors of instruments by channel.
        noise: factor on its standard deviations.
    """
    t = np.arange(0.0, seconds, step)
    state = aircraft().flight_state(
        velocity(V0, 0.093, 0.0),
        jnp.zeros(3),
        quaternion(0.0, 0.093, 0.3),
        jnp.array([0.0, 0.0, HEIGHT]),
    )
    moved, key = surfaces(t, which), jax.random.key(seed)
    if gusts:
        blown = dryden(key, jnp.asarray(t), V0, HEIGHT, gusts, span=SIZE["b"])
        moved |= dict(zip(GUSTS, blown.T, strict=True))
    truth = fly(aircraft(), t, moved, state, key=key).truth
    rng, bias, scale = np.random.default_rng(seed), bias or {}, scale or {}
    measured = {
        name: np.asarray(truth.channel(name))
        for name in (*SURFACES, "qbar", "thrust", "pdot", "qdot", "rdot")
    }
    for name, size in NOISE.items():
        shown = (1.0 + scale.get(name, 0.0)) * np.asarray(truth.channel(name)) + bias.get(name, 0.0)
        measured[name] = shown + noise * size * rng.normal(size=t.size)
    return measured | {"t": t}


def write_sidpac(path, measured, **changed):
    """A flight in SIDPAC's 90 columns of feet, degrees and g, as `.mat` or `.csv`; the columns that
    are read, and no others.

    Args:
        path: the file.
        measured: from `flight`.
        changed: columns by number (from 1), such as `column_48=0.0`.
    """
    numbers = np.zeros((measured["t"].size, 90))
    columns = {
        "t": (1, 1.0),
        "V": (2, FOOT),
        "beta": (3, DEG),
        "alpha": (4, DEG),
        "altitude": (30, FOOT),
    }
    columns |= {name: (5 + k, DEG) for k, name in enumerate(("p", "q", "r", "phi", "pitch", "psi"))}
    columns |= {name: (11 + k, G0) for k, name in enumerate(("ax", "ay", "az"))}
    columns |= {name: (14 + k, DEG) for k, name in enumerate(SURFACES)}
    columns |= {"qbar": (27, POUND / FOOT**2), "thrust": (38, POUND)}
    for name, (column, unit) in columns.items():
        numbers[:, column - 1] = measured[name] / unit
    numbers[:, 47] = MASS["mass"] / SLUG
    numbers[:, 48:52] = np.array([MASS[name] for name in ("Ix", "Iy", "Iz", "Ixz")]) / (
        SLUG * FOOT**2
    )
    numbers[:, 76:79] = [SIZE["S"] / FOOT**2, SIZE["b"] / FOOT, SIZE["cbar"] / FOOT]
    for name, value in changed.items():
        numbers[:, int(name.removeprefix("column_")) - 1] = value
    if path.suffix == ".mat":
        savemat(path, {"fdata": numbers})
    else:
        np.savetxt(path, numbers, delimiter=",")
    return path


def write_hfb(path, measured):
    """A flight in the columns of `hfb320_1_10.asc`: SI, with angular accelerations, without
    altitude and heading.
    """
    order = (
        "t",
        "stabilator",
        "qbar",
        "thrust",
        "V",
        "alpha",
        "pitch",
        "q",
        "qdot",
        "ax",
        "az",
        "ay",
        "p",
        "r",
        "pdot",
    )
    order += ("rdot", "beta", "phi", "aileron", "rudder")
    np.savetxt(path, np.column_stack([measured[name] for name in order]), fmt="%16.8E")
    return path
