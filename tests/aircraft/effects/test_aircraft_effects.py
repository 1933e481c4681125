"""Effects of aircraft: action of each, sensitivities at zero gain, detection of a dropped mass."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
from small_airframe import small_airframe

from jaxid._foundation.checks import InputError
from jaxid.aircraft import (
    Aircraft,
    ConstantThrust,
    Engine,
    IdentificationModel,
    Instruments,
    MeasuredSurfaces,
    Wind,
    from_aircraft,
)
from jaxid.aircraft.effects.coefficient_term import CoefficientTerm
from jaxid.aircraft.effects.flow_dependence import (
    HIGHEST_AIRFIELD,
    CoefficientGradient,
    GroundEffect,
    in_coefficient,
)
from jaxid.aircraft.effects.library import GROUPS, aircraft_effects, ground_effects
from jaxid.aircraft.effects.parameters import centre_of_gravity
from jaxid.aircraft.effects.separation import Separation, StaticSeparation
from jaxid.aircraft.flight.longitudinal_flight import (
    LONGITUDINAL_SPEED,
    level_trim,
    manoeuvres,
    true_aircraft,
)
from jaxid.aircraft.physics.frames import quaternion
from jaxid.aircraft.vehicle.force_derivatives import AFFECTED_STATES
from jaxid.data import record
from jaxid.effects import Augmented
from jaxid.effects.library import initialise_shapes
from jaxid.effects.parameter import ParameterDrift, ParameterShift, ParameterStep, parameter_effects
from jaxid.estimation import OutputError
from jaxid.loop import Hypothesis, LoopOptions, LoopProblem
from jaxid.loop.fit import fit
from jaxid.loop.moves import Proposals
from jaxid.loop.search import with_shapes
from jaxid.models import AbstractModel, free, parameter_names, with_values
from jaxid.models.names import read_parameters
from jaxid.simulation import RK4, simulate

CHANNELS = ("alpha", "beta", "V", "p", "q", "r", "phi", "pitch", "ax", "ay", "az", "altitude")
AIRCRAFT = Aircraft(
    small_airframe(),
    engines=(
        Engine(ConstantThrust(30e3), position=(-5.0, 1.0, 0.2)),
        Engine(ConstantThrust(30e3), momentum=200.0),
    ),
    controls=MeasuredSurfaces(),
    instruments=Instruments(CHANNELS, position={"alpha": (10.0, 0.1, 0.0), "ax": (2.0, 0.3, -0.4)}),
    wind=Wind(8.0, -5.0, 1.0, north_shear=0.003),
)
STATE = AIRCRAFT.flight_state(
    jnp.array([165.0, 9.0, 24.0]),
    jnp.array([0.3, 0.12, -0.1]),
    quaternion(0.4, 0.15, 0.6),
    jnp.array([0.0, 0.0, 3000.0]),
)
SURFACES = jnp.array([-0.05, 0.03, 0.04])
NOW = jnp.array(0.7)
SIGNALS = {"t": np.linspace(0.0, 1.0, 5), "alpha": np.linspace(0.05, 0.16, 5)}
SIGNALS |= {name: np.ones(5) for name in ("mach", "qbar", "beta")}
SIGNALS |= {"altitude": np.linspace(2998.0, 3000.0, 5)}
EVERY = aircraft_effects(AIRCRAFT, ground=2990.0)
USUAL = AIRCRAFT.effects()


@eqx.filter_jit
def evaluate(model, x=STATE):
    """Rates, outputs and signals at one instant."""
    return (
        model.rhs(NOW, x, SURFACES),
        model.output(NOW, x, SURFACES),
        model.signals(NOW, x, SURFACES),
    )


def of_type(kind, effects=USUAL):
    return [effect for effect in effects if isinstance(effect, kind)]


# The library --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def instant():
    """Names of effects, and rates and outputs as a function of their scaled gains.

    The effects are the default candidates, with few of the terms, and one effect of each other
    type. The scales give a small but measurable influence.
    """
    usual = [
        effect
        for effect in USUAL
        if not isinstance(effect, CoefficientTerm) or "dot_hat" in effect.name
    ]
    kinds = {type(effect): effect for effect in EVERY} | {type(effect): effect for effect in usual}
    known = {effect.name: effect for effect in (*usual, *kinds.values())}
    model = Augmented(AIRCRAFT, initialise_shapes(tuple(known.values()), SIGNALS, {}, 0.2))
    x = jnp.concatenate([STATE, jnp.full(len(model.states) - STATE.size, -0.02)])
    sizes = np.array([_size(effect) for effect in model.effects_in])

    @jax.jit
    def responses(gains):
        filled = eqx.tree_at(lambda m: [e.gain for e in m.effects_in], model, list(sizes * gains))
        return jnp.concatenate(
            [filled.rhs(NOW, x, SURFACES)[: STATE.size], filled.output(NOW, x, SURFACES)]
        )

    return tuple(effect.name for effect in model.effects_in), responses


def _size(effect):
    """Scale of a gain."""
    return {"kg": 1e3, "kg*m^2": 1e4, "kg*m^2/s": 1e3}.get(effect.card.unit, 1.0)


def test_effects_at_zero_gain_leave_the_model_unchanged(instant):
    names, responses = instant
    unchanged = np.concatenate(evaluate(AIRCRAFT)[:2])
    np.testing.assert_allclose(responses(jnp.zeros(len(names))), unchanged, rtol=1e-12, atol=1e-14)


def test_sensitivities_at_zero_gain_match_central_differences(instant):
    """Central differences of values up to hundreds: rounding of 1e-14/1e-4, and the third
    derivative times 1e-8.
    """
    names, responses = instant
    S, d = jax.jacfwd(responses)(jnp.zeros(len(names))), 1e-4
    for column, name in enumerate(names):
        unit = jnp.zeros(len(names)).at[column].set(d)
        by_differences = (responses(unit) - responses(-unit)) / (2 * d)
        np.testing.assert_allclose(S[:, column], by_differences, rtol=1e-6, atol=1e-8, err_msg=name)
        assert np.abs(S[:, column]).max() > 1e-5, name


def test_default_effects_are_a_part_of_the_library():
    more = [effect for effect in USUAL if not isinstance(effect, CoefficientTerm)]
    assert 30 <= len(more) <= 55
    families = {effect.card.family for effect in EVERY}
    assert {effect.card.family for effect in USUAL} <= families
    assert len(USUAL) < 0.7 * len(EVERY)


def test_groups_partition_the_library():
    by_group = [aircraft_effects(AIRCRAFT, groups=(group,)) for group in GROUPS]
    assert all(by_group)
    assert sum(map(len, by_group)) == len(EVERY)
    with pytest.raises(InputError, match="'weather'"):
        aircraft_effects(AIRCRAFT, groups=("weather",))


@pytest.mark.parametrize(
    "model", [true_aircraft(), from_aircraft(AIRCRAFT)], ids=["longitudinal", "identification"]
)
def test_models_with_fewer_signals_get_the_effects_on_these_signals(model):
    effects = aircraft_effects(model)
    assert {"shift of mass", "static separation (from 70%)"} <= {effect.name for effect in effects}
    augmented = Augmented(model, effects)
    x = jnp.ones(len(augmented.states))
    assert jax.eval_shape(augmented.rhs, NOW, x, jnp.ones(len(model.inputs))).shape == x.shape


def test_parameter_effects_refer_to_existing_parameters_with_units():
    """Only the gain of a ratio has no unit."""
    names = set(parameter_names(AIRCRAFT))
    for effect in of_type(ParameterShift, EVERY):
        assert {effect.parameter, *(name for name, _ in effect.linked)} <= names
        assert (effect.card.unit == "") == (
            "thrust" in effect.name and effect.parameter.endswith("share")
        )


def test_instrument_errors_are_located_at_their_sensor():
    places = {
        effect.name: (str(effect.card.location), effect.card.signals)
        for effect in of_type(ParameterShift, EVERY)
    }
    assert places["shift of position of the sensor of alpha along x"] == (
        "sensor alpha",
        ("alpha",),
    )
    assert places["shift of axis of the sensor of p in theta"] == ("sensor p", ("p",))
    assert places["shift of mass"] == ("parameter mass", ())


def test_drift_of_the_mass_begins_at_its_declared_value():
    for effects in (USUAL, EVERY):
        (drift,) = of_type(ParameterDrift, effects)
        assert (drift.parameter, drift.from_start) == ("mass", True)


# Parameters ---------------------------------------------------------------------------------------


def test_mass_shift_equals_another_declared_mass():
    heavier = with_values(AIRCRAFT, ("mass",), read_parameters(AIRCRAFT, ("mass",)) + 900.0)
    model = Augmented(AIRCRAFT, (ParameterShift("mass", gain=jnp.array(900.0)),))
    for actual, expected in zip(evaluate(model)[:2], evaluate(heavier)[:2], strict=True):
        np.testing.assert_allclose(actual, expected, rtol=1e-13, atol=1e-15)


def test_centre_of_gravity_further_aft_pitches_up():
    """The lift at the reference point then acts further ahead: `qdot += -d Fz/Iy`.

    Sensor readings change only by the longer lever arm.
    """
    (effect,) = centre_of_gravity(parameter_names(AIRCRAFT), "x")
    model = Augmented(AIRCRAFT, (eqx.tree_at(lambda e: e.gain, effect, jnp.array(0.2)),))
    still = STATE.at[3:6].set(0.0)
    before, after = evaluate(AIRCRAFT, still)[2], evaluate(model, still)[2]
    # The engines' lines of action are along x: a move along x leaves their moment unchanged.
    force = before["qbar"] * AIRCRAFT.airframe.S * before["CZ"]
    assert force < 0
    np.testing.assert_allclose(
        after["qdot"] - before["qdot"],
        -0.2 * force / AIRCRAFT.airframe.mass_properties.Iy,
        rtol=1e-10,
    )
    # The accelerometer is 0.2 m further ahead, and the angular accelerations have changed.
    (_, y, before), (_, affected, after) = evaluate(AIRCRAFT), evaluate(model)
    affected = (affected - y)[CHANNELS.index("ax")]
    _, q, r = STATE[3:6]
    lever = -0.4 * (after["qdot"] - before["qdot"]) - 0.3 * (after["rdot"] - before["rdot"])
    np.testing.assert_allclose(affected, lever - 0.2 * (q**2 + r**2), rtol=1e-10)


def test_thrust_asymmetry_is_an_offset_of_one_engine_or_shares_of_two():
    words = [
        effect.display_name for effect in of_type(ParameterShift) if "thrust" in effect.display_name
    ]
    assert "symmetry of thrust" in words
    assert "sideways position of the thrust line" not in words
    single = Aircraft(
        small_airframe(), engines=(Engine(ConstantThrust(6e4)),), controls=MeasuredSurfaces()
    )
    words = [effect.display_name for effect in of_type(ParameterShift, single.effects())]
    assert "sideways position of the thrust line" in words
    assert "symmetry of thrust" not in words


@pytest.mark.parametrize("measured", [False, True], ids=["held", "measured"])
def test_shared_thrust_is_shifted_only_if_it_is_not_measured(measured):
    held = {"altitude": 3000.0} | ({} if measured else {"thrust": 5e4})
    model = IdentificationModel(
        small_airframe(),
        engines=(Engine(ConstantThrust(6e4)),),
        held=held,
        measured=("thrust",) * measured,
    )
    parameters = {effect.parameter for effect in aircraft_effects(model, groups=("thrust",))}
    assert ("thrust" in parameters) == (not measured)
    # a common factor of the shares cancels if the thrust is given
    assert not any(name.endswith("share") for name in parameters)


# Coefficients -------------------------------------------------------------------------------------


def test_reduced_rates_of_alpha_and_beta_match_differences_along_the_motion():
    """By central differences along the motion, in wind and sideslip; rounding of 1e-16/1e-6."""
    # The wind is without shear, because the signals assume a steady wind along the path.
    model = with_values(AIRCRAFT, ("wind.north_shear",), jnp.zeros(1))
    (dx, _, signals), d = evaluate(model), 1e-6
    later, before = (evaluate(model, STATE + step * dx)[2] for step in (d, -d))
    for angle, length in (("alpha", model.airframe.cbar), ("beta", model.airframe.b)):
        expected = (later[angle] - before[angle]) / (2 * d) * length / (2 * signals["V"])
        assert abs(expected) > 1e-4
        np.testing.assert_allclose(signals[f"{angle}dot_hat"], expected, rtol=1e-6)


def test_coefficient_gradient_is_centred_on_the_mean_of_the_records():
    effect = CoefficientGradient(in_coefficient("CZ", AFFECTED_STATES["CZ"]), "mach", "alpha")
    effect = effect.initialise_shape({"mach": np.array([0.5, 0.6])}, {}, 0.05)
    effect = eqx.tree_at(lambda e: e.gain, effect, jnp.array(-2.0))
    (dx, _, signals), (with_effect, _, _) = (
        evaluate(AIRCRAFT),
        evaluate(Augmented(AIRCRAFT, (effect,))),
    )
    change = -2.0 * signals["alpha"] * (signals["mach"] - 0.55)
    np.testing.assert_allclose((with_effect - dx)[2], signals["w_per_CZ"] * change, rtol=1e-10)


def test_ground_effect_is_one_at_zero_height_and_half_at_a_sixteenth_of_the_span():
    (_, effect, _) = ground_effects(AIRCRAFT, AFFECTED_STATES, 100.0)
    b = effect.b
    assert effect.initialise_shape(SIGNALS, {}, 0.05) is effect
    for height, expected in ((0.0, 1.0), (b / 16.0, 0.5), (2.1 * b, 0.0)):
        np.testing.assert_allclose(effect.scalar({"altitude": 100.0 + height}), expected)


@pytest.mark.parametrize(("lowest", "ground"), [(120.0, 120.0), (9000.0, HIGHEST_AIRFIELD)])
def test_unknown_ground_lies_under_the_records_and_no_higher_than_an_airfield(lowest, ground):
    (_, effect, _) = ground_effects(AIRCRAFT, AFFECTED_STATES, None)
    effect = effect.initialise_shape({"altitude": np.array([lowest, lowest + 300.0])}, {}, 0.05)
    assert (effect.lowest, effect.highest) == (ground - effect.b, ground)
    assert effect.ground == ground - effect.b / 16.0
    near = effect.scalar({"altitude": jnp.array(lowest)})
    np.testing.assert_allclose(near, 0.5 if lowest == ground else 0.0)


# Separated flow -----------------------------------------------------------------------------------

CZ_ONLY = (in_coefficient("CZ", ("w",)),)
MEAN, SWING, PACE = 0.25, 0.12, 2.0  # rad, rad, rad/s
SHAPE = {"alpha_star": jnp.array(0.26), "steepness": jnp.array(25.0)}


class Pitching(AbstractModel):
    """A prescribed oscillation of the angle of attack, and the integral of CZ."""

    states, inputs, outputs = ("alpha", "w"), ("u",), ("alpha", "w")

    def rhs(self, t, x, u):
        return jnp.stack([SWING * PACE * jnp.sin(PACE * t), jnp.zeros(())])

    def output(self, t, x, u):
        return x[:2]

    def signals(self, t, x, u):
        return super().signals(t, x, u) | {"w_per_CZ": jnp.ones(())}


def swung(effect, t):
    """State, and rate of w, which equals the added CZ."""
    model = Augmented(Pitching(), (effect,))
    start = jnp.concatenate([jnp.array([MEAN - SWING, 0.0]), jnp.zeros(len(model.states) - 2)])
    u = jnp.zeros((t.size, 1))
    x = simulate(model, t, u, start, stepper=RK4(2, unrolled=False)).x
    return np.asarray(x), np.asarray(jax.jit(jax.vmap(model.rhs))(t, x, u)[:, 1])


def test_static_separation_equals_kirchhoffs_factor():
    effect = StaticSeparation(CZ_ONLY, gain=jnp.array(-4.0), **SHAPE)
    for alpha, x in ((0.26, 0.5), (-0.4, 1.0), (0.36, 0.5 * (1.0 - np.tanh(2.5)))):
        added = effect.equations({}, {"alpha": jnp.array(alpha), "w_per_CZ": jnp.ones(())})["w"]
        np.testing.assert_allclose(
            added, -4.0 * alpha * ((0.5 * (1.0 + np.sqrt(x))) ** 2 - 1.0), rtol=1e-12, atol=1e-12
        )
    # Fully separated: a quarter of the slope remains, up to the lower limit of the root.
    added = effect.equations({}, {"alpha": jnp.array(1.5), "w_per_CZ": jnp.ones(())})["w"]
    np.testing.assert_allclose(added / (-4.0 * 1.5), -0.75, atol=0.51 * np.sqrt(1e-4))


def test_forward_force_and_moment_get_their_share():
    placements = tuple(
        in_coefficient(name, (state,)) for name, state in (("CX", "u"), ("CZ", "w"), ("Cm", "q"))
    )
    effect = StaticSeparation(
        placements, gain=jnp.array(-4.0), forward=jnp.array(0.3), pitching=jnp.array(-0.1), **SHAPE
    )
    signals = {
        "alpha": jnp.array(0.3),
        "u_per_CX": jnp.array(2.0),
        "w_per_CZ": jnp.array(3.0),
        "q_per_Cm": jnp.ones(()),
    }
    added = effect.equations({}, signals)
    np.testing.assert_allclose(added["u"] / 2.0, 0.3 * added["w"] / 3.0, rtol=1e-14)
    np.testing.assert_allclose(added["q"], -0.1 * added["w"] / 3.0, rtol=1e-14)


def test_separation_point_solves_the_goman_khrabrov_equation():
    """The reference is solved by SciPy; Runge-Kutta's error is (h/lag)^5/120 per step of 0.01 s."""
    lag, late = 0.3, 0.15
    effect = Separation(
        CZ_ONLY, gain=jnp.array(-4.0), lag=jnp.array(lag), late=jnp.array(late), **SHAPE
    )
    t = 0.02 * jnp.arange(300)
    x, _ = swung(effect, t)

    def static(alpha):
        return 0.5 * (1.0 - np.tanh(25.0 * (alpha - 0.26)))

    def rate(now, point):
        alpha, alphadot = MEAN - SWING * np.cos(PACE * now), SWING * PACE * np.sin(PACE * now)
        return (static(alpha - late * alphadot) - point) / lag

    begin = static(MEAN - SWING)
    true = scipy.integrate.solve_ivp(
        rate, (0, 6), [begin], method="DOP853", t_eval=np.asarray(t), rtol=1e-11, atol=1e-12
    )
    np.testing.assert_allclose(static(x[:, 0]) + x[:, 2], true.y[0], rtol=0, atol=1e-6)
    assert np.ptp(true.y[0]) > 0.5
    assert np.abs(x[:, 2]).max() > 0.2  # the flow separates, with a lag


def test_separation_with_vanishing_lag_is_static():
    """The difference is of first order in lag and delay, to a tenth for the second order."""
    t = 0.01 * jnp.arange(400)
    _, static = swung(StaticSeparation(CZ_ONLY, gain=jnp.array(-4.0), **SHAPE), t)
    apart = []
    for time in (0.04, 0.02):
        both = {"lag": jnp.array(time), "late": jnp.array(time)}
        _, late = swung(Separation(CZ_ONLY, gain=jnp.array(-4.0), **both, **SHAPE), t)
        apart.append(np.sqrt(np.mean((late - static) ** 2)))
    assert apart[0] < 0.1 * np.ptp(static)
    np.testing.assert_allclose(apart[0] / apart[1], 2.0, rtol=0.1)


def test_lag_of_separation_has_no_effect_in_steady_flight():
    late = Separation(CZ_ONLY, gain=jnp.array(-4.0), **SHAPE)
    at_once = StaticSeparation(CZ_ONLY, gain=jnp.array(-4.0), **SHAPE)
    (name,) = late.extra_states
    for alpha in (0.1, 0.26, 0.4):
        signals = {"alpha": jnp.array(alpha), "w_per_CZ": jnp.ones(()), name: jnp.zeros(())}
        assert late.equations({}, signals)["w"] == at_once.equations({}, signals)["w"]
        rates = late.extra_rates({name: jnp.zeros(())}, {}, signals, {"alpha": jnp.zeros(())})
        assert rates[name] == 0.0


def test_lagged_separation_refines_static_separation():
    late, at_once = Separation(CZ_ONLY), StaticSeparation(CZ_ONLY)
    assert late.card.refines == at_once.card.family
    shared = {"gain", "alpha_star", "steepness", "forward", "pitching"}
    names = [{field.name for field in dataclasses.fields(effect)} for effect in (late, at_once)]
    # a refining effect starts from the values of the simpler effect
    assert shared <= names[0] & names[1]


def test_initial_separation_angle_is_in_the_range_of_alpha():
    signals = {"alpha": np.linspace(0.05, 0.35, 50)}
    effect = Separation(CZ_ONLY, 0.8).initialise_shape(signals, {}, 0.05)
    np.testing.assert_allclose(effect.alpha_star, 0.29)
    # from 10 % to 90 % separated in a quarter of the range
    np.testing.assert_allclose(effect.steepness, 30.0)


# A dropped mass -----------------------------------------------------------------------------------

DROP, TIME = -1500.0, 5.4  # kg, s
# standard deviations of alpha, q, pitch, ax, az, V, as in the longitudinal flight
NOISE = jnp.array([9e-4, 1.7e-3, 9e-4, 0.03, 0.08, 0.3])


@pytest.fixture(scope="module")
def problem():
    """Three flights with a dropped store, and the declared model with candidates on the mass."""
    aircraft = true_aircraft()
    trimmed, elevator, thrust = level_trim(aircraft, LONGITUDINAL_SPEED)
    aircraft = eqx.tree_at(lambda model: model.thrust, aircraft, thrust)
    step = ParameterStep("mass", gain=jnp.array(DROP), time=jnp.array(TIME), width=jnp.array(0.02))
    t = 0.04 * jnp.arange(301)
    moves = manoeuvres(t)
    u = (
        elevator
        + jnp.stack([moves[name] for name in ("doublets", "3-2-1-1", "multisine")])[..., None]
    )
    y = jax.jit(
        jax.vmap(
            lambda u: (
                simulate(
                    Augmented(aircraft, (step,)), t, u, trimmed, stepper=RK4(4, unrolled=False)
                ).y
            )
        )
    )(u)
    z = y + NOISE[None, None] * jax.random.normal(jax.random.key(7), y.shape)
    records = [
        record(t, u[i], z[i], inputs=aircraft.inputs, outputs=aircraft.outputs) for i in range(3)
    ]
    chosen = free(aircraft, "CX", "CZ", "Cm", per_record=("initial_state",))
    candidates = (
        *parameter_effects(aircraft, ("mass",)),
        ParameterShift("Iy"),
        ParameterShift("thrust"),
        ParameterDrift("Iy"),
    )
    return LoopProblem.of(aircraft, candidates, chosen, OutputError(), records, records)


def test_dropped_mass_scores_best_and_its_time_is_estimated(problem):
    """The refit starts 0.6 s from the drop. The gain is estimated to four standard errors; the
    time, which the jump of the accelerometer determines sharply, to half a sample.
    """
    declared = with_shapes(fit(problem, Hypothesis()))
    shaped = declared.problem
    proposals = Proposals(declared, LoopOptions())
    scores = {name: proposals.score(name) for name in proposals.candidates}
    best = max(scores, key=lambda name: scores[name])
    assert shaped.effects[best].card.family == "step of mass"
    others = [
        score
        for name, score in scores.items()
        if shaped.effects[name].card.family != "step of mass"
    ]
    assert scores[best] > max(others) + 100.0
    fitted = fit(shaped, Hypothesis((best,)), declared)
    estimates = fitted.estimates
    gain, error = estimates[f"{best}.gain"]
    assert abs(gain - DROP) < 4.0 * error < 0.2 * abs(DROP)
    assert abs(estimates[f"{best}.time"][0] - TIME) < 0.02


# Ground effect ------------------------------------------------------------------------------------

GROUND, SPAN, AT_GROUND = 208.0, 12.0, -0.4  # altitude of the ground [m], span [m], change of CZ


class Landing(AbstractModel):
    """Altitude and downward velocity under a prescribed descent."""

    CZ0: jax.Array
    damping: jax.Array
    states, inputs, outputs = ("altitude", "w"), ("climb",), ("altitude", "w")

    def rhs(self, t, x, u):
        return jnp.stack([u[0], self.CZ0 - self.damping * x[1]])

    def output(self, t, x, u):
        return x

    def signals(self, t, x, u):
        return super().signals(t, x, u) | {"w_per_CZ": jnp.ones(())}


def test_ground_effect_scores_best_and_the_altitude_of_the_ground_is_estimated():
    """The refit starts from a ground under the lowest altitude. Both to four standard errors."""
    model, in_CZ = Landing(jnp.array(0.3), jnp.array(0.8)), in_coefficient("CZ", ("w",))
    true = GroundEffect(in_CZ, SPAN, gain=jnp.array(AT_GROUND), ground=jnp.array(GROUND))
    t, rng, records = 0.1 * np.arange(200), np.random.default_rng(5), []
    for rate in (1.2, 1.5):
        climb = -rate * np.exp(-t / 12.0)[:, None]  # a flare to 1.2 m above the ground
        start = jnp.array([GROUND + 1.2 + 12.0 * rate * (1.0 - np.exp(-t[-1] / 12.0)), 0.4])
        y = simulate(Augmented(model, (true,)), t, climb, start).y
        z = np.asarray(y) + 0.01 * rng.normal(size=y.shape)
        records.append(record(t, climb, z, inputs=model.inputs, outputs=model.outputs))
    candidates = (GroundEffect(in_CZ, SPAN), CoefficientGradient(in_CZ, "altitude"))
    chosen = free(model, "CZ0", per_record=("initial_state",))
    problem = LoopProblem.of(model, candidates, chosen, OutputError(), records, records)
    declared = with_shapes(fit(problem, Hypothesis()))
    proposals = Proposals(declared, LoopOptions())
    name, other = (effect.name for effect in candidates)
    assert proposals.score(name) > proposals.score(other) + 25.0
    estimates = fit(declared.problem, Hypothesis((name,)), declared).estimates
    for parameter, expected in (("gain", AT_GROUND), ("ground", GROUND)):
        value, error = estimates[f"{name}.{parameter}"]
        assert abs(value - expected) < 4.0 * error
    assert estimates[f"{name}.ground"][1] < 0.5
