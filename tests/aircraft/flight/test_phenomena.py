"""An F-4 at high angles of attack: pitch-up, directional instability, wing rock, nose slice."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_airframe import small_airframe

from jaxid.aircraft.airframes import f4, f16
from jaxid.aircraft.flight.aircraft import Aircraft
from jaxid.aircraft.flight.departure import departure_criteria
from jaxid.aircraft.flight.report_cases import CASE_ALTITUDE, trim_at_alpha
from jaxid.aircraft.flight.simulate_flight import simulate_flight
from jaxid.aircraft.physics.frames import quaternion, velocity
from jaxid.aircraft.vehicle.aerodynamics import COEFFICIENTS
from jaxid.data.signals import half_sine, ramp

DEG = np.pi / 180
TRIM = {"stabilator": jnp.asarray(-5.0 * DEG)}


@pytest.fixture(scope="module")
def criteria():
    """Departure criteria of the `f4` from 0 to 45 deg in steps of half a degree."""
    alpha = np.arange(0.0, 45.1, 0.5)
    return alpha, jax.jit(lambda a: departure_criteria(f4(), a, TRIM))(jnp.asarray(alpha * DEG))


def test_departure_criteria_equal_the_derivatives_of_polynomials():
    frame, alpha = small_airframe(), np.array([0.1, 0.4])
    result = jax.jit(lambda a: departure_criteria(frame, a))(alpha)
    np.testing.assert_allclose(result.Cm_alpha, -0.35, rtol=1e-12)
    np.testing.assert_allclose(result.Cn_beta, 0.1, rtol=1e-12)
    np.testing.assert_allclose(result.Cl_beta, -0.08, rtol=1e-12)
    expected = 0.1 * np.cos(alpha) + 189543.0 / 33855.0 * 0.08 * np.sin(alpha)
    np.testing.assert_allclose(result.Cn_beta_dyn, expected, rtol=1e-12)


def test_directional_stability_is_lost_between_15_and_25_deg(criteria):
    alpha, result = criteria
    lost = alpha[np.flatnonzero(np.diff(np.sign(result.Cn_beta)))]
    assert len(lost) == 1
    assert 15.0 < lost[0] < 25.0
    assert result.Cn_beta[0] > 0


def test_f16_loses_directional_stability_between_26_and_31_deg():
    """NASA TP-1538: near 29 deg with the flap fully down."""
    alpha = np.arange(20.0, 40.0, 0.5)
    result = jax.jit(lambda a: departure_criteria(f16(flap_deg=25.0), a))(jnp.asarray(alpha * DEG))
    assert 26.0 < alpha[np.argmax(np.asarray(result.Cn_beta) < 0)] < 31.0


def test_f4_pitches_up_near_15_deg(criteria):
    alpha, result = criteria
    up = alpha[np.asarray(result.Cm_alpha) > 0]
    assert 11.0 < up[0] < 15.0 < up[-1] < 18.0


def test_one_stabilator_angle_balances_three_angles_of_attack():
    """The pitch-up is the reason: about 10, 14 and 18 deg with the trim of 10 deg."""
    alpha = jnp.asarray(np.arange(5.0, 22.0, 0.05) * DEG)
    still = dict.fromkeys(("beta", "aileron", "rudder", "phat", "qhat", "rhat"), jnp.zeros(()))
    aerodynamics = f4().aerodynamics
    pitching = COEFFICIENTS.index("Cm")

    def moment(angle, stabilator):
        return aerodynamics.coefficients(still | {"alpha": angle, "stabilator": stabilator})[
            pitching
        ]

    at_zero, at_one = (moment(jnp.asarray(10.0 * DEG), jnp.asarray(s)) for s in (0.0, 1.0))
    stabilator = -at_zero / (at_one - at_zero)
    Cm = np.asarray(jax.jit(jax.vmap(moment, (0, None)))(alpha, stabilator))
    balanced = np.asarray(alpha)[np.flatnonzero(np.diff(np.sign(Cm)))] / DEG
    np.testing.assert_allclose(balanced, [10.0, 14.0, 18.0], atol=1.0)


@pytest.fixture(scope="module")
def pulled():
    """Two flights of 30 s from level flight at 20 deg: a pull and a rudder pulse."""
    aircraft, alpha = Aircraft(f4()), 20.0 * DEG
    trim = trim_at_alpha(aircraft, alpha, CASE_ALTITUDE)
    surfaces = {"stabilator": trim.value("stabilator"), "aileron": 0.0, "rudder": 0.0}
    aircraft = aircraft.trimmed(surfaces, trim.value("thrust"))
    place = jnp.array([0.0, 0.0, CASE_ALTITUDE])
    state = aircraft.flight_state(
        velocity(trim.value("V"), alpha, 0.0), jnp.zeros(3), quaternion(0.0, alpha, 0.0), place
    )
    t = 0.1 * jnp.arange(300, dtype=float)
    flights = {}
    for degrees in (-2.0, -8.0):
        inputs = {
            "pilot_stabilator": ramp(t, 1.0, 4.0, degrees * DEG),
            "pilot_rudder": half_sine(t, 1.0, 1.0, DEG),
        }
        with pytest.warns(UserWarning, match="outside 5 to 21 deg"):
            truth = simulate_flight(aircraft, t, inputs, state, key=jax.random.key(0)).truth
        flights[degrees] = {name: np.asarray(truth.channel(name)) for name in truth.outputs}
    return np.asarray(t), flights


def stiffness(criteria, alpha_deg, qbar):
    """`qbar S b Cn_beta_dyn / Iz` [1/s^2]."""
    frame = f4()
    scale = float(frame.S * frame.b / frame.mass_properties.Iz)
    return qbar * scale * np.interp(alpha_deg, criteria[0], np.asarray(criteria[1].Cn_beta_dyn))


def test_wing_rock_at_21_deg_has_the_period_of_the_criterion(criteria, pulled):
    """A limit cycle in roll; the report's simulation had 7.5 s, its flight test 4.5 s."""
    t, histories = pulled[0], pulled[1][-2.0]
    late = t > 15.0
    # it grows from a rudder pulse of 1 deg
    assert np.ptp(histories["phi"][late]) / 2 > 5.0 * DEG
    assert np.max(np.abs(histories["beta"])) < 10.0 * DEG  # and does not depart
    up = np.flatnonzero((histories["p"][:-1] < 0) & (histories["p"][1:] >= 0) & late[1:])
    period = np.mean(np.diff(t[up]))
    assert 4.5 < period < 7.5
    predicted = (
        2
        * np.pi
        / np.sqrt(
            stiffness(
                criteria, np.mean(histories["alpha"][late]) / DEG, np.mean(histories["qbar"][late])
            )
        )
    )
    assert period == pytest.approx(predicted, rel=0.15)


def test_nose_slice_at_25_deg_grows_at_the_rate_of_the_criterion(criteria, pulled):
    t, histories = pulled[0], pulled[1][-8.0]
    beta = np.abs(histories["beta"]) / DEG
    assert np.max(beta) > 40.0
    grows = (t > 7.0) & (np.cumsum(beta > 15.0) == 0) & (beta > 1.0)
    rate = np.polyfit(t[grows], np.log(beta[grows]), 1)[0]
    alpha, qbar = (np.mean(histories[name][grows]) for name in ("alpha", "qbar"))
    predicted = stiffness(criteria, alpha / DEG, qbar)
    assert predicted < 0
    assert rate == pytest.approx(np.sqrt(-predicted), rel=0.25)
