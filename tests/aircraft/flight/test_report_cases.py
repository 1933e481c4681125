"""The report's test cases: printed settings, records, and documentation of the other settings."""

import warnings
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft.flight.report_cases import (
    CASE_ALTITUDE,
    CASES,
    EXAMPLES,
    initial_condition,
    pilot_inputs,
    report_flight,
    settings,
    trim_at_alpha,
)
from jaxid.aircraft.flight.simulate_flight import simulate_flight
from jaxid.aircraft.instruments.noise_levels import BASE, HIGH
from jaxid.data.signals import sine

DOCS = Path(__file__).resolve().parents[3] / "docs"
FOOT = 0.3048
# Figure 6.2: duration [s], V [ft/s], alpha and pitch [deg], time at which the stability
# augmentation is switched on [s].
PRINTED = {
    **{f"lateral {i}": (10.0, 445.0, 17.5, 7.5) for i in (1, 2, 3)},
    "lateral 4": (10.0, 445.0, 17.5, None),
    **{f"longitudinal {i}": (10.0, 550.0, 10.0, None) for i in (1, 2)},
    "coupled 1": (15.0, 464.0, 15.0, 10.0),
    "coupled 2": (10.0, 464.0, 15.0, None),
}
TRUSTED_CASES = {"lateral 1", "lateral 2"}
IGNORE_RANGE = pytest.mark.filterwarnings("ignore:Flight .* outside 5 to 21 deg")


@pytest.fixture(scope="module")
def flights():
    """All eight flights, and their warnings. Three programs are compiled: 10 s, gusts, and 15 s."""
    results, messages = {}, {}
    for name in CASES:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            results[name] = report_flight(name, jax.random.key(1974))
        messages[name] = [str(warning.message) for warning in caught]
    return results, messages


@pytest.mark.parametrize("case", CASES)
def test_case_has_the_printed_settings(flights, case):
    flight = flights[0][case]
    seconds, V, alpha, augmentation_on = PRINTED[case]
    np.testing.assert_allclose(flight.record.t, 0.1 * np.arange(10 * seconds), atol=1e-12)
    at_start = {name: float(flight.truth.channel(name)[0]) for name in flight.truth.outputs}
    if case == "lateral 3":  # the velocity relative to the air includes a gust
        at_start |= {
            "V": np.sqrt(sum(at_start[i] ** 2 for i in "uvw")),
            "alpha": np.arctan2(at_start["w"], at_start["u"]),
        }
        at_start |= {"beta": at_start["v"] / at_start["V"]}
    expected = {
        "V": V * FOOT,
        "alpha": np.radians(alpha),
        "pitch": np.radians(alpha),
        "altitude": 35000 * FOOT,
    }
    expected |= dict.fromkeys(("beta", "p", "q", "r", "phi", "psi"), 0.0)
    np.testing.assert_allclose(
        [at_start[name] for name in expected], list(expected.values()), rtol=1e-12, atol=1e-12
    )
    assert CASES[case].augmentation_on == augmentation_on
    assert np.all(np.isfinite(flight.truth.z))
    assert bool(np.all(flight.record.mask))


def test_pilot_inputs_have_the_described_form(flights):
    record = flights[0]["lateral 1"].record
    t, degrees = (
        np.asarray(record.t),
        {s: np.degrees(record.channel(f"pilot_{s}")) for s in ("rudder", "aileron", "stabilator")},
    )
    np.testing.assert_allclose(
        degrees["rudder"], np.where(t <= 2.5, 10 * np.sin(np.pi * t / 2.5), 0.0), atol=1e-9
    )
    doublet = np.where((t >= 4.0) & (t <= 6.5), 7 * np.sin(2 * np.pi * (t - 4.0) / 2.5), 0.0)
    np.testing.assert_allclose(degrees["aileron"], doublet, atol=1e-9)
    assert not np.any(degrees["stabilator"])
    stabilator = flights[0]["longitudinal 1"].record.channel("pilot_stabilator")
    np.testing.assert_allclose(stabilator, sine(jnp.asarray(t), 0.25, np.radians(-4.0)), atol=1e-12)


def test_surfaces_follow_the_pilot_about_the_trim(flights):
    """A lag of 0.05 s changes a sine of 4 s by 4.5 deg in phase and less than 0.5 % in amplitude.

    The values are those of the steady state.
    """
    truth = flights[0]["longitudinal 1"].truth
    stabilator, t = np.asarray(truth.channel("stabilator")), np.asarray(truth.t)
    w = 2 * np.pi / 4
    followed = np.radians(-4) * (np.sin(w * t) - 0.05 * w * np.cos(w * t)) / (1 + (0.05 * w) ** 2)
    np.testing.assert_allclose(
        (stabilator - stabilator[0])[5:], followed[5:], atol=np.radians(0.01)
    )


@pytest.mark.parametrize(
    ("case", "quiet", "on"), [("lateral 1", 7.4, 7.5), ("coupled 1", 7.5, 10.0)]
)
def test_augmentation_switches_on_at_its_time(flights, case, quiet, on):
    """The pilot does not move aileron and rudder after 6.5 s; then they move by feedback only."""
    truth = flights[0][case].truth
    t, p = np.asarray(truth.t), np.asarray(truth.channel("p"))
    aileron, rudder = (np.asarray(truth.channel(name)) for name in ("aileron", "rudder"))
    before = (t >= quiet) & (t <= on + 1e-9)
    assert np.max(np.abs(p[before])) > np.radians(1.0)  # the feedback is not zero
    np.testing.assert_allclose(aileron[before], 0.0, atol=1e-8)  # exp(-0.9/0.05) of 7 deg
    np.testing.assert_allclose(rudder[before], 0.0, atol=1e-8)
    after = t > on + 0.5
    behind = 0.265 * np.interp(t - 0.05, t, p)  # a lag of 0.05 s is nearly a delay of 0.05 s
    scale = np.max(np.abs(0.265 * p[after]))
    np.testing.assert_allclose(aileron[after], behind[after], atol=0.1 * scale)
    assert np.max(np.abs(rudder[after])) > np.radians(0.2)


def test_same_key_gives_the_same_record_and_another_key_other_errors(flights):
    first = flights[0]["lateral 1"]
    again, other = (
        report_flight("lateral 1", jax.random.key(1974)),
        report_flight("lateral 1", jax.random.key(1)),
    )
    np.testing.assert_array_equal(again.record.z, first.record.z)
    np.testing.assert_array_equal(other.truth.z, first.truth.z)
    differ = np.std(np.asarray(other.record.z) - np.asarray(first.record.z), axis=0) > 0
    exact = {"altitude", "stabilator", "aileron", "rudder", "thrust"} & set(first.record.outputs)
    assert {
        name for name, yes in zip(first.record.outputs, differ, strict=True) if not yes
    } == exact


def test_noise_has_the_declared_level(flights):
    """The difference of two flights of the same aircraft with different keys is noise alone.

    Its standard deviation over 100 samples has a relative error of 1/sqrt(200); 35 % are five of
    these.
    """
    for case, level in (("lateral 1", BASE), ("lateral 2", HIGH)):
        flight, (t, inputs) = flights[0][case], pilot_inputs(CASES[case])
        state = initial_condition(CASES[case])[1]
        a, b = (
            simulate_flight(flight.aircraft, t, inputs, state, key=jax.random.key(k)).record.z
            for k in (1, 2)
        )
        sigma = np.array([level.noise.get(name, 0.0) for name in flight.record.outputs])
        np.testing.assert_allclose(
            np.std(np.asarray(a - b), axis=0) / np.sqrt(2.0), sigma, rtol=0.35
        )


def test_instrument_errors_are_proportional_to_the_noise_level(flights):
    """The same key draws the same normal numbers: biases are proportional to the level."""
    base, high = (flights[0][f"lateral {i}"].aircraft.instruments for i in (1, 2))
    for name in ("alpha", "p", "pitch"):
        np.testing.assert_allclose(
            high.bias[name] / base.bias[name], HIGH.bias[name] / BASE.bias[name], rtol=1e-12
        )


def test_gusts_have_the_printed_size(flights):
    truth = flights[0]["lateral 3"].truth
    for name in ("true_gust_v", "true_gust_w"):  # 100 samples: five standard errors
        assert np.std(np.asarray(truth.channel(name))) == pytest.approx(21.2 * FOOT, rel=0.35)
    assert "gust_v" not in flights[0]["lateral 3"].record.inputs  # they are not recorded


def test_flight_outside_the_trusted_range_warns(flights):
    assert {name for name, messages in flights[1].items() if not messages} == TRUSTED_CASES
    (message,) = flights[1]["longitudinal 1"]
    assert "alpha is outside 5 to 21 deg" in message
    assert "12 % of the samples" in message
    with pytest.warns(
        UserWarning,
        match=r"Flight 'longitudinal 1': alpha is outside 5 to 21 deg.*f4.*reaches "
        r"3.45 to 21.2",
    ):
        report_flight("longitudinal 1", jax.random.key(0))


def test_trim_at_alpha_balances_forward_force_and_pitching_moment():
    """At the printed speed; with a free speed it balances the normal force too."""
    rates = eqx.filter_jit(
        lambda aircraft, state: aircraft.rhs(jnp.zeros(()), state, jnp.zeros(3))[:6]
    )
    for case in (CASES["lateral 1"]._replace(trim=0.0), EXAMPLES["aileron doublet at 15 deg"]):
        udot, vdot, wdot, *turning = rates(*initial_condition(case))
        np.testing.assert_allclose([udot, vdot, *turning], 0.0, atol=1e-9)
        if case.V is None:
            assert float(wdot) == pytest.approx(0.0, abs=1e-9)
        else:  # at the printed speed the normal force is within 2 % of the weight
            assert 0.01 < abs(float(wdot)) < 0.21


@IGNORE_RANGE
@pytest.mark.parametrize("case", ["rudder doublet at 25 deg", "stabilator sine of 10 deg"])
def test_example_starts_in_level_flight_without_instrument_errors(case):
    flight = report_flight(case, jax.random.key(0))
    assert flight.record.t.size == 10 * EXAMPLES[case].seconds
    np.testing.assert_allclose(flight.truth.channel("alpha")[0], EXAMPLES[case].alpha, rtol=1e-12)
    np.testing.assert_allclose(flight.record.channel("p"), flight.truth.channel("p"), atol=1e-15)
    still = np.asarray(flight.record.t) < 0.45
    if "doublet" in case:  # the aircraft is steady before it
        np.testing.assert_allclose(
            np.ptp(np.asarray(flight.truth.channel("alpha"))[still]), 0.0, atol=1e-5
        )


def test_unknown_case_is_refused():
    with pytest.raises(InputError, match=r"no case 'lateral 5'. Did you mean 'lateral"):
        report_flight("lateral 5", jax.random.key(0))


def test_trim_at_alpha_refuses_a_negative_angle():
    aircraft, _ = initial_condition(CASES["lateral 1"])
    with pytest.raises(InputError, match=r"alpha is -0.1 rad"):
        trim_at_alpha(aircraft, -0.1, CASE_ALTITUDE)


def test_trim_of_a_case_moves_the_stabilator_only():
    case = CASES["lateral 1"]
    aircraft, state = initial_condition(case)
    balanced, still = initial_condition(case._replace(trim=0.0))
    at = aircraft.states.index("stabilator")
    expected = np.zeros(state.size)
    expected[at] = np.radians(-1.3)
    np.testing.assert_allclose(state - still, expected, atol=1e-12)
    np.testing.assert_allclose(
        aircraft.controls.trim - balanced.controls.trim, [np.radians(-1.3), 0, 0], atol=1e-12
    )


def test_documented_table_equals_the_settings():
    written = (DOCS / "flights.md").read_text(encoding="utf-8")
    assert settings() in written, (
        "docs/flights.md differs from report_cases.settings(); write its output there."
    )
    assert all(f"| {case} |" in written for case in CASES | EXAMPLES)
