"""The six-degree-of-freedom model.

It is compared with conservation laws, closed forms, differentiated positions and another
integrator.
"""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_airframe import small_airframe

from jaxid import RK4, Adaptive, simulate
from jaxid._foundation.checks import InputError
from jaxid.aircraft.air.atmosphere import GRAVITY, StandardAtmosphere
from jaxid.aircraft.air.wind import Wind
from jaxid.aircraft.flight.aircraft import AFFECTED_STATES, RIGID, Aircraft
from jaxid.aircraft.instruments.instruments import Instruments
from jaxid.aircraft.physics.frames import quaternion, rotation, velocity
from jaxid.aircraft.vehicle.controls import MeasuredSurfaces
from jaxid.aircraft.vehicle.engine import ConstantThrust, Engine
from jaxid.data.signals import half_sine
from jaxid.models.names import parameter_names
from jaxid.models.polynomial import Polynomial

PRECISE = Adaptive(diffrax.Dopri8(), rtol=1e-13, atol=1e-13)
READINGS = ("alpha", "beta", "p", "q", "r", "phi", "pitch")


def glider(**changes):
    """An aircraft with surfaces as inputs, so that all states are of the rigid body."""
    parts = {"controls": MeasuredSurfaces(), "instruments": Instruments(READINGS)} | changes
    return Aircraft(
        changes.pop("airframe", small_airframe()),
        **{k: v for k, v in parts.items() if k != "airframe"},
    )


def in_flight(aircraft, V=170.0, alpha=0.2, beta=0.0, omega=(0.0, 0.0, 0.0), altitude=8000.0):
    e = quaternion(0.1, alpha, 0.4)
    place = jnp.array([0.0, 0.0, altitude])
    return aircraft.flight_state(velocity(V, alpha, beta), jnp.asarray(omega), e, place)


def histories(solution, *names):
    return [np.asarray(solution.x[:, RIGID.index(name)]) for name in names]


@pytest.fixture(scope="module")
def spinning():
    """Sixty seconds of a body without moments, with all products of inertia."""
    body = glider(
        airframe=eqx.tree_at(
            lambda frame: frame.S, small_airframe(Ixy=900.0, Iyz=-700.0), jnp.zeros(())
        )
    )
    t = jnp.linspace(0.0, 60.0, 61)
    x = in_flight(body, omega=(0.9, 0.5, -0.7))
    return body, simulate(body, t, jnp.zeros((61, 3)), x, stepper=PRECISE)


def test_torque_free_rotation_keeps_energy_and_angular_momentum(spinning):
    body, solution = spinning
    inertia = np.asarray(body.airframe.mass_properties.inertia())
    omega = np.stack(histories(solution, "p", "q", "r"), axis=1)
    momentum = np.einsum("tji,jk,tk->ti", jax.vmap(rotation)(solution.x[:, 6:10]), inertia, omega)
    energy = 0.5 * np.einsum("ti,ij,tj->t", omega, inertia, omega)
    assert (
        np.ptp(omega[:, 1]) > 1.0
    )  # it tumbles: the invariants are not constant for lack of motion
    np.testing.assert_allclose(energy, energy[0], rtol=1e-10)
    np.testing.assert_allclose(
        momentum, np.tile(momentum[0], (61, 1)), atol=1e-10 * np.linalg.norm(momentum[0])
    )


def test_quaternion_keeps_unit_norm(spinning):
    e = np.asarray(spinning[1].x[:, 6:10])
    np.testing.assert_allclose(np.sum(e**2, axis=1), 1.0, atol=1e-12)


def test_free_fall_follows_a_parabola(spinning):
    solution = spinning[1]
    t = np.asarray(solution.t)
    start = np.asarray(rotation(solution.x[0, 6:10])).T @ np.asarray(solution.x[0, :3])
    north, east, altitude = histories(solution, "north", "east", "altitude")
    scale = np.abs(altitude).max()
    np.testing.assert_allclose(north, start[0] * t, atol=1e-10 * scale)
    np.testing.assert_allclose(east, start[1] * t, atol=1e-10 * scale)
    np.testing.assert_allclose(
        altitude, 8000.0 - start[2] * t - 0.5 * GRAVITY * t**2, atol=1e-10 * scale
    )


def test_accelerometer_off_the_cg_reads_the_second_derivative_of_its_position():
    place = np.array([4.0, 1.5, -0.7])
    positions = {name: place for name in ("ax", "ay", "az")}
    aircraft = glider(instruments=Instruments(("ax", "ay", "az"), position=positions))
    t, h = 0.01 * jnp.arange(101), 0.01
    u = jnp.stack(
        [-0.08 + 0.05 * jnp.sin(3 * t), 0.05 * jnp.sin(5 * t), 0.04 * jnp.cos(4 * t)], axis=1
    )
    smooth = simulate(
        aircraft,
        t,
        u,
        in_flight(aircraft, omega=(0.5, 0.2, 0.3)),
        stepper=Adaptive(rtol=1e-12, atol=1e-12),
    )
    T = np.asarray(jax.vmap(rotation)(smooth.x[:, 6:10]))
    north, east, altitude = histories(smooth, "north", "east", "altitude")
    at = np.stack([north, east, 8000.0 - altitude], axis=1) + np.einsum("tji,j->ti", T, place)
    weights = np.array([1 / 90, -3 / 20, 3 / 2, -49 / 18, 3 / 2, -3 / 20, 1 / 90])
    second = np.stack([np.convolve(at[:, i], weights, "valid") for i in range(3)], axis=1) / h**2
    expected = np.einsum("tij,tj->ti", T[3:-3], second - np.array([0.0, 0.0, GRAVITY]))
    # At corners of the inputs the sixth-order formula has an error of the jump of the third
    # derivative times h: 1e-3 of 10 m/s^2.
    np.testing.assert_allclose(smooth.y[3:-3], expected, atol=2e-3 * np.abs(expected).max())


def test_fixed_steps_match_adaptive_steps():
    aircraft = Aircraft(small_airframe(), instruments=Instruments(READINGS))
    t = 0.05 * jnp.arange(101)
    u = jnp.stack(
        [half_sine(t, 0.0, 2.0, -0.03), half_sine(t, 1.0, 2.0, 0.05), half_sine(t, 0.5, 2.0, 0.05)],
        axis=1,
    )
    x = in_flight(aircraft)
    fixed = simulate(aircraft, t, u, x, stepper=RK4(20, unrolled=False))
    exact = simulate(aircraft, t, u, x, stepper=Adaptive(diffrax.Dopri8(), rtol=1e-12, atol=1e-12))
    assert np.ptp(np.asarray(exact.y[:, 2])) > 0.1
    scale = np.abs(np.asarray(exact.x)).max(axis=0) + 1e-12
    np.testing.assert_allclose(np.asarray(fixed.x) / scale, np.asarray(exact.x) / scale, atol=1e-8)


def test_offset_thrust_and_rotors_give_the_expected_moments():
    aircraft = glider(
        airframe=eqx.tree_at(lambda frame: frame.S, small_airframe(), jnp.zeros(())),
        engines=(
            Engine(
                ConstantThrust(4e4), position=(0.0, 2.0, 0.5), share=0.5, momentum=300.0, up=0.05
            ),
            Engine(ConstantThrust(4e4), position=(0.0, -2.0, 0.5), right=0.02),
        ),
    )
    omega = np.array([0.1, 0.2, -0.3])
    x = in_flight(aircraft, omega=omega)
    rates = np.asarray(aircraft.rhs(jnp.zeros(()), x, jnp.zeros(3)))[:6]
    first, second = (
        2e4 * np.array([np.cos(0.05), 0.0, -np.sin(0.05)]),
        4e4 * np.array([np.cos(0.02), np.sin(0.02), 0.0]),
    )
    h = 300.0 * np.array([np.cos(0.05), 0.0, -np.sin(0.05)])
    moment = np.cross([0.0, 2.0, 0.5], first) + np.cross([0.0, -2.0, 0.5], second)
    mass, inertia = (
        aircraft.airframe.mass_properties,
        np.asarray(aircraft.airframe.mass_properties.inertia()),
    )
    gravity = GRAVITY * np.asarray(rotation(x[6:10]))[:, 2]
    expected = (first + second) / float(mass.mass) + gravity - np.cross(omega, np.asarray(x[:3]))
    np.testing.assert_allclose(rates[:3], expected, rtol=1e-12)
    expected = np.linalg.solve(inertia, moment - np.cross(omega, inertia @ omega + h))
    np.testing.assert_allclose(rates[3:], expected, rtol=1e-10)


def test_coefficients_act_at_the_reference_point():
    frame = eqx.tree_at(lambda f: f.reference, small_airframe(), jnp.array([0.4, 0.1, -0.2]))
    there, here = glider(airframe=frame), glider()
    x, u = in_flight(here, beta=0.05), jnp.array([-0.05, 0.02, 0.01])
    signals = here.signals(jnp.zeros(()), x, u)
    force = np.asarray(signals["qbar"] * frame.S) * np.array(
        [signals[name] for name in ("CX", "CY", "CZ")]
    )
    difference = np.asarray(there.rhs(jnp.zeros(()), x, u) - here.rhs(jnp.zeros(()), x, u))
    inertia = np.asarray(frame.mass_properties.inertia())
    np.testing.assert_allclose(
        inertia @ difference[3:6], np.cross([0.4, 0.1, -0.2], force), rtol=1e-10
    )
    np.testing.assert_allclose(difference[:3], 0.0, atol=1e-14)


def test_steady_wind_changes_ground_velocity_and_not_the_forces():
    still, windy = glider(), glider(wind=Wind(north=10.0, east=-5.0))
    x = in_flight(still)
    T = np.asarray(rotation(x[6:10]))
    drifting = x.at[:3].add(jnp.asarray(T @ np.array([10.0, -5.0, 0.0])))
    calm, drift = (
        m.signals(jnp.zeros(()), y, jnp.zeros(3)) for m, y in ((still, x), (windy, drifting))
    )
    for name in ("alpha", "beta", "V", "ax", "ay", "az", "qdot"):
        np.testing.assert_allclose(calm[name], drift[name], rtol=1e-11, atol=1e-12)
    over_ground = windy.rhs(jnp.zeros(()), drifting, jnp.zeros(3)) - still.rhs(
        jnp.zeros(()), x, jnp.zeros(3)
    )
    np.testing.assert_allclose(over_ground[10:12], [10.0, -5.0], rtol=1e-12)


def test_gusts_change_velocity_and_rotation_relative_to_the_air():
    with_disturbance_inputs = glider().disturbed("gust_w", "gust_q", "buffet")
    assert with_disturbance_inputs.inputs[3:] == ("gust_w", "gust_q", "buffet")
    x = in_flight(with_disturbance_inputs)
    calm = with_disturbance_inputs.signals(jnp.zeros(()), x, jnp.zeros(6))
    blown = with_disturbance_inputs.signals(
        jnp.zeros(()), x, jnp.zeros(6).at[3].set(-5.0).at[4].set(0.1)
    )
    np.testing.assert_allclose(blown["w_air"] - calm["w_air"], 5.0, rtol=1e-12)
    frame = with_disturbance_inputs.airframe
    np.testing.assert_allclose(blown["qhat"], -0.1 * frame.cbar / (2 * blown["V"]), rtol=1e-12)
    assert float(blown["q"]) == float(calm["q"])


def test_initial_state_follows_from_the_first_valid_samples():
    from jaxid import record

    aircraft = glider(
        instruments=Instruments(
            ("V", "alpha", "beta", "p", "q", "r", "phi", "pitch", "psi", "altitude")
        )
    )
    x = in_flight(
        aircraft, V=150.0, alpha=0.15, beta=0.03, omega=(0.1, -0.05, 0.02), altitude=6000.0
    )
    y = aircraft.output(jnp.zeros(()), x, jnp.zeros(3))
    z = np.tile(np.asarray(y), (3, 1))
    z[0, 1] = np.nan
    made = record(
        np.arange(3.0), np.zeros((3, 3)), z, inputs=aircraft.inputs, outputs=aircraft.outputs
    )
    np.testing.assert_allclose(aircraft.initial_state(made), x, rtol=1e-9, atol=1e-9)


def test_density_follows_altitude():
    aircraft = glider()
    low, high = (
        aircraft.signals(jnp.zeros(()), in_flight(aircraft, altitude=h), jnp.zeros(3))
        for h in (0.0, 9000.0)
    )
    air = StandardAtmosphere().air(jnp.array(9000.0))
    np.testing.assert_allclose(high["qbar"], 0.5 * air.density * 170.0**2, rtol=1e-12)
    assert float(low["mach"]) < float(high["mach"])


def test_coefficient_derivatives_in_signals_match_differences():
    frame = eqx.tree_at(
        lambda f: f.reference,
        small_airframe(Ixy=900.0, Iyz=-700.0),
        jnp.array([0.4, 0.1, -0.2]),
    )
    aircraft = glider(airframe=frame)
    x, u = in_flight(aircraft, beta=0.05), jnp.array([-0.05, 0.02, 0.01])
    signals = aircraft.signals(jnp.zeros(()), x, u)
    for coefficient, affected in AFFECTED_STATES.items():
        terms = getattr(frame.aerodynamics, coefficient)
        more = eqx.tree_at(
            lambda a, k=coefficient: getattr(a.airframe.aerodynamics, k), aircraft, plus_one(terms)
        )
        difference = np.asarray(more.rhs(jnp.zeros(()), x, u) - aircraft.rhs(jnp.zeros(()), x, u))
        for state in ("u", "v", "w", "p", "q", "r"):
            expected = float(signals[f"{state}_per_{coefficient}"]) if state in affected else 0.0
            np.testing.assert_allclose(
                difference[RIGID.index(state)], expected, rtol=1e-9, atol=1e-9
            )


def plus_one(polynomial):
    """The polynomial plus one."""
    terms = dict(zip(polynomial.terms, map(float, polynomial.coefficients), strict=True))
    return Polynomial(terms | {"1": 1.0 + terms.get("1", 0.0)})


def test_every_number_has_a_parameter_name():
    names = parameter_names(Aircraft(small_airframe()))
    assert {
        "mass",
        "Cm.alpha",
        "controls.augmentation.yaw_gain",
        "instruments.bias.q",
        "engines.0.position.y",
        "wind.north",
        "buffet.intensity",
    } <= set(names)


def test_unknown_disturbance_and_missing_engine_are_refused():
    with pytest.raises(InputError, match=r"no disturbance 'gust_x'.*gust_u"):
        glider(disturbances=("gust_x",))
    with pytest.raises(InputError, match="at least one engine"):
        glider(engines=())
