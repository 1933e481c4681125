"""Trim points of the F-16 as printed by Stevens and Lewis, and its modes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.aircraft.air.atmosphere import AbstractAtmosphere, Air
from jaxid.aircraft.airframes import f16_engine, f16_low
from jaxid.aircraft.flight.aircraft import Aircraft
from jaxid.aircraft.flight.modes import CLASSICAL, linearise_euler, modes
from jaxid.aircraft.flight.trims import level, turn
from jaxid.aircraft.physics.frames import air_angles, euler, quaternion, velocity
from jaxid.aircraft.vehicle.controls import MeasuredSurfaces

FOOT = 0.3048

# Level flight at sea level with the centre of gravity at 0.35 chord: V [ft/s], throttle, alpha
# [deg], elevator [deg]. B. L. Stevens, F. L. Lewis, E. N. Johnson, Aircraft Control and Simulation,
# 3rd ed., Wiley 2015, Table 3.6-2.
PRINTED = np.array(
    [
        [130, 0.816, 45.6, 20.1],
        [140, 0.736, 40.3, -1.36],
        [150, 0.619, 34.6, 0.173],
        [170, 0.464, 27.2, 0.621],
        [200, 0.287, 19.7, 0.723],
        [260, 0.148, 11.6, -0.090],
        [300, 0.122, 8.49, -0.591],
        [350, 0.107, 5.87, -0.539],
        [400, 0.108, 4.16, -0.591],
        [440, 0.113, 3.19, -0.671],
        [500, 0.137, 2.14, -0.756],
        [540, 0.160, 1.63, -0.798],
        [600, 0.200, 1.04, -0.846],
        [640, 0.230, 0.742, -0.871],
        [700, 0.282, 0.382, -0.900],
        [800, 0.378, -0.045, -0.943],
    ]
)


# kg; the rounded value of the book, 1/m = 1.57e-3 1/slug, 0.03 % below the report's mass
MASS = 14.59390294 / 1.57e-3


def f16(xcg=0.35) -> Aircraft:
    airframe = eqx.tree_at(
        lambda frame: frame.mass_properties.mass, f16_low(xcg=xcg), jnp.asarray(MASS)
    )
    return Aircraft(airframe, engines=(f16_engine(),))


@pytest.fixture(scope="module")
def trimmed():
    """A batch of all speeds."""
    speeds = jnp.asarray(FOOT * PRINTED[:, 0])
    return eqx.filter_jit(
        eqx.filter_vmap(lambda model, V: level(model, V, 0.0).trim, in_axes=(None, 0))
    )(f16(), speeds)


def test_trims_match_the_printed_trim_points(trimmed):
    """To the known accuracy of the tables relative to the book: alpha 0.02 deg from 200 ft/s on,
    throttle 0.002 everywhere, elevator 0.003 deg from 170 to 800 ft/s; at lower speeds 0.05 deg,
    the last digit of the printed angles.
    """
    V = PRINTED[:, 0]
    assert np.all(trimmed.successful)
    alpha, elevator = np.degrees(trimmed.value("alpha")), np.degrees(trimmed.value("stabilator"))
    np.testing.assert_allclose(trimmed.value("setting"), PRINTED[:, 1], atol=0.002)
    fast, known = V >= 200, V >= 170
    np.testing.assert_allclose(alpha[fast], PRINTED[fast, 2], atol=0.02)
    np.testing.assert_allclose(alpha[~fast], PRINTED[~fast, 2], atol=0.05)
    np.testing.assert_allclose(elevator[known], PRINTED[known, 3], atol=0.003)
    np.testing.assert_allclose(elevator[~known], PRINTED[~known, 3], atol=0.05)
    for name in ("phi", "aileron", "rudder"):
        np.testing.assert_allclose(trimmed.value(name), 0.0, atol=1e-10)


def test_turn_matches_the_printed_coordinated_turn():
    """502 ft/s, 0.3 rad/s, centre of gravity at 0.3 chord: the fourth column of Table 3.6-3, to its
    last digit.
    """
    result = turn(f16(0.30), 502.0 * FOOT, 0.0, turn_rate=0.3)
    printed = {
        "alpha": (0.2485, 5e-5),
        "beta": (4.8e-4, 5e-6),
        "phi": (1.367, 5e-4),
        "pitch": (0.05185, 2e-5),
    }
    for name, (value, digit) in printed.items():
        np.testing.assert_allclose(result.trim.value(name), value, atol=digit, err_msg=name)
    np.testing.assert_allclose(result.state[3:6], [-0.01555, 0.2934, 0.06071], atol=5e-5)
    angles = [np.degrees(result.trim.value(name)) for name in ("stabilator", "aileron", "rudder")]
    np.testing.assert_allclose(angles, [-6.256, 0.09891, -0.4218], atol=5e-4)
    np.testing.assert_allclose(result.trim.value("setting"), 0.8499, atol=1e-4)


class BookAir(AbstractAtmosphere):
    """The air of Stevens and Lewis, App. A: density by a power law, 1716.3 ft lbf/(slug R), 519 R
    at sea level.
    """

    def air(self, altitude):
        ratio = 1.0 - 0.703e-5 * altitude / FOOT
        density = 2.377e-3 * ratio**4.14 * 515.378818  # slug/ft^3 to kg/m^3
        kelvin = jnp.where(altitude / FOOT > 35000.0, 390.0, 519.0 * ratio) / 1.8
        speed = jnp.sqrt(1.4 * 1716.3 * 1.8 * kelvin) * FOOT
        return Air(kelvin, density * 1716.3 * FOOT**2 * 1.8 * kelvin, density, speed)


def test_rates_match_the_printed_numbers_of_the_complete_model():
    """The book's test of its program, Table 3.5-2, all twelve states and four controls nonzero.

    The air is the book's. The book uses g = 32.17 ft/s^2 and 1 deg = 1/57.29578, and some of its
    numbers are single precision; the tables of this airframe reproduce them to 0.05 %.
    """
    x = {"V": 500.0 * FOOT, "alpha": 0.5, "beta": -0.2, "phi": -1.0, "pitch": 1.0, "psi": -1.0}
    airframe = eqx.tree_at(
        lambda frame: frame.mass_properties.mass, f16_low(xcg=0.4), jnp.asarray(MASS)
    )
    aircraft = Aircraft(
        airframe, engines=(f16_engine(),), controls=MeasuredSurfaces(), atmosphere=BookAir()
    )
    e = quaternion(x["phi"], x["pitch"], x["psi"])
    place = jnp.array([1000.0, 900.0, 10000.0]) * FOOT
    state = aircraft.flight_state(
        velocity(x["V"], x["alpha"], x["beta"]), jnp.array([0.7, -0.8, 0.9]), e, place
    )
    state = state.at[aircraft.states.index("power")].set(90.0)
    u = jnp.array([*np.radians([20.0, -15.0, -20.0]), 0.9])
    assert aircraft.inputs == ("stabilator", "aileron", "rudder", "throttle")

    def air_path(state):
        V, alpha, beta = air_angles(state[:3])
        return jnp.stack(
            [
                V / FOOT,
                alpha,
                beta,
                *euler(state[6:10]),
                *state[3:6],
                *state[10:13] / FOOT,
                state[13],
            ]
        )

    dx = jax.jit(lambda s: jax.jvp(air_path, (s,), (aircraft.rhs(jnp.zeros(()), s, u),))[1])(state)
    printed = [
        -75.23724,
        -0.8813491,
        -0.4759990,
        2.505734,
        0.3250820,
        2.145926,
        12.62679,
        0.9649671,
        0.5809759,
    ]
    printed += [342.4439, -266.7707, 248.1241, -58.68999]
    np.testing.assert_allclose(dx, printed, rtol=5e-4)


def test_modes_depend_on_the_centre_of_gravity():
    """At 0.30 chord the five classical modes; at 0.35 without static stability the third
    oscillatory one (section 3.8).
    """
    linear = eqx.filter_jit(
        lambda model, state: linearise_euler(model, 0.0, state, jnp.zeros(len(model.inputs)))
    )
    names = {}
    for xcg in (0.30, 0.35):
        trimmed = level(f16(xcg), 502.0 * FOOT, 0.0)
        reduced = linear(trimmed.aircraft, trimmed.state).reduced(states=CLASSICAL)
        names[xcg] = [mode.name for mode in modes(reduced)]
    assert set(names[0.30]) == {"short period", "phugoid", "dutch roll", "roll", "spiral"}
    assert {"third oscillatory", "dutch roll", "roll", "spiral"} < set(names[0.35])
