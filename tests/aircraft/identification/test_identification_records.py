"""Records of an identification model: coefficients, histories, first state, constants."""

import ast

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
    AerodynamicsWithIncrements,
    Aircraft,
    ControlSystem,
    IdentificationModel,
    Instruments,
    PolynomialAerodynamics,
    extended,
    f16_engine,
    flight_record,
    from_aircraft,
    standard_actuators,
)
from jaxid.aircraft.air.atmosphere import StandardAtmosphere
from jaxid.aircraft.flight.simulate_flight import simulate_flight
from jaxid.aircraft.instruments.geometry import vector
from jaxid.aircraft.instruments.inverse import motion
from jaxid.aircraft.physics.frames import air_angles, quaternion, velocity
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
    """The record with a selection of its outputs, or with changed values in some channels."""
    outputs = record.outputs if keep is None else keep
    values = {name: record.channel(name) for name in (*record.inputs, *outputs)} | changed
    u = jnp.stack([values[name] for name in record.inputs], axis=-1)
    z = jnp.stack([values[name] for name in outputs], axis=-1)
    units = dict(
        zip(
            (*record.inputs, *record.outputs),
            (*record.input_units, *record.output_units),
            strict=True,
        )
    )
    units = {name: unit for name, unit in units.items() if name in (*record.inputs, *outputs)}
    return make_record(
        record.t,
        u,
        z,
        inputs=record.inputs,
        outputs=outputs,
        units=units,
        name="part",
        constants=constants or {},
    )


def without(names):
    return tuple(name for name in CHANNELS if name not in names)


# Coefficients -------------------------------------------------------------------------------------


@pytest.mark.parametrize("states", ["coupled", TEN])
def test_pseudo_measurements_equal_the_true_coefficients(flight, record, states):
    """Accelerometers and vanes off the c.g., misaligned axes, known scales and biases, products of
    inertia, a reference point off the c.g., engines with momentum: exact to rounding.
    """
    model = from_aircraft(flight.aircraft, states=states)
    result = model.pseudo_measurements(record)
    assert tuple(result.responses) == COEFFICIENTS
    assert bool(jnp.all(result.valid))
    for name, value in (result.responses | result.signals).items():
        if name in flight.truth.outputs:
            true = np.asarray(flight.truth.channel(name))
            np.testing.assert_allclose(value, true, atol=1e-9 * np.max(np.abs(true)), rtol=0.0)
    np.testing.assert_allclose(
        result.signals["qhat"], result.signals["q"] * 4.889 / 2 / result.signals["V"], rtol=1e-14
    )
    assert dict(result.candidates) == TABLE_6_1
    assert result.centred == ("alpha", "beta")


def test_tables_are_the_known_part_of_the_coefficients(flight, record):
    """With the true coefficients as the baseline, nothing is left for the increments, pointwise and
    in weak form.
    """
    known = AerodynamicsWithIncrements(
        flight.aircraft.airframe.aerodynamics, PolynomialAerodynamics({})
    )
    model = eqx.tree_at(
        lambda one: one.airframe.aerodynamics, from_aircraft(flight.aircraft), known
    )
    measured = model.pseudo_measurements(record)
    for name in COEFFICIENTS:
        size = np.max(np.abs(measured.responses[name]))
        np.testing.assert_allclose(measured.unknown(name), 0.0, atol=1e-9 * size)
    plain = from_aircraft(flight.aircraft).weak_measurements(record)
    rest = model.weak_measurements(record)
    for name in COEFFICIENTS:
        expected = plain.parts[name][0] - plain.multipliers[name] * measured.known[name]
        size = np.max(np.abs(plain.parts[name][0]))
        np.testing.assert_allclose(rest.parts[name][0], expected, atol=1e-12 * size)


def test_pseudo_measurements_are_of_the_propagated_equations_only(flight, record):
    model = from_aircraft(
        flight.aircraft, states="longitudinal", candidates=extended({"Cm": ("|alpha| qhat",)})
    )
    result = model.pseudo_measurements(record)
    assert tuple(result.responses) == ("CX", "CZ", "Cm")
    assert dict(result.candidates)["Cm"][-1] == "|alpha| qhat"
    air = from_aircraft(flight.aircraft, states="lateral", frame="air path").pseudo_measurements(
        record
    )
    assert tuple(air.responses) == ("CY", "Cl", "Cn")


def test_measured_thrust_is_shared_by_the_engines(flight, record):
    with_thrust = flight_record(flight, also=("altitude", "thrust"))
    assert with_thrust.inputs[3:] == ("thrust",)  # the altitude is already among the outputs
    model = from_aircraft(flight.aircraft, measured=("thrust",))
    shares = jnp.array([22000.0, 20000.0])
    engines = tuple(
        eqx.tree_at(lambda e: e.share, engine, share)
        for engine, share in zip(model.engines, shares, strict=True)
    )
    model = eqx.tree_at(lambda m: m.engines, model, engines)
    result = model.pseudo_measurements(with_thrust).responses
    for name in COEFFICIENTS:
        true = np.asarray(flight.truth.channel(name))
        np.testing.assert_allclose(result[name], true, atol=1e-9 * np.max(np.abs(true)), rtol=0.0)


def test_gap_is_invalid_and_leaves_other_samples_unchanged(flight, record):
    model = from_aircraft(flight.aircraft)
    gapped = channels(
        record,
        az=record.channel("az").at[7].set(jnp.nan),
        alpha=record.channel("alpha").at[9].set(jnp.nan),
    )
    result, complete = model.pseudo_measurements(gapped), model.pseudo_measurements(record)
    assert np.flatnonzero(~np.asarray(result.valid)).tolist() == [7, 9]
    kept = np.asarray(result.valid)
    for name in COEFFICIENTS:
        np.testing.assert_array_equal(
            np.asarray(result.responses[name])[kept], np.asarray(complete.responses[name])[kept]
        )
    assert all(
        bool(jnp.all(jnp.isfinite(value))) for value in (result.responses | result.signals).values()
    )


def test_numbers_of_candidates_equal_those_of_the_report():
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


# Histories and states -----------------------------------------------------------------------------


@pytest.mark.parametrize("frame", ["body", "air path"])
def test_prepared_histories_equal_the_true_ones(flight, record, frame):
    """Exact for vanes at any position, unlike the corrections of App. D."""
    model = from_aircraft(
        flight.aircraft, states=("psi",), frame=frame, measured=("altitude", "pdot", "qdot", "rdot")
    )
    prepared = model.prepared(record)
    assert prepared.inputs == model.inputs
    assert prepared.outputs == ("psi",)
    _, u = true_histories(model, flight)
    np.testing.assert_allclose(
        prepared.u, u, rtol=0.0, atol=1e-10 * np.max(np.abs(u), axis=0, keepdims=True).max()
    )
    np.testing.assert_array_equal(prepared.z[:, 0], record.channel("psi"))
    again = model.prepared(prepared)
    np.testing.assert_array_equal(again.u, prepared.u)


def test_initial_state_is_at_the_centre_of_gravity(flight, record):
    for states, frame in (
        (TEN, "body"),
        (TEN_IN_AIR, "air path"),
        ("longitudinal", "body"),
        ("lateral", "air path"),
    ):
        model = from_aircraft(flight.aircraft, states=states, frame=frame)
        x, _ = true_histories(model, flight)
        np.testing.assert_allclose(
            model.initial_state(model.prepared(record)), x[0], rtol=1e-9, atol=1e-10
        )


def test_unmeasured_state_starts_at_a_constant_or_at_zero(flight):
    model = IdentificationModel(
        small_airframe(), held={"altitude": 9000.0}, instruments=Instruments(("q", "pitch"))
    )
    t, z = 0.1 * jnp.arange(4), jnp.zeros((4, 2)) + 0.1
    made = make_record(
        t, jnp.zeros((4, 3)), z, inputs=model.inputs, outputs=("q", "pitch"), constants={"phi": 0.4}
    )
    state = dict(zip(model.states, model.initial_state(made), strict=True))
    weight = model.airframe.mass_properties.mass * 9.80665
    V = np.sqrt(2.0 * weight / (float(model.atmosphere.air(jnp.array(9000.0)).density) * 49.2))
    assert {name: round(float(value), 9) for name, value in state.items() if name != "u"} == {
        **dict.fromkeys(("v", "w", "p", "r", "psi"), 0.0),
        **{"q": 0.1, "pitch": 0.1, "phi": 0.4},
    }
    np.testing.assert_allclose(state["u"], V)


def test_true_airspeed_and_sideslip_readings_are_inverted():
    """A record of corrected air data: V is the true airspeed and beta asin(v/V), with known scale
    and bias errors.
    """
    instruments = Instruments(CHANNELS, bias={"V": 2.0, "beta": 0.01}, scale={"beta": 0.05})
    model = IdentificationModel(
        small_airframe(),
        held={"altitude": 9000.0},
        instruments=instruments,
        airspeed="true",
        beta="sideslip",
    )
    x = jnp.array([150.0, 12.0, 40.0, 0.1, 0.05, -0.1, 0.1, 0.2, 0.3])
    readings = dict(
        zip(model.outputs, eqx.filter_jit(model.output)(T, x, jnp.zeros(3)), strict=True)
    )
    V = np.linalg.norm(x[:3])
    np.testing.assert_allclose(readings["V"], V + 2.0, rtol=1e-14)
    np.testing.assert_allclose(readings["beta"], 1.05 * np.arcsin(12.0 / V) + 0.01, rtol=1e-14)
    z = jnp.tile(jnp.stack(list(readings.values()))[None], (3, 1))
    made = make_record(
        jnp.arange(3.0), jnp.zeros((3, 3)), z, inputs=model.inputs, outputs=model.outputs
    )
    np.testing.assert_allclose(model.initial_state(made), x, rtol=1e-12)


@pytest.mark.parametrize("known", [("w",), ("u", "w")])
def test_sideslip_with_known_velocities_is_inverted(known):
    """The sideslip asin(v/V) at 20 deg of alpha: w/u counts in the plane of symmetry."""
    true = velocity(100.0, np.radians(20.0), np.radians(10.0))
    shown = {"beta": jnp.radians(10.0)} | ({} if "u" in known else {"V": jnp.array(100.0)})
    given = {name: true["uvw".index(name)] for name in known}
    result = motion(
        Instruments(("V", "beta")), shown, given, StandardAtmosphere(), "true", "sideslip"
    )
    np.testing.assert_allclose([result[name] for name in "uvw"], true, rtol=1e-12)


@pytest.mark.parametrize(
    ("states", "frame"), [(TEN, "body"), (TEN_IN_AIR, "air path"), ("lateral", "body")]
)
def test_velocities_from_air_data_in_gusts_are_over_ground(flight, record, states, frame):
    """Air data are relative to the air, and the states and histories of the model over ground."""
    gusts = {"gust_u": 3.0, "gust_v": -2.0, "gust_w": 4.0}
    options = {"states": states, "frame": frame}
    still = from_aircraft(flight.aircraft, **options)
    moving = from_aircraft(flight.aircraft, measured=tuple(gusts), **options)
    gusty = with_inputs(record, gusts)
    if states == "lateral":
        through_air, over_ground = still.prepared(record), moving.prepared(gusty)
        for name in "uw":
            expected = through_air.channel(name) + gusts[f"gust_{name}"]
            np.testing.assert_allclose(over_ground.channel(name), expected, rtol=1e-12)
        gusty = over_ground
    truth = {name: flight.truth.channel(name)[0] for name in (*TEN, *TEN_IN_AIR)}
    truth |= {name: truth[name] + gusts[f"gust_{name}"] for name in "uvw"}
    truth |= dict(
        zip(("V", "alpha", "beta"), air_angles(vector(truth, ("u", "v", "w"))), strict=True)
    )
    expected = [truth[name] for name in moving.states]
    np.testing.assert_allclose(moving.initial_state(gusty), expected, rtol=1e-9, atol=1e-10)


def test_gusts_with_histories_of_air_path_states_are_refused(flight, record):
    options = {"states": "lateral", "frame": "air path", "measured": ("gust_v",)}
    model = from_aircraft(flight.aircraft, **options)
    with pytest.raises(InputError, match=r"gust_v.*does not propagate V, alpha.*frame 'body'"):
        model.prepared(with_inputs(record, {"gust_v": 1.0}))


def with_inputs(record, constants):
    """Return the record with constant inputs [m/s]."""
    added = [jnp.full(record.t.shape, value) for value in constants.values()]
    return make_record(
        record.t,
        jnp.column_stack([record.u, *added]),
        record.z,
        inputs=(*record.inputs, *constants),
        outputs=record.outputs,
        units=dict.fromkeys(constants, "m/s"),
    )


def test_constant_of_the_record_replaces_the_parameter(flight, record):
    """The density of a record is used in pseudo-measurements too."""
    model = from_aircraft(
        flight.aircraft, held={"altitude": 0.0, "density": 1.225}, airspeed="true"
    )
    part = without(("altitude",))
    plain = model.pseudo_measurements(channels(record, part))
    thin = model.pseudo_measurements(channels(record, part, constants={"density": 0.6125}))
    np.testing.assert_allclose(thin.responses["CZ"], 2.0 * plain.responses["CZ"], rtol=1e-12)
    np.testing.assert_allclose(thin.signals["density"], 0.6125)


def test_longitudinal_records_need_no_lateral_channels(flight, record):
    """Held variables need no measurement: only the longitudinal instruments are on board."""
    longitudinal = ("alpha", "V", "q", "pitch", "ax", "az", "qdot", "altitude")
    held = dict.fromkeys(("v", "p", "r", "phi", "aileron", "rudder"), 0.0)
    model = from_aircraft(flight.aircraft, states="longitudinal", held=held)
    model = eqx.tree_at(lambda m: m.airframe.reference, model, jnp.zeros(3))
    prepared = model.prepared(channels(record, longitudinal))
    assert prepared.inputs == ("stabilator", "altitude")
    result = model.pseudo_measurements(channels(record, longitudinal))
    assert bool(jnp.all(result.valid))
    # with a reference point off the c.g. every force has a moment
    with pytest.raises(InputError, match="needs 'ay'"):
        from_aircraft(flight.aircraft, states="longitudinal", held=held).pseudo_measurements(
            channels(record, longitudinal)
        )


def test_held_names_of_symmetric_flight_are_in_the_error(flight, record):
    """With these names the model accepts the record, as `model_of` builds it."""
    part = channels(record, ("alpha", "V", "q", "pitch", "ax", "az", "qdot", "altitude"))
    model = from_aircraft(flight.aircraft, states="longitudinal")
    model = eqx.tree_at(lambda m: m.airframe.reference, model, jnp.zeros(3))
    values = {name: part.channel(name) for name in (*part.inputs[:1], *part.outputs)}
    symmetric = make_record(
        part.t,
        values.pop("stabilator")[:, None],
        jnp.stack([*values.values()], axis=-1),
        inputs=("stabilator",),
        outputs=tuple(values),
    )
    for use in (model.prepared, model.pseudo_measurements):
        with pytest.raises(InputError, match="In symmetric flight hold") as caught:
            use(symmetric)
        assert "`model_of(record, states='longitudinal')` does so" in str(caught.value)
        held = ast.literal_eval(str(caught.value).partition("held=")[2].partition("`")[0])
        assert held == dict.fromkeys(("v", "p", "r", "phi", "aileron", "rudder"), 0.0)
    options = {"states": "longitudinal", "held": held, "outputs": ("alpha", "q", "az")}
    accepted = from_aircraft(flight.aircraft, **options).prepared(symmetric)
    assert accepted.inputs == ("stabilator", "altitude")
    lateral = from_aircraft(flight.aircraft, states="lateral")
    with pytest.raises(InputError, match="needs 'p' for the coefficients") as caught:
        lateral.pseudo_measurements(channels(record, without(("p",))))
    assert "symmetric" not in str(caught.value)


# Flights ------------------------------------------------------------------------------------------


def test_flight_record_has_measured_surfaces_as_inputs(flight, record):
    assert record.inputs == ("stabilator", "aileron", "rudder")
    assert record.outputs == CHANNELS
    assert record.input_units == ("rad",) * 3
    np.testing.assert_array_equal(record.channel("rudder"), flight.truth.channel("rudder"))
    with pytest.raises(InputError, match="channel of the truth 'fuel'"):
        flight_record(flight, also=("fuel",))


def test_known_errors_are_removed_from_recorded_surfaces():
    """The thrust of a turbofan is measured, because the model does not propagate the engine."""
    instruments = Instruments(
        ("alpha", "beta", "V", "p", "q", "r", "stabilator"), bias={"stabilator": 0.01}
    )
    frame = small_airframe()
    controls = ControlSystem(standard_actuators(frame.limits), trim={"stabilator": -0.05})
    aircraft = Aircraft(frame, engines=(f16_engine(),), controls=controls, instruments=instruments)
    state = aircraft.flight_state(
        velocity(170.0, 0.1, 0.0),
        jnp.zeros(3),
        quaternion(0.0, 0.1, 0.0),
        jnp.array([0.0, 0.0, 9000.0]),
    )
    t = 0.1 * jnp.arange(4)
    flight = simulate_flight(aircraft, t, {}, state, key=jax.random.key(1))
    record = flight_record(flight)
    assert record.inputs == ("aileron", "rudder", "altitude", "thrust")
    model = from_aircraft(
        flight.aircraft, states=("u", "v", "w", "p", "q", "r"), held={"phi": 0.0, "pitch": 0.1}
    )
    prepared = model.prepared(record)
    assert prepared.inputs == ("stabilator", "aileron", "rudder", "thrust", "altitude")
    np.testing.assert_allclose(prepared.channel("stabilator"), -0.05, rtol=1e-12)
    with pytest.raises(InputError, match="has states of its own"):
        IdentificationModel(small_airframe(), engines=(f16_engine(),), held={"altitude": 0.0})


# Bad input ----------------------------------------------------------------------------------------


def test_missing_channel_is_named_with_a_remedy(flight, record):
    model = from_aircraft(flight.aircraft)
    with pytest.raises(InputError, match=r"needs 'qdot'.*Derive it from the rate.*differentiate"):
        model.pseudo_measurements(channels(record, without(("qdot",))))
    with pytest.raises(InputError, match=r"needs 'w'.*is computed from V, alpha and beta"):
        model.pseudo_measurements(channels(record, without(("alpha",))))
    with pytest.raises(InputError, match="needs 'ay'"):
        model.pseudo_measurements(channels(record, without(("ay",))))
    with pytest.raises(InputError, match="needs 'altitude' as an input"):
        model.prepared(channels(record, without(("altitude",))))
    with pytest.raises(InputError, match=r"channel .needed as output. 'psi'"):
        model.prepared(channels(record, without(("psi",))))
    lateral = from_aircraft(flight.aircraft, states="lateral")
    with pytest.raises(
        InputError,
        match=r"needs 'u' as an input, which is computed from V, alpha and "
        r"beta",
    ):
        lateral.prepared(channels(record, without(("V",))))


@pytest.mark.parametrize("missing", ["p", "qdot", "ay"])
def test_gap_of_a_channel_leaves_independent_signals_valid(flight, record, missing):
    """Error-free instruments at the centre of gravity; off it a vane needs the rates."""
    model = from_aircraft(flight.aircraft, states=("u", "w", "p", "q", "pitch"))
    at_cg = eqx.tree_at(lambda one: one.instruments, model, Instruments(CHANNELS))
    gapped = channels(record, **{missing: record.channel(missing).at[5].set(jnp.nan)})
    row = jnp.where(gapped.mask[5], gapped.z[5], jnp.nan)
    motions = at_cg.readings.motion(dict(zip(gapped.outputs, row, strict=True)), {})
    assert [name for name, value in motions.items() if bool(jnp.isnan(value))] == [missing]
    assert at_cg.prepared(gapped).inputs == at_cg.inputs
    if missing == "p":
        with pytest.raises(InputError, match=r"takes 'v' as an input.*from the rates for a vane"):
            model.prepared(gapped)


def test_gap_is_refused_in_a_history_and_accepted_in_an_output(flight, record):
    lateral = from_aircraft(flight.aircraft, states="lateral")
    with pytest.raises(
        InputError, match=r"takes 'u' as an input, and 1 of its samples are missing"
    ):
        lateral.prepared(channels(record, V=record.channel("V").at[5].set(jnp.nan)))
    coupled = from_aircraft(flight.aircraft)
    prepared = coupled.prepared(channels(record, V=record.channel("V").at[5].set(jnp.nan)))
    assert int(jnp.sum(~prepared.mask)) == 1


def test_stack_of_records_is_refused(flight, record):
    with pytest.raises(InputError, match="one by one"):
        from_aircraft(flight.aircraft).prepared(stack([record, record]))
