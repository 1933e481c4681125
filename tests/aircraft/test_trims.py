"""Steady flight: exact by the model's own equations, right kinematics, limits and words, derivatives, batches, wind."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft.aerodynamics_polynomial import PolynomialAerodynamics
from jaxid.aircraft.aircraft import Aircraft
from jaxid.aircraft.airframe import Airframe
from jaxid.aircraft.atmosphere import GRAVITY
from jaxid.aircraft.engine import ConstantThrust, Engine
from jaxid.aircraft.frames import euler
from jaxid.aircraft.mass import MassProperties
from jaxid.aircraft.modes import CLASSICAL, linearise_euler, modes
from jaxid.aircraft.trims import climb, level, pull_up, turn
from jaxid.aircraft.wind import Wind

V, H = 185.0, 3000.0
LIMITS = {"stabilator": (-21.0, 9.0), "aileron": (-30.0, 30.0), "rudder": (-30.0, 30.0)}


def made(**options) -> Aircraft:
    """An aircraft of an F-4's size, linear but for its drag; numbers of our choice."""
    frame = Airframe(
        name="linear",
        mass_properties=MassProperties(mass=17700.0, Ix=33900.0, Iy=165000.0, Iz=190000.0, Ixz=2000.0),
        S=49.2,
        b=11.8,
        cbar=4.88,
        aerodynamics=PolynomialAerodynamics(
            {
                "CX": {"1": -0.02, "alpha^2": -0.6},
                "CY": {"beta": -0.6, "rudder": 0.15},
                "CZ": {"1": -0.15, "alpha": -3.2, "qhat": -5.0, "stabilator": -0.45},
                "Cl": {"beta": -0.1, "aileron": -0.05, "rudder": -0.01, "phat": -0.25, "rhat": 0.1},
                "Cm": {"1": 0.01, "alpha": -0.35, "qhat": -6.5, "stabilator": -0.55},
                "Cn": {"beta": 0.1, "aileron": 0.005, "rudder": -0.07, "phat": -0.02, "rhat": -0.3},
            }
        ),
        limits={name: (math.radians(low), math.radians(high)) for name, (low, high) in LIMITS.items()},
    )
    return Aircraft(frame, **options)


@pytest.fixture(scope="module")
def aircraft():
    return made()


@pytest.fixture(scope="module")
def flown(aircraft):
    """One of each kind."""
    return {
        "level": level(aircraft, V, H),
        "climb": climb(aircraft, V, H, 0.15),
        "bank": turn(aircraft, V, H, bank=1.0),
        "rate": turn(aircraft, V, H, turn_rate=-0.1, gamma=-0.1),
        "pull-up": pull_up(aircraft, V, H, load_factor=3.0),
    }


@eqx.filter_jit
def moving(model, state):
    """Rates by name, and all signals, in flight without input."""
    t, u = jnp.zeros(()), jnp.zeros(len(model.inputs))
    dx = model.rhs(t, state, u)
    angles = jax.jvp(lambda e: jnp.stack(euler(e)), (state[6:10],), (dx[6:10],))[1]
    rates = dict(zip(model.states, dx, strict=True)) | dict(zip(("phi", "pitch", "psi"), angles, strict=True))
    return rates, model.signals(t, state, u)


@pytest.mark.parametrize("kind", ["level", "climb", "bank", "rate", "pull-up"])
def test_nothing_but_place_and_heading_moves(flown, kind):
    """By the whole model with its controls at rest, to rounding; a pull-up pitches, and its path with it."""
    model, state, trim = flown[kind]
    rates, signals = moving(model, state)
    assert bool(trim.successful)
    for name in ("u", "v", "w", "p", "q", "r", "phi", "stabilator", "aileron", "rudder"):
        np.testing.assert_allclose(rates[name], 0.0, atol=1e-11, err_msg=name)
    np.testing.assert_allclose(signals["V"], V, rtol=1e-13)
    np.testing.assert_allclose(state[12], H)
    np.testing.assert_allclose(
        [signals[name] for name in ("alpha", "pitch")], [trim.value("alpha"), trim.value("pitch")]
    )
    if kind != "pull-up":
        np.testing.assert_allclose(rates["pitch"], 0.0, atol=1e-12)


def test_level_flight(flown):
    rates, signals = moving(*flown["level"][:2])
    np.testing.assert_allclose([rates["altitude"], rates["psi"], signals["beta"], signals["phi"]], 0.0, atol=1e-12)
    np.testing.assert_allclose(signals["pitch"], signals["alpha"], rtol=1e-12)
    assert 0.0 < float(flown["level"].trim.value("setting")) == float(signals["thrust"])


def test_climb(flown):
    rates, signals = moving(*flown["climb"][:2])
    np.testing.assert_allclose(rates["altitude"], V * np.sin(0.15), rtol=1e-12)
    np.testing.assert_allclose(signals["gamma"], 0.15, rtol=1e-12)
    more = float(signals["thrust"] - flown["level"].trim.value("setting"))
    np.testing.assert_allclose(more, 17700.0 * GRAVITY * np.sin(0.15), rtol=0.05)  # the weight's part along the path


def test_turns(flown):
    """Coordinated: no side force; and the acceleration over ground is centripetal, V cos(gamma) psidot."""
    for kind, gamma in (("bank", 0.0), ("rate", -0.1)):
        model, state, trim = flown[kind]
        rates, signals = moving(model, state)
        np.testing.assert_allclose(signals["ay"], 0.0, atol=1e-10)
        np.testing.assert_allclose(rates["altitude"], V * np.sin(gamma), atol=1e-10)
        turning = float(trim.value("turn_rate")) if kind == "bank" else -0.1
        np.testing.assert_allclose(rates["psi"], turning, rtol=1e-11)
        np.testing.assert_allclose(np.hypot(rates["north"], rates["east"]), V * np.cos(gamma), rtol=1e-12)
        felt = np.linalg.norm([signals["ax"], signals["ay"], signals["az"]])
        np.testing.assert_allclose(felt, np.hypot(GRAVITY, V * np.cos(gamma) * turning), rtol=1e-11)
    assert flown["bank"].trim.value("turn_rate") > 0.0
    assert flown["rate"].trim.value("phi") < 0.0


def test_bank_and_turn_rate_ask_the_same_question(aircraft, flown):
    again = turn(aircraft, V, H, bank=flown["rate"].trim.value("phi"), gamma=-0.1)
    np.testing.assert_allclose(again.trim.value("turn_rate"), -0.1, rtol=1e-10)
    np.testing.assert_allclose(again.state, flown["rate"].state, rtol=1e-8, atol=1e-10)


def test_pull_up(flown):
    """Three times the weight normal to the path, which turns as the aircraft pitches."""
    _, signals = moving(*flown["pull-up"][:2])
    alpha = signals["alpha"]
    normal = signals["ax"] * jnp.sin(alpha) - signals["az"] * jnp.cos(alpha)
    np.testing.assert_allclose(normal, 3.0 * GRAVITY, rtol=1e-11)
    np.testing.assert_allclose(signals["q"], 2.0 * GRAVITY / V, rtol=1e-12)
    np.testing.assert_allclose([signals["phi"], signals["gamma"]], 0.0, atol=1e-12)


def test_wind_carries_all_of_it_along(flown):
    """In steady wind the flight relative to the air is the same, and over ground the wind's velocity is added."""
    windy = made(wind=Wind(north=12.0, east=-7.0))
    model, state, trim = turn(windy, V, H, bank=1.0)
    np.testing.assert_allclose(trim.values, flown["bank"].trim.values, rtol=1e-10, atol=1e-12)
    rates, signals = moving(model, state)
    still, _ = moving(*flown["bank"][:2])
    np.testing.assert_allclose(signals["V"], V, rtol=1e-12)
    added = [float(rates[name] - still[name]) for name in ("north", "east", "altitude")]
    np.testing.assert_allclose(added, [12.0, -7.0, 0.0], atol=1e-9)


def test_an_engine_off_the_plane_of_symmetry():
    """Rudder and bank hold it straight without sideslip, or sideslip and rudder without side force."""
    engine = Engine(ConstantThrust(0.0), position=(0.0, 1.5, 0.0))
    banked, slipping = (level(made(engines=(engine,)), V, H, beta=beta) for beta in (0.0, None))
    assert abs(float(banked.trim.value("phi"))) > 1e-3 < abs(float(banked.trim.value("rudder")))
    assert abs(float(slipping.trim.value("beta"))) > 1e-3
    np.testing.assert_allclose(slipping.trim.value("phi"), 0.0, atol=1e-12)
    for found in (banked, slipping):
        rates, _ = moving(found.aircraft, found.state)
        np.testing.assert_allclose([rates[name] for name in "uvwpqr"], 0.0, atol=1e-10)


def test_what_cannot_be_flown_says_why(aircraft):
    with pytest.raises(InputError) as raised:
        level(aircraft, V, H, setting_limits=(0.0, 10e3))
    text = str(raised.value)
    assert (
        "cannot be trimmed for straight flight at V = 185 m/s and an altitude of 3000 m: udot is out of balance by"
        in text
    )
    assert "setting stands at its upper limit, 1e+04 N" in text
    with pytest.raises(InputError, match=r"stabilator stands at its lower limit, -0.3665 rad \(-21 deg\)"):
        pull_up(aircraft, V, H, load_factor=9.0, setting_limits=(0.0, 2e6))
    with pytest.raises(InputError, match=r"The speed is 0\.0 m/s"):
        level(aircraft, 0.0, H)
    with pytest.raises(InputError, match="either its bank or its turn rate"):
        turn(aircraft, V, H)
    with pytest.raises(InputError, match="either its load factor or its pitch rate"):
        pull_up(aircraft, V, H, load_factor=2.0, pitch_rate=0.1)


def test_a_batch_of_speeds(aircraft, flown):
    """One that is too slow fails alone."""
    found = eqx.filter_jit(eqx.filter_vmap(lambda speed: level(aircraft, speed, H)))(jnp.array([30.0, V, 250.0]))
    np.testing.assert_array_equal(found.trim.successful, [False, True, True])
    np.testing.assert_allclose(found.state[1], flown["level"].state, rtol=1e-10, atol=1e-12)


def test_derivatives_equal_finite_differences(aircraft):
    """Of trim to mass and to Cm.alpha; central differences with a relative step of 1e-4 are right to about 1e-8."""

    def where(model):
        frame = model.airframe
        return frame.mass_properties.mass, frame.aerodynamics.Cm.coefficients

    mass, Cm = where(aircraft)

    @jax.jit
    def trimmed(factors):
        scaled = (
            mass * factors[0],
            Cm * jnp.array([1.0, 0.0, 1.0, 1.0]) + Cm * jnp.array([0.0, 1.0, 0.0, 0.0]) * factors[1],
        )
        return level(eqx.tree_at(where, aircraft, scaled), V, H).trim.values

    exact = jax.jit(jax.jacfwd(trimmed))(jnp.ones(2))
    for column in range(2):
        step = jnp.zeros(2).at[column].set(1e-4)
        difference = (trimmed(1.0 + step) - trimmed(1.0 - step)) / 2e-4
        np.testing.assert_allclose(exact[:, column], difference, rtol=1e-6, atol=1e-7)


def test_all_five_modes(flown):
    """Of the aircraft in level flight, with the classical eight states and with all of them."""
    model, state, _ = flown["level"]
    whole = eqx.filter_jit(linearise_euler)(model, 0.0, state, jnp.zeros(len(model.inputs)))
    eight = modes(whole.reduced(states=CLASSICAL))
    assert {mode.name for mode in eight} == {"short period", "phugoid", "dutch roll", "roll", "spiral"}
    every = modes(whole)
    for name in ("short period", "dutch roll", "roll"):
        np.testing.assert_allclose(every.named(name).eigenvalue, eight.named(name).eigenvalue, rtol=1e-3)
    assert {mode.name for mode in every} == {mode.name for mode in eight} | {"unnamed"}
    by_difference = np.linalg.eigvals(np.asarray(whole.reduced(states=("v", "p", "r", "phi")).A))
    np.testing.assert_allclose(np.min(np.abs(by_difference - eight.named("dutch roll").eigenvalue)), 0.0, atol=1e-9)
