"""A flight with everything in it that an identification model has to get right; the instruments
err, but all of it is known.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from small_airframe import small_airframe

from jaxid.aircraft import (
    COEFFICIENTS,
    Aircraft,
    ConstantThrust,
    Engine,
    Instruments,
    MeasuredSurfaces,
)
from jaxid.aircraft.flight.simulate_flight import simulate_flight
from jaxid.aircraft.physics.frames import quaternion, velocity
from jaxid.models import with_polynomials

CHANNELS = (
    *("alpha", "beta", "V", "p", "q", "r", "phi", "pitch", "psi", "altitude"),
    *("ax", "ay", "az", "pdot", "qdot", "rdot"),
)
TEN = ("u", "v", "w", "p", "q", "r", "phi", "pitch", "psi", "altitude")
TEN_IN_AIR = ("V", "alpha", "beta", *TEN[3:])
PLACES = {
    "alpha": (10.4, 0.2, 0.1),
    "beta": (10.1, -0.1, 0.3),
    "ax": (0.5, 0.1, -0.2),
    "ay": (1.5, -0.2, 0.4),
    "az": (2.0, 0.3, 0.1),
}
ASKEW = {
    "q": {"psi": 0.02, "phi": -0.01},
    "p": {"psi": 0.01},
    "ay": {"phi": 0.015},
    "rdot": {"theta": 0.02},
}
BIAS = {
    "alpha": 0.01,
    "beta": -0.005,
    "V": 1.5,
    "p": 0.002,
    "r": -0.003,
    "az": 0.2,
    "qdot": 0.01,
    "phi": 0.02,
    "altitude": 20.0,
}
SCALE = {"alpha": 0.03, "beta": 0.02, "V": 0.01, "q": 0.005, "ay": -0.004}
STEP, COARSE = 0.05, 0.2  # s: of the samples, and of the surfaces' straight lines


def aircraft():
    """Products of inertia, a reference point off the c.g., two engines off the axes with spinning
    rotors.
    """
    frame = small_airframe(Ixy=400.0, Iyz=-300.0)
    frame = eqx.tree_at(lambda node: node.reference, frame, jnp.array([0.1, 0.05, -0.08]))
    engines = tuple(
        Engine(
            ConstantThrust(force), position=(-3.0, side, 0.2), up=0.03, right=0.02, momentum=400.0
        )
        for force, side in ((22000.0, -1.0), (20000.0, 1.2))
    )
    instruments = Instruments(CHANNELS, position=PLACES, misalignment=ASKEW, bias=BIAS, scale=SCALE)
    return Aircraft(frame, engines=engines, controls=MeasuredSurfaces(), instruments=instruments)


def flown():
    """Four seconds in which all surfaces move, along straight lines of 0.2 s, so that a coarser
    record holds them too.
    """
    model = aircraft()
    t = STEP * np.arange(81)
    knots = COARSE * np.arange(21)
    at_knots = {
        "stabilator": -0.08 + 0.03 * np.sin(3.0 * knots),
        "aileron": 0.04 * np.sin(2.0 * knots + 0.5),
        "rudder": 0.06 * np.cos(2.5 * knots),
    }
    surfaces = {name: np.interp(t, knots, values) for name, values in at_knots.items()}
    state = model.flight_state(
        velocity(170.0, 0.15, 0.03),
        jnp.array([0.05, 0.02, -0.02]),
        quaternion(0.1, 0.2, 0.3),
        jnp.array([0.0, 0.0, 9000.0]),
    )
    return simulate_flight(model, t, surfaces, state, key=jax.random.key(0))


def with_true_coefficients(model, flight):
    """The model with the polynomials of the aircraft that flew."""
    true = flight.aircraft.airframe.aerodynamics
    return with_polynomials(model, {name: getattr(true, name) for name in COEFFICIENTS})


def true_histories(model, flight):
    """States and inputs of a model along the flight, as they were."""
    return tuple(
        jnp.stack([flight.truth.channel(name) for name in names], axis=-1)
        for names in (model.states, model.inputs)
    )
