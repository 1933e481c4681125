"""The report's test cases: what is printed is flown, the records are as said, and what is unprinted is told."""

import warnings
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft.flights import ALTITUDE, CASES, EXAMPLES, flight, hold_alpha, pilot_inputs, settings, start
from jaxid.aircraft.fly import fly
from jaxid.aircraft.noise_levels import BASE, HIGH
from jaxid.data.signals import sine

DOCS = Path(__file__).resolve().parents[2] / "docs"
FOOT = 0.3048
# Figure 6.2: seconds, V [ft/s], alpha and pitch [deg], when the stability augmentation comes on [s].
PRINTED = {
    **{f"lateral {i}": (10.0, 445.0, 17.5, 7.5) for i in (1, 2, 3)},
    "lateral 4": (10.0, 445.0, 17.5, None),
    **{f"longitudinal {i}": (10.0, 550.0, 10.0, None) for i in (1, 2)},
    "coupled 1": (15.0, 464.0, 15.0, 10.0),
    "coupled 2": (10.0, 464.0, 15.0, None),
}
TRUSTED_ALL_ALONG = {"lateral 1", "lateral 2", "longitudinal 2", "coupled 2"}
HIDE = pytest.mark.filterwarnings("ignore:Flight .* outside 5 to 21 deg")


@pytest.fixture(scope="module")
def flights():
    """All eight, and what was warned of; three structures are compiled: 10 s, with gusts, and 15 s."""
    flown, warned = {}, {}
    for name in CASES:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            flown[name] = flight(name, jax.random.key(1974))
        warned[name] = [str(one.message) for one in caught]
    return flown, warned


@pytest.mark.parametrize("case", CASES)
def test_a_case_is_flown_as_printed(flights, case):
    one = flights[0][case]
    seconds, V, alpha, augmentation_on = PRINTED[case]
    np.testing.assert_allclose(one.record.t, 0.1 * np.arange(10 * seconds), atol=1e-12)
    at_start = {name: float(one.truth.channel(name)[0]) for name in one.truth.outputs}
    if case == "lateral 3":  # relative to the air there is a gust on top
        at_start |= {
            "V": np.sqrt(sum(at_start[i] ** 2 for i in "uvw")),
            "alpha": np.arctan2(at_start["w"], at_start["u"]),
        }
        at_start |= {"beta": at_start["v"] / at_start["V"]}
    expected = {"V": V * FOOT, "alpha": np.radians(alpha), "pitch": np.radians(alpha), "altitude": 35000 * FOOT}
    expected |= dict.fromkeys(("beta", "p", "q", "r", "phi", "psi"), 0.0)
    np.testing.assert_allclose([at_start[name] for name in expected], list(expected.values()), rtol=1e-12, atol=1e-12)
    assert CASES[case].augmentation_on == augmentation_on
    assert np.all(np.isfinite(one.truth.z))
    assert bool(np.all(one.record.mask))


def test_the_pilot_does_what_is_said(flights):
    one = flights[0]["lateral 1"].record
    t, degrees = (
        np.asarray(one.t),
        {s: np.degrees(one.channel(f"pilot_{s}")) for s in ("rudder", "aileron", "stabilator")},
    )
    np.testing.assert_allclose(degrees["rudder"], np.where(t <= 2.5, 10 * np.sin(np.pi * t / 2.5), 0.0), atol=1e-9)
    doublet = np.where((t >= 2.5) & (t <= 5.0), 7 * np.sin(2 * np.pi * (t - 2.5) / 2.5), 0.0)
    np.testing.assert_allclose(degrees["aileron"], doublet, atol=1e-9)
    assert not np.any(degrees["stabilator"])
    stabilator = flights[0]["longitudinal 1"].record.channel("pilot_stabilator")
    np.testing.assert_allclose(stabilator, sine(jnp.asarray(t), 0.25, np.radians(-4.0)), atol=1e-12)


def test_the_surfaces_follow_the_pilot_about_the_trim(flights):
    """Lag 0.05 s behind a sine of 4 s: 4.5 deg in phase, less than half a per cent in amplitude, once it has swung in."""
    truth = flights[0]["longitudinal 1"].truth
    stabilator, t = np.asarray(truth.channel("stabilator")), np.asarray(truth.t)
    w = 2 * np.pi / 4
    followed = np.radians(-4) * (np.sin(w * t) - 0.05 * w * np.cos(w * t)) / (1 + (0.05 * w) ** 2)
    np.testing.assert_allclose((stabilator - stabilator[0])[5:], followed[5:], atol=np.radians(0.01))


@pytest.mark.parametrize(("case", "quiet", "on"), [("lateral 1", 6.0, 7.5), ("coupled 1", 6.0, 10.0)])
def test_the_augmentation_comes_on_at_its_time(flights, case, quiet, on):
    """The pilot leaves aileron and rudder alone after 5 s; from then on they move by feedback only."""
    truth = flights[0][case].truth
    t, p = np.asarray(truth.t), np.asarray(truth.channel("p"))
    aileron, rudder = (np.asarray(truth.channel(name)) for name in ("aileron", "rudder"))
    before = (t >= quiet) & (t <= on + 1e-9)
    assert np.max(np.abs(p[before])) > np.radians(1.0)  # there is something to feed back
    np.testing.assert_allclose(aileron[before], 0.0, atol=1e-8)  # exp(-1/0.05) of 7 deg
    np.testing.assert_allclose(rudder[before], 0.0, atol=1e-8)
    after = t > on + 0.5
    behind = 0.265 * np.interp(t - 0.05, t, p)  # a lag of 0.05 s is nearly a delay of 0.05 s
    scale = np.max(np.abs(0.265 * p[after]))
    np.testing.assert_allclose(aileron[after], behind[after], atol=0.1 * scale)
    assert np.max(np.abs(rudder[after])) > np.radians(0.2)


def test_the_same_key_gives_the_same_record_and_another_key_other_errors(flights):
    first = flights[0]["lateral 1"]
    again, other = flight("lateral 1", jax.random.key(1974)), flight("lateral 1", jax.random.key(1))
    np.testing.assert_array_equal(again.record.z, first.record.z)
    np.testing.assert_array_equal(other.truth.z, first.truth.z)
    differ = np.std(np.asarray(other.record.z) - np.asarray(first.record.z), axis=0) > 0
    exact = {"altitude", "stabilator", "aileron", "rudder", "thrust"} & set(first.record.outputs)
    assert {name for name, yes in zip(first.record.outputs, differ, strict=True) if not yes} == exact


def test_noise_has_the_level_that_is_said(flights):
    """The difference of two flights of one aircraft, under two keys, is noise alone.

    Its standard deviation over 100 samples is right within 1/sqrt(200); 35 % are five of these.
    """
    for case, level in (("lateral 1", BASE), ("lateral 2", HIGH)):
        one, (t, inputs) = flights[0][case], pilot_inputs(CASES[case])
        state = start(CASES[case])[1]
        a, b = (fly(one.aircraft, t, inputs, state, key=jax.random.key(k)).record.z for k in (1, 2))
        sigma = np.array([level.noise.get(name, 0.0) for name in one.record.outputs])
        np.testing.assert_allclose(np.std(np.asarray(a - b), axis=0) / np.sqrt(2.0), sigma, rtol=0.35)


def test_high_noise_draws_the_same_errors_larger(flights):
    """One key draws one set of normal numbers: biases grow as the level does."""
    base, high = (flights[0][f"lateral {i}"].aircraft.instruments for i in (1, 2))
    for name in ("alpha", "p", "pitch"):
        np.testing.assert_allclose(high.bias[name] / base.bias[name], HIGH.bias[name] / BASE.bias[name], rtol=1e-12)


def test_gusts_have_the_printed_size(flights):
    truth = flights[0]["lateral 3"].truth
    for name in ("true_gust_v", "true_gust_w"):  # 100 samples: five standard errors
        assert np.std(np.asarray(truth.channel(name))) == pytest.approx(21.2 * FOOT, rel=0.35)
    assert "gust_v" not in flights[0]["lateral 3"].record.inputs  # nobody records them


def test_a_flight_that_leaves_what_the_tables_know_is_told(flights):
    assert {name for name, told in flights[1].items() if not told} == TRUSTED_ALL_ALONG
    (told,) = flights[1]["longitudinal 1"]
    assert "alpha is outside 5 to 21 deg" in told
    assert "13 % of the samples" in told
    with pytest.warns(
        UserWarning, match=r"Flight 'longitudinal 1': alpha is outside 5 to 21 deg.*f4.*reaches 3.4 to 21.5"
    ):
        flight("longitudinal 1", jax.random.key(0))


def test_hold_alpha_balances_forward_force_and_pitching_moment():
    """At the printed speed; where the speed is free, the normal force too."""
    rates = eqx.filter_jit(lambda aircraft, state: aircraft.rhs(jnp.zeros(()), state, jnp.zeros(3))[:6])
    for case in (CASES["lateral 1"], EXAMPLES["aileron doublet at 15 deg"]):
        udot, vdot, wdot, *turning = rates(*start(case))
        np.testing.assert_allclose([udot, vdot, *turning], 0.0, atol=1e-9)
        if case.V is None:
            assert float(wdot) == pytest.approx(0.0, abs=1e-9)
        else:  # the printed speed carries the weight to 2 % of it
            assert 0.01 < abs(float(wdot)) < 0.21


@HIDE
@pytest.mark.parametrize("case", ["rudder doublet at 25 deg", "stabilator sine of 10 deg"])
def test_an_example_is_level_flight_without_errors_of_the_instruments(case):
    one = flight(case, jax.random.key(0))
    assert one.record.t.size == 10 * EXAMPLES[case].seconds
    np.testing.assert_allclose(one.truth.channel("alpha")[0], EXAMPLES[case].alpha, rtol=1e-12)
    np.testing.assert_allclose(one.record.channel("p"), one.truth.channel("p"), atol=1e-15)
    still = np.asarray(one.record.t) < 0.45
    if "doublet" in case:  # nothing moves before it
        np.testing.assert_allclose(np.ptp(np.asarray(one.truth.channel("alpha"))[still]), 0.0, atol=1e-5)


def test_unknown_cases_are_refused():
    with pytest.raises(InputError, match=r"no case 'lateral 5'. Did you mean 'lateral"):
        flight("lateral 5", jax.random.key(0))


def test_what_no_speed_holds_is_refused():
    aircraft, _ = start(CASES["lateral 1"])
    with pytest.raises(InputError, match=r"alpha is -0.1 rad"):
        hold_alpha(aircraft, -0.1, ALTITUDE)


def test_the_table_of_settings_is_the_one_in_the_documents():
    written = (DOCS / "flights.md").read_text(encoding="utf-8")
    assert settings() in written, "docs/flights.md is not what flights.settings() gives; write its output there."
    assert all(f"| {case} |" in written for case in CASES | EXAMPLES)
