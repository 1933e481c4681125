"""The identification model: simulated flight, frames, equations left out, effects."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from identified_flight import (
    COARSE,
    STEP,
    TEN,
    TEN_IN_AIR,
    flown,
    true_histories,
    with_true_coefficients,
)
from small_airframe import small_airframe

from jaxid._foundation.checks import InputError
from jaxid.aircraft import (
    COEFFICIENTS,
    IdentificationModel,
    Instruments,
    flight_record,
    from_aircraft,
)
from jaxid.aircraft.identification.channels import STATE_GROUPS
from jaxid.aircraft.identification.frames import AIR_PATH
from jaxid.data.record import Record
from jaxid.effects import Augmented
from jaxid.estimation import OutputError, estimate
from jaxid.models import Polynomial, free, parameter_names, polynomials_of, with_polynomials
from jaxid.models.free import with_values
from jaxid.models.names import read_parameters
from jaxid.simulation import RK4, simulate

T = jnp.zeros(())
STEPPER = RK4(5, unrolled=False)  # as the flight was flown
ALL_MEASURED = {"longitudinal": ("pdot", "rdot"), "lateral": ("qdot",)}
HELD = {"altitude": 9000.0}


@pytest.fixture(scope="module")
def flight():
    return flown()


@pytest.fixture(scope="module")
def record(flight):
    return flight_record(flight)


@pytest.fixture(scope="module")
def coupled(flight):
    return with_true_coefficients(from_aircraft(flight.aircraft, states=TEN), flight)


@pytest.fixture(scope="module")
def in_air(flight):
    return with_true_coefficients(
        from_aircraft(flight.aircraft, states=TEN_IN_AIR, frame="air path"), flight
    )


def partial(flight, states, **options):
    return with_true_coefficients(from_aircraft(flight.aircraft, states=states, **options), flight)


@eqx.filter_jit
def along(model, x, u):
    """Rates and outputs at each sample."""

    def at(x, u):
        dx = model.rhs(T, x, u)
        return dx, model.output_given(T, x, u, dx)

    return jax.vmap(at)(x, u)


@eqx.filter_jit
def relative_errors(model, record):
    """Largest error of each output over the record, relative to its largest value."""
    y = simulate(model, record.t, record.u, model.initial_state(record), stepper=STEPPER).y
    return jnp.max(jnp.abs(y - record.z), axis=0) / jnp.max(jnp.abs(record.z), axis=0)


def assert_close(value, reference, rtol):
    """Close in terms of the largest value of each column."""
    np.testing.assert_array_less(
        np.max(np.abs(value - reference), axis=0),
        rtol * np.max(np.abs(np.asarray(reference)), axis=0),
    )


# The flight ---------------------------------------------------------------------------------------


def test_model_with_true_coefficients_reproduces_the_flight(coupled, record):
    """The flight is simulated with quaternions, this model has Euler angles: they differ by the
    integration error, 1e-11 here.
    """
    assert coupled.inputs == ("stabilator", "aileron", "rudder")
    np.testing.assert_array_less(relative_errors(coupled, coupled.prepared(record)), 1e-9)


def test_both_frames_give_the_same_motion(flight, coupled, in_air, record):
    """At an instant to rounding; along the flight to the integration error, which differs between
    the frames.
    """
    x, u = true_histories(coupled, flight)
    rates, outputs = along(coupled, x, u)
    rates_in_air, outputs_in_air = along(in_air, *true_histories(in_air, flight))
    assert_close(outputs_in_air, outputs, 1e-13)
    by_chain_rule = jax.vmap(lambda x, dx: jax.jvp(AIR_PATH.states, (x,), (dx,))[1])(
        x[:, :3], rates[:, :3]
    )
    assert_close(rates_in_air[:, :3], by_chain_rule, 1e-12)
    assert_close(rates_in_air[:, 3:], rates[:, 3:], 1e-12)
    np.testing.assert_array_less(relative_errors(in_air, in_air.prepared(record)), 1e-9)


@pytest.mark.parametrize("frame", ["body", "air path"])
def test_derivatives_match_central_differences(flight, coupled, in_air, frame):
    model = coupled if frame == "body" else in_air
    x, u = (rows[30] for rows in true_histories(model, flight))
    names = (
        "Cm.alpha",
        "CX.alpha^2",
        "Cn.rudder",
        "mass",
        "Ixz",
        "reference.x",
        "instruments.bias.beta",
        "instruments.position.ay.z",
    )
    values = read_parameters(model, names)

    @jax.jit
    def responses(at):
        changed = with_values(model, names, at[x.size :])
        return jnp.concatenate(
            [changed.rhs(T, at[: x.size], u), changed.output(T, at[: x.size], u)]
        )

    at = jnp.concatenate([x, values])
    step = 1e-6 * jnp.maximum(jnp.abs(at), 0.1)
    differences = jnp.stack(
        [
            (responses(at.at[k].add(h)) - responses(at.at[k].add(-h))) / (2.0 * h)
            for k, h in enumerate(step)
        ],
        axis=-1,
    )
    exact = jax.jit(jax.jacfwd(responses))(at)
    np.testing.assert_allclose(
        differences,
        exact,
        rtol=1e-6,
        atol=1e-6 * np.max(np.abs(exact), axis=1, keepdims=True).max(),
    )


# Equations left out -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "states", ["longitudinal", "lateral", ("w", "q"), ("p",), ("phi", "pitch", "psi")]
)
@pytest.mark.parametrize("frame", ["body", "air path"])
def test_equations_with_true_histories_of_the_others_are_unchanged(flight, coupled, states, frame):
    """The remaining equations give the same rates and outputs to rounding."""
    named = {"w": "alpha"} if frame == "air path" else {}
    given = states if isinstance(states, str) else tuple(named.get(name, name) for name in states)
    rates_left = [
        f"{name}dot"
        for name in "pqr"
        if name not in (STATE_GROUPS[states] if isinstance(states, str) else states)
    ]
    model = partial(flight, given, frame=frame, measured=rates_left)
    x, u = true_histories(model, flight)
    rates, outputs = along(model, x, u)
    all_rates, all_outputs = along(coupled, *true_histories(coupled, flight))
    assert_close(
        outputs, all_outputs[:, [coupled.outputs.index(name) for name in model.outputs]], 1e-12
    )
    for k, name in enumerate(model.states):
        if name in coupled.states:
            assert_close(rates[:, k], all_rates[:, coupled.states.index(name)], 1e-12)


@pytest.mark.parametrize("states", ["longitudinal", "lateral"])
def test_each_plane_alone_reproduces_its_part_of_the_coupled_flight(flight, record, states):
    """Measured histories are straight between samples, with an error of h^2/8 of their second
    derivative. The error of the outputs is small and of second order: four times smaller at half
    the step (3 to 5 times, because the samples differ).
    """
    model = partial(flight, states, measured=ALL_MEASURED[states])
    assert model.inputs[4:] == (
        ("pdot", "rdot", "v", "p", "r", "phi")
        if states == "longitudinal"
        else ("qdot", "u", "w", "q", "pitch")
    )
    fine, coarse = (
        np.asarray(relative_errors(model, model.prepared(every(record, n)))) for n in (1, 2)
    )
    np.testing.assert_array_less(fine, 1e-3)
    ratio = np.linalg.norm(coarse) / np.linalg.norm(fine)
    assert 3.0 < ratio < 5.0, ratio


def every(record, n):
    """Every n-th sample; the surfaces are straight lines of COARSE seconds and stay exact."""
    assert COARSE / (n * STEP) == round(COARSE / (n * STEP))
    return eqx.tree_at(
        lambda r: (r.t, r.u, r.z, r.mask),
        record,
        tuple(part[::n] for part in (record.t, record.u, record.z, record.mask)),
    )


@pytest.mark.parametrize(
    ("states", "outputs"),
    [("longitudinal", ("alpha", "az")), ("lateral", ("beta", "p")), (TEN_IN_AIR, ("q", "ax"))],
)
def test_states_without_an_output_start_at_their_readings(flight, record, states, outputs):
    """Speed, attitude, heading and rates have readings, without noise, even if they are not
    fitted.
    """
    frame = "air path" if "V" in states else "body"
    model = partial(flight, states, outputs=outputs, frame=frame)
    true = true_histories(model, flight)[0][0]
    np.testing.assert_allclose(model.initial_state(model.prepared(record)), true, rtol=1e-9)


def test_without_leaves_out_the_equations_of_coefficients(flight, record):
    model = from_aircraft(flight.aircraft)
    left = model.without(("CX", "Cn"))
    assert left.states == ("v", "w", "p", "q", "phi", "pitch", "psi")
    assert left.inputs == ("stabilator", "aileron", "rudder", "altitude", "rdot", "u", "r")
    assert left.outputs == (
        "alpha",
        "beta",
        "p",
        "q",
        "phi",
        "pitch",
        "psi",
        "ay",
        "az",
        "pdot",
        "qdot",
    )
    assert left.responses == ("CY", "CZ", "Cl", "Cm")
    assert left.without(("CZ",)).states == ("v", "p", "q", "phi", "pitch", "psi")
    assert left.without(()) is left
    prepared = left.prepared(record)
    assert (prepared.inputs, prepared.outputs) == (left.inputs, left.outputs)
    air = from_aircraft(flight.aircraft, frame="air path").without(("CX", "CY", "CZ"))
    assert air.inputs[4:] == ("V", "alpha", "beta")
    with pytest.raises(InputError, match="no response 'CX'"):
        left.without(("CX",))
    kept = partial(flight, "coupled").without(("Cn",))
    assert (
        polynomials_of(kept)["Cn"].terms == polynomials_of(partial(flight, "coupled"))["Cn"].terms
    )


def test_accelerations_of_rates_left_out_are_held_unless_measured(flight):
    model = from_aircraft(flight.aircraft, states="longitudinal")
    assert {"pdot", "rdot"} <= set(model.held)
    assert not {"pdot", "rdot"} & set(model.inputs)
    assert "pdot" in parameter_names(model)
    assert "rdot" in model.without(("Cm",)).held
    assert "qdot" in model.without(("Cm",)).inputs


# Names, effects, estimates ------------------------------------------------------------------------


def test_every_coefficient_of_table_3_1_can_be_expanded():
    """The 24 functions of the table, with terms in alpha and beta about a centre, are free
    parameters.
    """
    factors = {name: ("1", "qhat", "stabilator") for name in ("CX", "CZ", "Cm")}
    factors |= {name: ("1", "phat", "rhat", "aileron", "rudder") for name in ("CY", "Cl", "Cn")}
    terms = {
        name: [
            f"{angle} {factor}".replace(" 1", "")
            for factor in of
            for angle in ("", "alpha", "alpha^2", "beta")
        ]
        for name, of in factors.items()
    }
    model = with_polynomials(
        IdentificationModel(small_airframe(), held=HELD),
        {
            name: Polynomial({term.strip() or "1": 0.1 for term in of}, {"alpha": 0.2, "beta": 0.0})
            for name, of in terms.items()
        },
    )
    chosen = free(
        model,
        *COEFFICIENTS,
        "instruments.bias.beta",
        "instruments.scale.alpha",
        per_record=("initial_state",),
    )
    assert {
        "Cm.alpha^2 stabilator",
        "Cn.beta rhat",
        "CX.centre.alpha",
        "instruments.bias.beta",
    } <= set(chosen.shared)
    rates = eqx.filter_jit(model.rhs)(
        T, jnp.array([150.0, 3.0, 20.0, 0.1, 0.1, 0.1, 0.1, 0.1, 0.0]), jnp.zeros(3)
    )
    assert np.all(np.isfinite(rates))
    assert (model.units()["Cm.alpha^2 stabilator"], model.units()["altitude"]) == ("1/rad^3", "m")


@pytest.mark.parametrize(
    ("states", "frame"), [(TEN, "body"), (TEN_IN_AIR, "air path"), ("longitudinal", "body")]
)
def test_coefficient_effect_equals_another_term(flight, states, frame):
    """In rates and accelerometer readings, in every coefficient, for every choice of states."""
    model = partial(flight, states, frame=frame)
    x, u = (rows[30] for rows in true_histories(model, flight))
    candidates = {effect.name: effect for effect in model.effects()}
    assert "alpha in Cm" not in candidates  # the model has it
    assert "alpha^3 in Cm" in candidates
    assert any(name.endswith("in Cn") for name in candidates) == (states != "longitudinal")
    gains = {
        "alpha^3 in Cm": -8.0,
        "beta^2 in CZ": 2.0,
        "alpha in CX": 0.3,
        "alpha beta in Cn": 1.5,
        "beta^3 in CY": 2.0,
    }
    gains = {name: gain for name, gain in gains.items() if name in candidates}
    effects = tuple(
        eqx.tree_at(lambda e: e.gain, candidates[name], jnp.array(gain))
        for name, gain in gains.items()
    )
    more = polynomials_of(model)
    for name, gain in gains.items():
        term, _, coefficient = name.partition(" in ")
        old = more[coefficient]
        more[coefficient] = Polynomial(
            dict(zip(old.terms, old.coefficients.tolist(), strict=True)) | {term: gain}
        )
    changed, augmented = with_polynomials(model, more), Augmented(model, effects)

    @eqx.filter_jit
    def both(model):
        return jnp.concatenate([model.rhs(T, x, u), model.output(T, x, u)])

    assert np.max(np.abs(both(changed) - both(model))) > 0.1
    np.testing.assert_allclose(both(augmented), both(changed), rtol=1e-10, atol=1e-12)


def test_coefficients_of_a_short_record_are_within_four_standard_errors(key):
    """The record is simulated by the model itself, with white noise."""
    frame = small_airframe()
    instruments = Instruments(("alpha", "V", "q", "pitch", "ax", "az"))
    held = HELD | {name: 0.0 for name in ("v", "p", "r", "phi", "aileron", "rudder")}
    model = IdentificationModel(frame, states="longitudinal", held=held, instruments=instruments)
    assert (model.inputs, model.outputs) == (
        ("stabilator",),
        ("alpha", "V", "q", "pitch", "ax", "az"),
    )
    t = 0.05 * jnp.arange(61)
    u = (-0.06 + 0.03 * jnp.sin(3.0 * t))[:, None]
    clean = jax.jit(lambda x: simulate(model, t, u, x, stepper=RK4(unrolled=False)).y)(
        jnp.array([168.0, 20.0, 0.0, 0.1])
    )
    sigma = jnp.array([1e-3, 0.1, 1e-3, 1e-3, 0.01, 0.05])
    z = clean + sigma[None] * jax.random.normal(key, clean.shape)
    units, mask = model.units(), jnp.ones(z.shape, bool)
    known = tuple(units[name] for name in model.outputs)
    made = Record(t, u, z, mask, {}, model.inputs, model.outputs, ("rad",), known, ("short",))
    names = ("Cm.alpha", "Cm.qhat", "Cm.stabilator", "CZ.alpha")
    truth = read_parameters(model, names)
    start = with_values(model, names, 0.9 * truth)
    fit = estimate(
        start, free(start, *names, per_record=("initial_state",)), made, OutputError(), throw=True
    )
    errors = np.array([fit.value(name) for name in names]) - truth
    sizes = np.array([fit.standard_error(name) for name in names])
    np.testing.assert_array_less(np.abs(errors), 4.0 * sizes)
    np.testing.assert_array_less(sizes, 0.1 * np.abs(truth))


# Bad input ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "The altitude, which determines density"),
        ({"states": "sideways"}, "group of states 'sideways'"),
        ({"states": ("u", "alpha"), "held": HELD}, "no state 'alpha'"),
        ({"states": ("u", "u"), "held": HELD}, "state name 'u' occurs twice"),
        ({"states": (), "held": HELD}, "No state is propagated"),
        ({"frame": "earth", "held": HELD}, "no frame 'earth'"),
        ({"measured": ("fuel", "altitude")}, "input .in `measured`. 'fuel'"),
        ({"measured": ("pdot", "altitude")}, "input .in `measured`. 'pdot'"),
        ({"measured": ("altitude",), "held": HELD}, "'altitude' is measured, and"),
        ({"states": TEN, "held": HELD}, "is a state, and it is also held"),
        ({"held": HELD | {"q": 0.0}}, "constant .in `held`. 'q'"),
        (
            {"held": HELD, "states": "longitudinal", "outputs": ("p", "q")},
            "'p' depends only on measured inputs",
        ),
        (
            {"held": HELD, "outputs": ("stabilator",)},
            "'stabilator' depends only on measured inputs",
        ),
        ({"held": HELD, "outputs": ("gamma",)}, "output .of the instruments. 'gamma'"),
        (
            {"held": HELD, "states": "lateral", "instruments": Instruments(("alpha", "q"))},
            "No instrument depends on",
        ),
        ({"held": HELD, "airspeed": "calibrated"}, "meaning of V 'calibrated'"),
        ({"held": HELD, "beta": "flank"}, "meaning of beta 'flank'"),
        ({"held": HELD, "candidates": {"CL": ("alpha",)}}, "'CL'"),
    ],
)
def test_invalid_model_options_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        IdentificationModel(small_airframe(), **options)
