"""`simulate_flight`: equations of motion of the truth, the record, and refused input."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft.air.atmosphere import GRAVITY
from jaxid.aircraft.airframes import f4
from jaxid.aircraft.flight.aircraft import Aircraft
from jaxid.aircraft.flight.report_cases import CASES, initial_condition, pilot_inputs
from jaxid.aircraft.flight.simulate_flight import flight_solution, simulate_flight
from jaxid.aircraft.physics.frames import quaternion, velocity
from jaxid.aircraft.vehicle.aerodynamics import COEFFICIENTS

pytestmark = pytest.mark.filterwarnings("ignore:Flight .* outside 5 to 21 deg")
CASE = CASES["coupled 2"]  # motion in six degrees of freedom


@pytest.fixture(scope="module")
def prepared():
    aircraft, state = initial_condition(CASE)
    t, inputs = pilot_inputs(CASE)
    return aircraft, t, inputs, state


@pytest.fixture(scope="module")
def flight(prepared):
    return simulate_flight(*prepared, key=jax.random.key(0), name="one")


@pytest.fixture(scope="module")
def truth(flight):
    return {name: np.asarray(flight.truth.channel(name)) for name in flight.truth.outputs}


def test_forces_equal_mass_times_specific_force(flight, truth):
    frame = flight.aircraft.airframe
    pressed = truth["qbar"] * float(frame.S) / float(frame.mass_properties.mass)
    push = truth["thrust"] / float(frame.mass_properties.mass)
    for name, coefficient, engine in (("ax", "CX", push), ("ay", "CY", 0.0), ("az", "CZ", 0.0)):
        np.testing.assert_allclose(
            truth[name], pressed * truth[coefficient] + engine, rtol=1e-12, atol=1e-12
        )


def test_moments_equal_the_rate_of_angular_momentum(flight, truth):
    frame = flight.aircraft.airframe
    inertia = np.asarray(frame.mass_properties.inertia())
    omega = np.stack([truth[i] for i in "pqr"], axis=1)
    omegadot = np.stack([truth[i + "dot"] for i in "pqr"], axis=1)
    arms = np.array([float(frame.b), float(frame.cbar), float(frame.b)])
    moment = (
        (truth["qbar"] * float(frame.S))[:, None]
        * arms
        * np.stack([truth[c] for c in ("Cl", "Cm", "Cn")], axis=1)
    )
    np.testing.assert_allclose(
        moment, omegadot @ inertia + np.cross(omega, omega @ inertia), rtol=1e-9, atol=1e-6
    )


def test_rates_of_the_motion_equal_the_accelerations(truth):
    """Central differences of sixth order over samples of 0.1 s, away from the edges of the pilot's
    pulses.
    """

    def slope(signal):
        weights = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 6.0  # per second
        return np.convolve(signal, weights[::-1], mode="valid")

    t, smooth = 0.1 * np.arange(100)[3:-3], np.ones(94, bool)
    for edge in (0.0, 0.5, 2.0, 3.5, 4.0, 6.0):
        smooth &= ~((t > edge - 0.35) & (t < edge + 1.0))
    assert np.sum(smooth) > 25
    udot = (
        truth["ax"]
        - GRAVITY * np.sin(truth["pitch"])
        - truth["q"] * truth["w"]
        + truth["r"] * truth["v"]
    )
    for motion, rate in (("u", udot), *((i, truth[i + "dot"]) for i in "pqr")):
        expected = rate[3:-3][smooth]
        np.testing.assert_allclose(
            slope(truth[motion])[smooth], expected, atol=5e-3 * np.max(np.abs(rate))
        )


def test_true_coefficients_equal_those_of_the_airframe(flight, truth):
    frame = flight.aircraft.airframe
    names = ("alpha", "beta", "V", "mach", "qbar", "stabilator", "aileron", "rudder")
    signals = {name: jnp.asarray(truth[name]) for name in names}
    for rate, length in (("p", frame.b), ("q", frame.cbar), ("r", frame.b)):
        signals[f"{rate}hat"] = jnp.asarray(truth[rate]) * length / (2.0 * signals["V"])
    expected = jax.jit(jax.vmap(frame.aerodynamics.coefficients))(signals)
    actual = np.stack([truth[name] for name in COEFFICIENTS], axis=1)
    np.testing.assert_allclose(actual, expected, rtol=1e-10, atol=1e-12)


def test_record_and_truth_have_names_and_si_units(flight):
    assert flight.record.names == flight.truth.names == ("one",)
    assert flight.record.inputs == ("pilot_stabilator", "pilot_aileron", "pilot_rudder")
    assert flight.record.outputs == flight.aircraft.instruments.channels
    units = dict(zip(flight.truth.outputs, flight.truth.output_units, strict=True))
    assert (units["alpha"], units["V"], units["thrust"], units["Cm"]) == ("rad", "m/s", "N", "")


def test_missing_inputs_are_zero_and_disturbances_are_accepted(prepared):
    aircraft, t, _, state = prepared
    gust = jnp.where(t > 0.05, 3.0, 0.0)
    result = simulate_flight(
        aircraft, t, {"gust_v": 0.0 * gust, "gust_w": gust}, state, key=jax.random.key(0)
    )
    assert result.aircraft.disturbances == ("gust_v", "gust_w")
    assert result.record.inputs == ("pilot_stabilator", "pilot_aileron", "pilot_rudder")
    assert not np.any(result.record.u)
    np.testing.assert_array_equal(result.truth.channel("true_gust_w"), gust)
    # alpha is relative to the air: with a gust of 3 m/s it is atan2(w - 3, u) at the first sample
    # with the gust
    u, w = (float(result.truth.channel(name)[1]) for name in "uw")
    assert float(result.truth.channel("alpha")[1]) == pytest.approx(
        np.arctan2(w - 3.0, u), rel=1e-12
    )


def test_flight_solution_equals_the_flight_in_a_batch_over_keys(prepared, flight):
    aircraft, t, inputs, state = prepared
    u = jnp.stack([inputs[name] for name in aircraft.inputs], axis=-1)
    keys = jnp.stack([jax.random.key(0), jax.random.key(1)])
    batch = jax.jit(jax.vmap(lambda key: flight_solution(aircraft, t, u, state, key)))(keys)
    np.testing.assert_allclose(batch.z[0], flight.record.z, rtol=1e-8, atol=1e-8)
    assert batch.z.shape == (2, *flight.record.z.shape)


@pytest.mark.parametrize(
    ("inputs", "words"),
    [
        ({"pilot_elevator": 100}, r"no input 'pilot_elevator'.*pilot_stabilator"),
        ({"gust_x": 100}, r"no input 'gust_x'.*gust_u"),
        (
            {"pilot_rudder": 99},
            r"'pilot_rudder' has shape \(99,\) for 100 sample times. Give one "
            r"value for each",
        ),
    ],
)
def test_unknown_input_and_wrong_length_are_refused(prepared, inputs, words):
    aircraft, t, _, state = prepared
    with pytest.raises(InputError, match=words):
        simulate_flight(
            aircraft,
            t,
            {name: np.zeros(size) for name, size in inputs.items()},
            state,
            key=jax.random.key(0),
        )


@pytest.fixture(scope="module")
def refusing(prepared):
    aircraft = prepared[0]
    return eqx.tree_at(lambda a: a.airframe, aircraft, f4(extrapolation="refuse"))


def test_flight_that_leaves_tables_without_extrapolation_is_refused(prepared, refusing):
    """The error names the first sample outside, known from the same flight with tables held at
    their edges.
    """
    aircraft, t, _, _ = prepared
    alpha, beta = np.radians(26.0), np.radians(20.0)
    place = jnp.array([0.0, 0.0, 1e4])
    state = refusing.flight_state(
        velocity(140.0, alpha, beta), jnp.zeros(3), quaternion(0.0, alpha, 0.0), place
    )
    inputs = {"pilot_rudder": jnp.full(t.size, -0.5)}
    held = np.degrees(
        simulate_flight(aircraft, t, inputs, state, key=jax.random.key(0)).truth.channel("alpha")
    )
    row = int(np.argmax(held < -10.0))
    assert row > 2
    words = (
        rf"Flight 'spin': alpha is -1\d.* deg at t = {t[row]:g} s, and a table of f4 .* covers -10 "
        r"to 110 deg.*'linear'"
    )
    with pytest.raises(InputError, match=words):
        simulate_flight(refusing, t, inputs, state, key=jax.random.key(0), name="spin")


def test_flight_that_starts_outside_the_tables_is_refused(prepared, refusing):
    _, t, _, _ = prepared
    state = refusing.flight_state(
        velocity(140.0, np.radians(-15.0), 0.0),
        jnp.zeros(3),
        quaternion(0.0, 0.0, 0.0),
        jnp.array([0.0, 0.0, 1e4]),
    )
    with pytest.raises(InputError, match=r"alpha is -15 deg at t = 0 s.*covers -10 to 110 deg"):
        simulate_flight(refusing, t, {}, state, key=jax.random.key(0))


def test_flight_that_diverges_inside_the_tables_is_refused(prepared):
    aircraft, t, inputs, state = prepared
    broken = eqx.tree_at(lambda a: a.airframe.cbar, aircraft, jnp.asarray(jnp.nan))
    with pytest.raises(InputError, match=r"flight 'broken' stops being finite at t = 0.1 s, in"):
        simulate_flight(broken, t, inputs, state, key=jax.random.key(0), name="broken")


def test_aircraft_with_default_options_is_simulated(prepared):
    """Default options: no thrust, no trim; the pilot's inputs may be NumPy arrays."""
    _, t, _, state = prepared
    plain = Aircraft(f4())
    result = simulate_flight(
        plain,
        np.asarray(t),
        {"pilot_stabilator": np.full(t.size, -0.08)},
        state,
        key=jax.random.key(0),
    )
    assert result.record.t.size == t.size
    assert np.all(np.asarray(result.truth.channel("thrust")) == 0.0)
