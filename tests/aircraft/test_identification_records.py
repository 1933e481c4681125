"""What an identification model takes from a record: coefficients, histories, a first state, constants; and what it refuses."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from identified_flight import CHANNELS, TEN, TEN_IN_AIR, flown, true_histories
from small_airframe import small_airframe

from jaxid._foundation.checks import InputError
from jaxid.aircraft import (
    COEFFICIENTS,
    TABLE_6_1,
    Aircraft,
    ControlSystem,
    IdentificationModel,
    Instruments,
    extended,
    f16_engine,
    flight_record,
    fly,
    from_aircraft,
    standard_actuators,
)
from jaxid.aircraft.frames import quaternion, velocity
from jaxid.data.build import record as make_record
from jaxid.data.stack import stack

T = jnp.zeros(())


@pytest.fixture(scope="module")
def flight():
    return flown()


@pytest.fixture(scope="module")
def record(flight):
    return flight_record(flight)


def channels(record, keep=None, constants=None, **changed):
    """The record with some of its outputs only, or with other values in some channels."""
    outputs = record.outputs if keep is None else keep
    values = {name: record.channel(name) for name in (*record.inputs, *outputs)} | changed
    u = jnp.stack([values[name] for name in record.inputs], axis=-1)
    z = jnp.stack([values[name] for name in outputs], axis=-1)
    units = dict(zip((*record.inputs, *record.outputs), (*record.input_units, *record.output_units), strict=True))
    units = {name: unit for name, unit in units.items() if name in (*record.inputs, *outputs)}
    return make_record(
        record.t, u, z, inputs=record.inputs, outputs=outputs, units=units, name="part", constants=constants or {}
    )


def without(names):
    return tuple(name for name in CHANNELS if name not in names)


# Coefficients -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("states", ["coupled", TEN])
def test_pseudo_measurements_are_the_true_coefficients(flight, record, states):
    """Accelerometers and vanes off the c.g., axes askew, known scales and biases, products of inertia, a reference point off
    the c.g., engines with momentum: exact but for rounding."""
    model = from_aircraft(flight.aircraft, states=states)
    found = model.pseudo_measurements(record)
    assert tuple(found.responses) == COEFFICIENTS
    assert bool(jnp.all(found.valid))
    for name, value in (found.responses | found.signals).items():
        if name in flight.truth.outputs:
            true = np.asarray(flight.truth.channel(name))
            np.testing.assert_allclose(value, true, atol=1e-9 * np.max(np.abs(true)), rtol=0.0)
    np.testing.assert_allclose(found.signals["qhat"], found.signals["q"] * 4.889 / 2 / found.signals["V"], rtol=1e-14)
    assert dict(found.candidates) == TABLE_6_1
    assert found.centred == ("alpha", "beta")


def test_only_equations_that_are_propagated_are_explained(flight, record):
    model = from_aircraft(flight.aircraft, states="longitudinal", candidates=extended({"Cm": ("|alpha| qhat",)}))
    found = model.pseudo_measurements(record)
    assert tuple(found.responses) == ("CX", "CZ", "Cm")
    assert dict(found.candidates)["Cm"][-1] == "|alpha| qhat"
    air = from_aircraft(flight.aircraft, states="lateral", frame="air path").pseudo_measurements(record)
    assert tuple(air.responses) == ("CY", "Cl", "Cn")


def test_measured_thrust_is_shared_by_the_engines_and_taken_off(flight, record):
    with_thrust = flight_record(flight, also=("altitude", "thrust"))
    assert with_thrust.inputs[3:] == ("thrust",)  # the altitude is among the outputs already
    model = from_aircraft(flight.aircraft, measured=("thrust",))
    shares = jnp.array([22000.0, 20000.0])
    engines = tuple(
        eqx.tree_at(lambda e: e.share, engine, share) for engine, share in zip(model.engines, shares, strict=True)
    )
    model = eqx.tree_at(lambda m: m.engines, model, engines)
    found = model.pseudo_measurements(with_thrust).responses
    for name in COEFFICIENTS:
        true = np.asarray(flight.truth.channel(name))
        np.testing.assert_allclose(found[name], true, atol=1e-9 * np.max(np.abs(true)), rtol=0.0)


def test_a_gap_is_not_valid_and_spoils_nothing_else(flight, record):
    model = from_aircraft(flight.aircraft)
    holed = channels(
        record, az=record.channel("az").at[7].set(jnp.nan), alpha=record.channel("alpha").at[9].set(jnp.nan)
    )
    found, whole = model.pseudo_measurements(holed), model.pseudo_measurements(record)
    assert np.flatnonzero(~np.asarray(found.valid)).tolist() == [7, 9]
    kept = np.asarray(found.valid)
    for name in COEFFICIENTS:
        np.testing.assert_array_equal(np.asarray(found.responses[name])[kept], np.asarray(whole.responses[name])[kept])
    assert all(bool(jnp.all(jnp.isfinite(value))) for value in (found.responses | found.signals).values())


def test_the_candidates_are_as_many_as_the_report_counts():
    assert {name: len(terms) for name, terms in TABLE_6_1.items()} == {
        **dict.fromkeys(("CX", "CZ", "Cm"), 22),
        **dict.fromkeys(("CY", "Cl", "Cn"), 26),
    }
    assert all(len(set(terms)) == len(terms) for terms in TABLE_6_1.values())
    more = extended({"Cm": ("alpha stabilator", "qhat")}, {"Cn": ("|beta| beta",)})
    assert more["Cm"] == (*TABLE_6_1["Cm"], "alpha stabilator")
    assert more["Cn"][-1] == "|beta| beta"
    with pytest.raises(InputError, match="coefficient 'CD'"):
        extended({"CD": ("alpha",)})


# Histories and states -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("frame", ["body", "air path"])
def test_histories_that_stand_in_for_states_are_the_true_ones(flight, record, frame):
    """Exact for vanes anywhere, though no correction of App. D is."""
    model = from_aircraft(flight.aircraft, states=("psi",), frame=frame, measured=("altitude", "pdot", "qdot", "rdot"))
    prepared = model.prepared(record)
    assert prepared.inputs == model.inputs
    assert prepared.outputs == ("psi",)
    _, u = true_histories(model, flight)
    np.testing.assert_allclose(prepared.u, u, rtol=0.0, atol=1e-10 * np.max(np.abs(u), axis=0, keepdims=True).max())
    np.testing.assert_array_equal(prepared.z[:, 0], record.channel("psi"))
    again = model.prepared(prepared)
    np.testing.assert_array_equal(again.u, prepared.u)


def test_the_first_state_is_brought_to_the_centre_of_gravity(flight, record):
    for states, frame in ((TEN, "body"), (TEN_IN_AIR, "air path"), ("longitudinal", "body"), ("lateral", "air path")):
        model = from_aircraft(flight.aircraft, states=states, frame=frame)
        x, _ = true_histories(model, flight)
        np.testing.assert_allclose(model.initial_state(model.prepared(record)), x[0], rtol=1e-9, atol=1e-10)


def test_what_is_not_measured_starts_at_zero_or_at_a_constant(flight):
    model = IdentificationModel(small_airframe(), held={"altitude": 9000.0}, instruments=Instruments(("q", "pitch")))
    t, z = 0.1 * jnp.arange(4), jnp.zeros((4, 2)) + 0.1
    made = make_record(t, jnp.zeros((4, 3)), z, inputs=model.inputs, outputs=("q", "pitch"), constants={"phi": 0.4})
    state = dict(zip(model.states, model.initial_state(made), strict=True))
    weight = model.airframe.mass_properties.mass * 9.80665
    V = np.sqrt(2.0 * weight / (float(model.atmosphere.air(jnp.array(9000.0)).density) * 49.2))
    assert {name: round(float(value), 9) for name, value in state.items() if name != "u"} == {
        **dict.fromkeys(("v", "w", "p", "r", "psi"), 0.0),
        **{"q": 0.1, "pitch": 0.1, "phi": 0.4},
    }
    np.testing.assert_allclose(state["u"], V)


def test_true_airspeed_and_sideslip_are_shown_and_undone():
    """A record of corrected air data: V is the speed itself and beta asin(v/V), with known errors of scale and bias."""
    instruments = Instruments(CHANNELS, bias={"V": 2.0, "beta": 0.01}, scale={"beta": 0.05})
    model = IdentificationModel(
        small_airframe(), held={"altitude": 9000.0}, instruments=instruments, airspeed="true", beta="sideslip"
    )
    x = jnp.array([150.0, 12.0, 40.0, 0.1, 0.05, -0.1, 0.1, 0.2, 0.3])
    shown = dict(zip(model.outputs, eqx.filter_jit(model.output)(T, x, jnp.zeros(3)), strict=True))
    V = np.linalg.norm(x[:3])
    np.testing.assert_allclose(shown["V"], V + 2.0, rtol=1e-14)
    np.testing.assert_allclose(shown["beta"], 1.05 * np.arcsin(12.0 / V) + 0.01, rtol=1e-14)
    z = jnp.tile(jnp.stack(list(shown.values()))[None], (3, 1))
    made = make_record(jnp.arange(3.0), jnp.zeros((3, 3)), z, inputs=model.inputs, outputs=model.outputs)
    np.testing.assert_allclose(model.initial_state(made), x, rtol=1e-12)


def test_a_constant_of_the_record_takes_the_place_of_the_models(flight, record):
    """Altitude and density of one record: what it says of them is what counts, in pseudo-measurements too."""
    model = from_aircraft(flight.aircraft, held={"altitude": 0.0, "density": 1.225}, airspeed="true")
    part = without(("altitude",))
    plain = model.pseudo_measurements(channels(record, part))
    thin = model.pseudo_measurements(channels(record, part, constants={"density": 0.6125}))
    np.testing.assert_allclose(thin.responses["CZ"], 2.0 * plain.responses["CZ"], rtol=1e-12)
    np.testing.assert_allclose(thin.signals["density"], 0.6125)


def test_longitudinal_records_do_without_lateral_channels(flight, record):
    """What is held is not asked for: only the longitudinal instruments are on board."""
    own = ("alpha", "V", "q", "pitch", "ax", "az", "qdot", "altitude")
    held = dict.fromkeys(("v", "p", "r", "phi", "aileron", "rudder"), 0.0)
    model = from_aircraft(flight.aircraft, states="longitudinal", held=held)
    model = eqx.tree_at(lambda m: m.airframe.reference, model, jnp.zeros(3))
    prepared = model.prepared(channels(record, own))
    assert prepared.inputs == ("stabilator", "altitude")
    found = model.pseudo_measurements(channels(record, own))
    assert bool(jnp.all(found.valid))
    with pytest.raises(InputError, match="needs 'ay'"):  # with a reference point off the c.g. every force makes moments
        from_aircraft(flight.aircraft, states="longitudinal", held=held).pseudo_measurements(channels(record, own))


# Flights ------------------------------------------------------------------------------------------------------------


def test_the_record_of_a_flight_has_measured_surfaces(flight, record):
    assert record.inputs == ("stabilator", "aileron", "rudder")
    assert record.outputs == CHANNELS
    assert record.input_units == ("rad",) * 3
    np.testing.assert_array_equal(record.channel("rudder"), flight.truth.channel("rudder"))
    with pytest.raises(InputError, match="channel of the truth 'fuel'"):
        flight_record(flight, also=("fuel",))


def test_recorded_surfaces_are_taken_as_recorded_less_their_known_errors():
    """A turbofan too: its thrust is measured, as the model does not propagate the engine."""
    instruments = Instruments(("alpha", "beta", "V", "p", "q", "r", "stabilator"), bias={"stabilator": 0.01})
    frame = small_airframe()
    controls = ControlSystem(standard_actuators(frame.limits), trim={"stabilator": -0.05})
    aircraft = Aircraft(frame, engines=(f16_engine(),), controls=controls, instruments=instruments)
    state = aircraft.flight_state(
        velocity(170.0, 0.1, 0.0), jnp.zeros(3), quaternion(0.0, 0.1, 0.0), jnp.array([0.0, 0.0, 9000.0])
    )
    t = 0.1 * jnp.arange(4)
    flight = fly(aircraft, t, {}, state, key=jax.random.key(1))
    record = flight_record(flight)
    assert record.inputs == ("aileron", "rudder", "altitude", "thrust")
    model = from_aircraft(flight.aircraft, states=("u", "v", "w", "p", "q", "r"), held={"phi": 0.0, "pitch": 0.1})
    prepared = model.prepared(record)
    assert prepared.inputs == ("stabilator", "aileron", "rudder", "thrust", "altitude")
    np.testing.assert_allclose(prepared.channel("stabilator"), -0.05, rtol=1e-12)
    with pytest.raises(InputError, match="has states of its own"):
        IdentificationModel(small_airframe(), engines=(f16_engine(),), held={"altitude": 0.0})


# Bad input ----------------------------------------------------------------------------------------------------------


def test_a_record_that_lacks_a_channel_says_which_and_what_to_do(flight, record):
    model = from_aircraft(flight.aircraft)
    with pytest.raises(InputError, match=r"needs 'qdot'.*Derive it from the rate.*differentiate"):
        model.pseudo_measurements(channels(record, without(("qdot",))))
    with pytest.raises(InputError, match=r"needs 'w'.*follows from V, alpha and beta"):
        model.pseudo_measurements(channels(record, without(("alpha",))))
    with pytest.raises(InputError, match="needs 'ay'"):
        model.pseudo_measurements(channels(record, without(("ay",))))
    with pytest.raises(InputError, match="needs 'altitude' as an input"):
        model.prepared(channels(record, without(("altitude",))))
    with pytest.raises(InputError, match=r"channel .needed as output. 'psi'"):
        model.prepared(channels(record, without(("psi",))))
    lateral = from_aircraft(flight.aircraft, states="lateral")
    with pytest.raises(InputError, match=r"needs 'u' as an input, which follows from V, alpha and beta"):
        lateral.prepared(channels(record, without(("V",))))


def test_a_gap_in_a_history_is_refused_and_one_in_an_output_is_not(flight, record):
    lateral = from_aircraft(flight.aircraft, states="lateral")
    with pytest.raises(InputError, match=r"takes 'u' as an input, and 1 of its samples are missing"):
        lateral.prepared(channels(record, V=record.channel("V").at[5].set(jnp.nan)))
    coupled = from_aircraft(flight.aircraft)
    prepared = coupled.prepared(channels(record, V=record.channel("V").at[5].set(jnp.nan)))
    assert int(jnp.sum(~prepared.mask)) == 1


def test_records_come_one_by_one(flight, record):
    with pytest.raises(InputError, match="one by one"):
        from_aircraft(flight.aircraft).prepared(stack([record, record]))
