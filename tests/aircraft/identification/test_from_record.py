"""Models of a record: from constants, channels and arguments; refused records."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft import (
    Aircraft,
    Engine,
    Instruments,
    MeasuredSurfaces,
    StandardAtmosphere,
    kinematics_of,
    model_of,
)
from jaxid.aircraft.records.air_data import altitude_of, density_of
from jaxid.aircraft.records.plausibility import require_plausible
from jaxid.data.build import record as make_record
from jaxid.data.stack import stack
from jaxid.effects import general_effects
from jaxid.models import Polynomial
from jaxid.models.replace import with_polynomials

MASS = {"mass": 5000.0, "Ix": 21000.0, "Iy": 32000.0, "Iz": 48000.0, "Ixz": 1500.0}
SIZE = {"S": 39.0, "b": 19.8, "cbar": 1.98}
AIR = StandardAtmosphere().air(jnp.asarray(1500.0))
T = 0.1 * np.arange(40)
LEVEL = {
    **{"stabilator": -0.03, "aileron": 0.0, "rudder": 0.0, "thrust": 4100.0},
    **{
        "V": 75.0,
        "alpha": 0.09,
        "beta": 0.0,
        "p": 0.0,
        "q": 0.0,
        "r": 0.0,
        "phi": 0.0,
        "pitch": 0.09,
        "psi": 0.3,
    },
    **{
        "ax": 0.9,
        "ay": 0.0,
        "az": -9.8,
        "altitude": 1500.0,
        "qbar": 0.5 * float(AIR.density) * 75.0**2,
    },
    **{"pdot": 0.0, "qdot": 0.0, "rdot": 0.0},
}
INPUTS = ("stabilator", "aileron", "rudder", "thrust")


def level(without=(), constants=MASS | SIZE, **changed):
    """A record of level flight, some channels left out, added or changed."""
    signals = {n: v + np.zeros(T.size) for n, v in (LEVEL | changed).items() if n not in without}
    inputs = tuple(n for n in INPUTS if n in signals)
    outputs = tuple(n for n in signals if n not in inputs)
    u, z = (np.stack([signals[n] for n in names], axis=-1) for names in (inputs, outputs))
    return make_record(T, u, z, inputs=inputs, outputs=outputs, name="level", constants=constants)


def refused(words, record, **options):
    with pytest.raises(InputError) as caught:
        model_of(record, **options)
    for word in words:
        assert word in str(caught.value), f"{word!r} is not in: {caught.value}"


def test_model_of_takes_the_airframe_from_constants_of_the_record():
    model = model_of(level())
    frame = model.airframe
    assert {n: float(getattr(frame.mass_properties, n)) for n in MASS} == MASS
    assert {n: float(getattr(frame, n)) for n in SIZE} == SIZE
    assert model.states == ("u", "v", "w", "p", "q", "r", "phi", "pitch", "psi")
    assert model.inputs == ("stabilator", "aileron", "rudder", "thrust", "altitude", "density")
    assert (model.airspeed, model.beta) == ("true", "sideslip")
    assert set(model.outputs) == {
        *"pqr",
        "V",
        "alpha",
        "beta",
        "phi",
        "pitch",
        "psi",
        "ax",
        "ay",
        "az",
    }


def test_arguments_replace_missing_constants_but_may_not_differ():
    frame = model_of(
        level(constants=SIZE), mass=4000.0, Ix=21000.0, Iy=32000.0, Iz=48000.0
    ).airframe
    assert (float(frame.mass_properties.mass), float(frame.mass_properties.Ixz)) == (4000.0, 0.0)
    assert model_of(level(), mass=5000.0 * (1 + 1e-9)).airframe.S == 39.0
    refused(
        ["level", "mass = 5000", "argument is 4000", "dataclasses.replace"], level(), mass=4000.0
    )


def test_missing_constants_are_named_in_the_error():
    refused(
        ["lacks mass, Ix, Iy, Iz, b", "b=...", "constants are S, cbar"],
        level(constants={"S": 39.0, "cbar": 2.0}),
    )
    refused(["Ix, Iz"], level(constants={"mass": 5e3, "Iy": 3.2e4} | SIZE))


def test_longitudinal_model_needs_only_the_pitch_moment_of_inertia():
    """With Ix = Iz and Ixz = 0 roll and yaw do not couple into pitch."""
    mass = model_of(
        level(constants={"mass": 5e3, "Iy": 3.2e4} | SIZE), states="longitudinal"
    ).airframe.mass_properties
    assert float(mass.Ix) == float(mass.Iz) == 3.2e4
    mass = model_of(
        level(constants={"mass": 5e3, "Iy": 3.2e4, "Iz": 4e4} | SIZE), states="longitudinal"
    ).airframe.mass_properties
    assert float(mass.Ix) == float(mass.Iz) == 4e4


def test_thrust_heading_and_outputs_follow_from_the_channels():
    model = model_of(level(without=("thrust", "psi"), constants=MASS | SIZE | {"thrust": 4100.0}))
    assert float(model.held["thrust"]) == 4100.0
    assert "psi" not in model.states
    model = model_of(level(without=("thrust",)), outputs=("q", "qdot"))
    assert "thrust" not in (*model.inputs, *model.held)
    assert model.outputs == ("q", "qdot")
    assert float(model.motion.engine_thrusts({})[0]) == 0.0
    model = model_of(
        level(),
        frame="air path",
        engines=(Engine(model.engines[0].source, up=0.05),),
        held={"thrust": 3e3},
    )
    assert model.states[:3] == ("V", "alpha", "beta")
    assert float(model.held["thrust"]) == 3e3


# The air ------------------------------------------------------------------------------------------


def test_density_follows_from_qbar_and_true_airspeed():
    """Noise of V averages out: 1 % of it is 2 % of `2 qbar/V^2`, and 0.3 % (`2 % / sqrt(40)`) of
    the mean.
    """
    rng = np.random.default_rng(0)
    altitude = 1500.0 + 50.0 * T
    V = 75.0 * (1.0 + 0.01 * rng.normal(size=T.size))
    result = density_of(level(V=V, altitude=altitude, qbar=LEVEL["qbar"]))
    standard = np.array([float(StandardAtmosphere().air(jnp.asarray(h)).density) for h in altitude])
    ratio = np.asarray(result) / standard
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-12)
    assert ratio[0] == pytest.approx(np.mean(LEVEL["qbar"] * 2 / V**2 / standard), rel=1e-12)
    smooth = np.asarray(density_of(level(without=("altitude",), V=V)))
    assert np.std(smooth) < 0.5 * np.std(2 * LEVEL["qbar"] / V**2)
    assert density_of(level(), "indicated") is None
    assert density_of(level(without=("qbar",))) is None


def test_density_from_measured_pressure_precedes_density_channel():
    """A density computed from a standard atmosphere would contradict the measured dynamic
    pressure.
    """
    given = 0.95 * float(AIR.density) + np.zeros(T.size)
    for without in ((), ("altitude",)):
        result = np.asarray(density_of(level(without=without, density=given)))
        np.testing.assert_allclose(0.5 * result * LEVEL["V"] ** 2, LEVEL["qbar"], rtol=1e-9)
    few = np.where(np.arange(T.size) < 5, LEVEL["qbar"], np.nan)
    for record in (level(without=("qbar",), density=given), level(density=given, qbar=few)):
        np.testing.assert_allclose(np.asarray(density_of(record)), given)
    np.testing.assert_allclose(np.asarray(density_of(level(density=given), "indicated")), given)


def test_gaps_of_qbar_are_interpolated_and_a_density_channel_is_unchanged():
    qbar = np.full(T.size, LEVEL["qbar"])
    qbar[5:9] = np.nan
    result = np.asarray(density_of(level(without=("altitude",), qbar=qbar)))
    np.testing.assert_allclose(result, float(AIR.density), rtol=1e-9)
    density = 1.0 + 0.001 * T
    recorded = level(without=("qbar",), density=density)
    np.testing.assert_allclose(np.asarray(density_of(recorded)), density)
    apart = np.arange(T.size) % 2 == 0
    lost = level(qbar=np.where(apart, LEVEL["qbar"], np.nan), V=np.where(apart, np.nan, LEVEL["V"]))
    assert not np.isfinite(np.asarray(density_of(lost))).any()


def test_density_and_altitude_come_from_the_first_available_source():
    bare = ("qbar", "altitude")
    assert {"altitude", "density"} <= set(model_of(level()).inputs)
    no_altitude = model_of(level(without=("altitude",)))
    assert float(no_altitude.held["altitude"]) == pytest.approx(1500.0, abs=1.0)
    assert {"density", "altitude"} & set(model_of(level(without=("qbar",))).inputs) == {"altitude"}
    constants = MASS | SIZE | {"density": 1.0, "altitude": 2000.0}
    held = model_of(level(without=bare, constants=constants)).held
    assert (float(held["density"]), float(held["altitude"])) == (1.0, 2000.0)
    assert float(model_of(level(without=bare), held={"altitude": 900.0}).held["altitude"]) == 900.0
    assert float(model_of(level(without=bare), held={"density": 1.225}).held["altitude"]) == 0.0
    refused(["has no data of the air", "held={'altitude': 3000.0}"], level(without=bare))


def test_altitude_of_a_density_is_limited_to_the_atmosphere():
    assert altitude_of(float(AIR.density)) == pytest.approx(1500.0, abs=0.5)
    assert (altitude_of(1.4), altitude_of(0.01)) == (0.0, 20000.0)


def test_model_uses_the_density_of_the_record():
    """With qbar 10 % above the standard atmosphere every coefficient is 10 % smaller."""
    denser, plain = level(qbar=1.1 * LEVEL["qbar"]), level(without=("qbar",))
    measured, standard = (model_of(made).pseudo_measurements(made) for made in (denser, plain))
    np.testing.assert_allclose(measured.signals["qbar"], 1.1 * standard.signals["qbar"], rtol=1e-9)
    np.testing.assert_allclose(measured.responses["CZ"], standard.responses["CZ"] / 1.1, rtol=1e-9)
    prepared = model_of(denser).prepared(denser)
    np.testing.assert_allclose(prepared.channel("density"), 1.1 * AIR.density, rtol=1e-9)
    assert prepared.input_units[prepared.inputs.index("density")] == "kg/m^3"


# Missing channels ---------------------------------------------------------------------------------


def test_missing_surface_is_refused_if_it_moves_an_equation():
    refused(["no rudder", "v, p, r", "held={'rudder': 0.0}"], level(without=("rudder",)))
    refused(["no stabilator", "u, w, q"], level(without=("stabilator",)), states="longitudinal")
    model = model_of(level(without=("aileron", "rudder")), states="longitudinal")
    assert {n: float(model.held[n]) for n in ("aileron", "rudder")} == {
        "aileron": 0.0,
        "rudder": 0.0,
    }


def test_longitudinal_record_without_lateral_channels_is_symmetric_flight():
    record = level(
        without=("aileron", "rudder", "beta", "p", "r", "phi", "psi", "ay", "pdot", "rdot")
    )
    model = model_of(record, states="longitudinal")
    assert {n: float(model.held[n]) for n in ("v", "p", "r", "phi")} == dict.fromkeys(
        ("v", "p", "r", "phi"), 0.0
    )
    result = model.pseudo_measurements(record)
    assert set(result.responses) == {"CX", "CZ", "Cm"}
    assert bool(jnp.all(result.valid))


def test_candidate_effects_have_an_influence_on_the_outputs():
    """In symmetric flight lateral effects and effects on unused sensors are left out."""
    record = level(
        without=("aileron", "rudder", "beta", "p", "r", "phi", "psi", "ay", "pdot", "rdot")
    )
    model = with_polynomials(
        model_of(record, states="longitudinal"),
        {name: Polynomial({"1": 0.0, "alpha": 0.0}) for name in ("CX", "CZ", "Cm")},
    )
    names = [effect.name for effect in model.effects()]
    assert {
        "alpha^2 in CZ",
        "static separation (from 60%)",
        "separation with hysteresis (from 65%)",
    } <= {*names}
    assert {"shift of moment of inertia Iy", "shift of position of the sensor of az along x"} <= {
        *names
    }
    lateral = (
        "beta",
        "phat",
        "rhat",
        "Ix",
        "Iz",
        "sideways",
        "sensor of ay",
        "sensor of p",
        "angular momentum",
    )
    assert [name for name in names if any(part in name for part in lateral)] == []


def test_measured_rate_has_sensor_effects_but_no_actuator_effects():
    model = model_of(level(), states=("u", "w", "pitch"))
    names = {effect.name for effect in general_effects(model, ())}
    assert {
        "bias of input q",
        "scale of input q",
        "delay of input q",
        "dead zone of input stabilator",
    } <= names
    assert names.isdisjoint(
        {"dead zone of input q", "q between samples", "bias of input stabilator"}
    )


def test_regression_without_angular_acceleration_is_refused_with_a_remedy():
    record = level(without=("pdot", "qdot", "rdot"))
    with pytest.raises(
        InputError,
        match=r"needs 'pdot'.*differentiate\(record, \{'p': 'pdot'\}, "
        r"Fourier\(\)\)",
    ):
        model_of(record).pseudo_measurements(record)


def test_stack_is_refused():
    refused(["stack of records"], stack([level(), level()]))


# Magnitudes ---------------------------------------------------------------------------------------

WRONG = {
    "alpha in degrees": ({"alpha": 5.0}, ["alpha reaches 5 rad", "looks like degrees"]),
    "elevator in degrees": ({"stabilator": -2.0}, ["stabilator reaches 2 rad"]),
    "rates in degrees": ({"q": 10.0}, ["q reaches 10 rad/s", "573"]),
    "az in g": ({"az": -1.0}, ["az is -1 m/s^2", "in g, or without gravity"]),
    "az up": ({"az": 9.8}, ["az is 9.8 m/s^2", "positive up", "signs={'az': -1}"]),
    "az up in g": ({"az": 1.0}, ["in g and positive up"]),
    "V in knots": ({"V": 75.0 / 0.514444}, ["2 qbar / V^2", "altitude of 1500 m"]),
    "V indicated": (
        {"V": 75.0 * np.sqrt(float(AIR.density) / 1.225)},
        ["1.23", "1.06 at its altitude", "true airspeed"],
    ),
    "density in slugs": ({"density": 0.002, "without": ("qbar",)}, ["0.002 kg/m^3", "`density`"]),
}


@pytest.mark.parametrize("case", WRONG)
def test_implausible_unit_or_sign_is_refused(case):
    changed, words = WRONG[case]
    record = level(**changed)
    refused(["level", *words], record)
    model_of(record, check=False)


def test_implausible_weight_or_area_is_refused():
    refused(["coefficient of", "39"], level(constants={**MASS, **SIZE, "mass": 5e6}))
    with pytest.raises(InputError, match="force coefficient"):
        require_plausible(
            level(without=("qbar", "altitude"), constants=MASS | SIZE), mass=5000.0, S=1e5
        )


def test_few_outliers_and_declared_indicated_airspeed_are_accepted():
    alpha = np.full(T.size, 0.09)
    alpha[7] = 5.0
    model_of(level(alpha=alpha))
    indicated = level(without=("qbar",), V=75.0 * np.sqrt(float(AIR.density) / 1.225))
    assert model_of(indicated, airspeed="indicated").inputs[-1] == "altitude"


# Kinematics ---------------------------------------------------------------------------------------


def test_kinematic_model_has_the_kinematic_outputs_of_the_record():
    model = kinematics_of(level(without=("psi", "beta")))
    assert model.outputs == ("V", "alpha", "phi", "pitch", "altitude")
    assert model.beta == "sideslip"
    assert kinematics_of(level(), beta="vane", instruments=Instruments(("V",))).outputs == ("V",)
    with pytest.raises(InputError, match="nothing to agree with"):
        kinematics_of(level(without=("V", "alpha", "beta", "phi", "pitch", "psi", "altitude")))


def test_lateral_outputs_without_lateral_channels_are_not_left_out_silently():
    record = level(without=("ay", "p", "r"))
    with pytest.raises(InputError, match=r"beta, phi, psi.*none of ay, p and r"):
        kinematics_of(record)
    assert kinematics_of(record, longitudinal=True).outputs == ("V", "alpha", "pitch", "altitude")


def test_replaced_constant_of_a_record_is_used():
    record = dataclasses.replace(level(), constants={**MASS, **SIZE, "mass": jnp.asarray(4500.0)})
    assert float(model_of(record).airframe.mass_properties.mass) == 4500.0


def test_airframe_without_stops_serves_identification_and_measured_surfaces():
    model = model_of(level(), states="longitudinal")
    assert model.airframe.limits == {}
    Aircraft(model.airframe, controls=MeasuredSurfaces())
    with pytest.raises(InputError, match="no limits of its surfaces"):
        Aircraft(model.airframe)


def test_known_speed_of_sound_replaces_the_standard_one():
    model = model_of(level(), held={"sound_speed": 300.0})
    signals = model.signals(jnp.zeros(()), jnp.ones(9), jnp.ones(len(model.inputs)))
    np.testing.assert_allclose(signals["mach"], signals["V"] / 300.0, rtol=1e-14)


def test_instruments_are_also_given_by_their_arguments():
    given = {"position": {"alpha": [5.0, 0.0, 0.0]}, "bias": {"ax": 0.1}}
    model = model_of(level(), instruments=given)
    expected = model_of(level(), instruments=Instruments(**given))
    assert eqx.tree_equal(model, expected)
    refused("no argument of `Instruments` 'place'", level(), instruments={"place": {}})
