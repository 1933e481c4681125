"""Trims: equations of the model, kinematics, limits, messages, derivatives, batches, wind."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft.air.atmosphere import GRAVITY
from jaxid.aircraft.air.wind import Wind
from jaxid.aircraft.flight.aircraft import Aircraft
from jaxid.aircraft.flight.modes import CLASSICAL, linearise_euler, modes
from jaxid.aircraft.flight.trims import climb, level, pull_up, turn
from jaxid.aircraft.physics.frames import euler
from jaxid.aircraft.physics.mass import MassProperties
from jaxid.aircraft.vehicle.aerodynamics_polynomial import PolynomialAerodynamics
from jaxid.aircraft.vehicle.airframe import Airframe
from jaxid.aircraft.vehicle.engine import ConstantThrust, Engine

V, H = 185.0, 3000.0
LIMITS = {"stabilator": (-21.0, 9.0), "aileron": (-30.0, 30.0), "rudder": (-30.0, 30.0)}


def made(**options) -> Aircraft:
    """An aircraft of an F-4's size, linear except for its drag; chosen numbers."""
    frame = Airframe(
        name="linear",
        mass_properties=MassProperties(
            mass=17700.0, Ix=33900.0, Iy=165000.0, Iz=190000.0, Ixz=2000.0
        ),
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
        limits={
            name: (math.radians(low), math.radians(high)) for name, (low, high) in LIMITS.items()
        },
    )
    return Aircraft(frame, **options)


@pytest.fixture(scope="module")
def aircraft():
    return made()


@pytest.fixture(scope="module")
def trims(aircraft):
    """A trim of each kind."""
    return {
        "level": level(aircraft, V, H),
        "climb": climb(aircraft, V, H, 0.15),
        "bank": turn(aircraft, V, H, bank=1.0),
        "rate": turn(aircraft, V, H, turn_rate=-0.1, gamma=-0.1),
        "pull-up": pull_up(aircraft, V, H, load_factor=3.0),
    }


@eqx.filter_jit
def moving(model, state):
    """Rates by name, and all signals, without input."""
    t, u = jnp.zeros(()), jnp.zeros(len(model.inputs))
    dx = model.rhs(t, state, u)
    angles = jax.jvp(lambda e: jnp.stack(euler(e)), (state[6:10],), (dx[6:10],))[1]
    rates = dict(zip(model.states, dx, strict=True)) | dict(
        zip(("phi", "pitch", "psi"), angles, strict=True)
    )
    return rates, model.signals(t, state, u)


@pytest.mark.parametrize("kind", ["level", "climb", "bank", "rate", "pull-up"])
def test_trim_has_zero_rates_except_position_and_heading(trims, kind):
    """By the complete model with its controls at rest, to rounding; in a pull-up the pitch and the
    flight path change too.
    """
    model, state, trim = trims[kind]
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


def test_level_flight_has_no_climb_and_balanced_thrust(trims):
    rates, signals = moving(*trims["level"][:2])
    np.testing.assert_allclose(
        [rates["altitude"], rates["psi"], signals["beta"], signals["phi"]], 0.0, atol=1e-12
    )
    np.testing.assert_allclose(signals["pitch"], signals["alpha"], rtol=1e-12)
    assert 0.0 < float(trims["level"].trim.value("setting")) == float(signals["thrust"])


def test_climb_has_its_climb_rate_and_the_thrust_for_it(trims):
    rates, signals = moving(*trims["climb"][:2])
    np.testing.assert_allclose(rates["altitude"], V * np.sin(0.15), rtol=1e-12)
    np.testing.assert_allclose(signals["gamma"], 0.15, rtol=1e-12)
    more = float(signals["thrust"] - trims["level"].trim.value("setting"))
    # the component of the weight along the path
    np.testing.assert_allclose(more, 17700.0 * GRAVITY * np.sin(0.15), rtol=0.05)


def test_turns_are_coordinated_with_centripetal_acceleration(trims):
    """No side force, and the acceleration over ground is centripetal, V cos(gamma) psidot."""
    for kind, gamma in (("bank", 0.0), ("rate", -0.1)):
        model, state, trim = trims[kind]
        rates, signals = moving(model, state)
        np.testing.assert_allclose(signals["ay"], 0.0, atol=1e-10)
        np.testing.assert_allclose(rates["altitude"], V * np.sin(gamma), atol=1e-10)
        turning = float(trim.value("turn_rate")) if kind == "bank" else -0.1
        np.testing.assert_allclose(rates["psi"], turning, rtol=1e-11)
        np.testing.assert_allclose(
            np.hypot(rates["north"], rates["east"]), V * np.cos(gamma), rtol=1e-12
        )
        force = np.linalg.norm([signals["ax"], signals["ay"], signals["az"]])
        np.testing.assert_allclose(
            force, np.hypot(GRAVITY, V * np.cos(gamma) * turning), rtol=1e-11
        )
    assert trims["bank"].trim.value("turn_rate") > 0.0
    assert trims["rate"].trim.value("phi") < 0.0


def test_turn_by_bank_equals_turn_by_turn_rate(aircraft, trims):
    again = turn(aircraft, V, H, bank=trims["rate"].trim.value("phi"), gamma=-0.1)
    np.testing.assert_allclose(again.trim.value("turn_rate"), -0.1, rtol=1e-10)
    np.testing.assert_allclose(again.state, trims["rate"].state, rtol=1e-8, atol=1e-10)


def test_pull_up_has_its_load_factor_and_pitch_rate(trims):
    """Three times the weight normal to the path, which rotates with the pitch rate."""
    _, signals = moving(*trims["pull-up"][:2])
    alpha = signals["alpha"]
    normal = signals["ax"] * jnp.sin(alpha) - signals["az"] * jnp.cos(alpha)
    np.testing.assert_allclose(normal, 3.0 * GRAVITY, rtol=1e-11)
    np.testing.assert_allclose(signals["q"], 2.0 * GRAVITY / V, rtol=1e-12)
    np.testing.assert_allclose([signals["phi"], signals["gamma"]], 0.0, atol=1e-12)


def test_steady_wind_adds_only_to_the_velocity_over_ground(trims):
    """The flight relative to the air is the same."""
    windy = made(wind=Wind(north=12.0, east=-7.0))
    model, state, trim = turn(windy, V, H, bank=1.0)
    np.testing.assert_allclose(trim.values, trims["bank"].trim.values, rtol=1e-10, atol=1e-12)
    rates, signals = moving(model, state)
    still, _ = moving(*trims["bank"][:2])
    np.testing.assert_allclose(signals["V"], V, rtol=1e-12)
    added = [float(rates[name] - still[name]) for name in ("north", "east", "altitude")]
    np.testing.assert_allclose(added, [12.0, -7.0, 0.0], atol=1e-9)


def test_engine_off_the_plane_of_symmetry_is_balanced():
    """By rudder and bank without sideslip, or by sideslip and rudder without side force."""
    engine = Engine(ConstantThrust(0.0), position=(0.0, 1.5, 0.0))
    banked, slipping = (level(made(engines=(engine,)), V, H, beta=beta) for beta in (0.0, None))
    assert abs(float(banked.trim.value("phi"))) > 1e-3 < abs(float(banked.trim.value("rudder")))
    assert abs(float(slipping.trim.value("beta"))) > 1e-3
    np.testing.assert_allclose(slipping.trim.value("phi"), 0.0, atol=1e-12)
    for trimmed in (banked, slipping):
        rates, _ = moving(trimmed.aircraft, trimmed.state)
        np.testing.assert_allclose([rates[name] for name in "uvwpqr"], 0.0, atol=1e-10)


def test_impossible_trim_is_refused_with_its_reason(aircraft):
    with pytest.raises(InputError) as raised:
        level(aircraft, V, H, setting_limits=(0.0, 10e3))
    text = str(raised.value)
    assert (
        "cannot be trimmed for straight flight at V = 185 m/s and an altitude of 3000 m: udot is "
        "out of balance by" in text
    )
    assert "setting stands at its upper limit, 1e+04 N" in text
    with pytest.raises(
        InputError,
        match=r"stabilator stands at its lower limit, -0.3665 rad \(-21 "
        r"deg\)",
    ):
        pull_up(aircraft, V, H, load_factor=9.0, setting_limits=(0.0, 2e6))
    with pytest.raises(InputError, match=r"The speed is 0\.0 m/s"):
        level(aircraft, 0.0, H)
    with pytest.raises(InputError, match="either its bank or its turn rate"):
        turn(aircraft, V, H)
    with pytest.raises(InputError, match="either its load factor or its pitch rate"):
        pull_up(aircraft, V, H, load_factor=2.0, pitch_rate=0.1)


def test_batch_of_speeds_fails_only_where_the_speed_is_too_low(aircraft, trims):
    batch = eqx.filter_jit(eqx.filter_vmap(lambda speed: level(aircraft, speed, H)))(
        jnp.array([30.0, V, 250.0])
    )
    np.testing.assert_array_equal(batch.trim.successful, [False, True, True])
    np.testing.assert_allclose(batch.state[1], trims["level"].state, rtol=1e-10, atol=1e-12)


def test_derivatives_of_a_trim_match_central_differences(aircraft):
    """With respect to mass and Cm.alpha; central differences with a relative step of 1e-4 are
    accurate to about 1e-8.
    """

    def parameters(model):
        frame = model.airframe
        return frame.mass_properties.mass, frame.aerodynamics.Cm.coefficients

    mass, Cm = parameters(aircraft)

    @jax.jit
    def trimmed(factors):
        scaled = (
            mass * factors[0],
            Cm * jnp.array([1.0, 0.0, 1.0, 1.0])
            + Cm * jnp.array([0.0, 1.0, 0.0, 0.0]) * factors[1],
        )
        return level(eqx.tree_at(parameters, aircraft, scaled), V, H).trim.values

    exact = jax.jit(jax.jacfwd(trimmed))(jnp.ones(2))
    for column in range(2):
        step = jnp.zeros(2).at[column].set(1e-4)
        difference = (trimmed(1.0 + step) - trimmed(1.0 - step)) / 2e-4
        np.testing.assert_allclose(exact[:, column], difference, rtol=1e-6, atol=1e-7)


def test_level_flight_has_the_five_classical_modes(trims):
    """With the classical eight states and with all states."""
    model, state, _ = trims["level"]
    linear = eqx.filter_jit(linearise_euler)(model, 0.0, state, jnp.zeros(len(model.inputs)))
    eight = modes(linear.reduced(states=CLASSICAL))
    assert {mode.name for mode in eight} == {
        "short period",
        "phugoid",
        "dutch roll",
        "roll",
        "spiral",
    }
    every = modes(linear)
    for name in ("short period", "dutch roll", "roll"):
        np.testing.assert_allclose(
            every.named(name).eigenvalue, eight.named(name).eigenvalue, rtol=1e-3
        )
    assert {mode.name for mode in every} == {mode.name for mode in eight} | {"unnamed"}
    by_difference = np.linalg.eigvals(np.asarray(linear.reduced(states=("v", "p", "r", "phi")).A))
    np.testing.assert_allclose(
        np.min(np.abs(by_difference - eight.named("dutch roll").eigenvalue)), 0.0, atol=1e-9
    )
