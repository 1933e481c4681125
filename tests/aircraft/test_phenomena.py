"""What high angles of attack do to an F-4: pitch-up, loss of directional stability, wing rock and nose slice."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_airframe import small_airframe

from jaxid.aircraft.aerodynamics import COEFFICIENTS
from jaxid.aircraft.aircraft import Aircraft
from jaxid.aircraft.airframes import f4, f16
from jaxid.aircraft.departure import departure_criteria
from jaxid.aircraft.flights import ALTITUDE, hold_alpha
from jaxid.aircraft.fly import fly
from jaxid.aircraft.frames import quaternion, velocity
from jaxid.data.signals import half_sine, ramp

DEG = np.pi / 180
TRIM = {"stabilator": jnp.asarray(-5.0 * DEG)}


@pytest.fixture(scope="module")
def criteria():
    """Of the `f4` from 0 to 45 deg in steps of half a degree."""
    alpha = np.arange(0.0, 45.1, 0.5)
    return alpha, jax.jit(lambda a: departure_criteria(f4(), a, TRIM))(jnp.asarray(alpha * DEG))


def test_criteria_are_the_derivatives_of_a_polynomial_airframe():
    frame, alpha = small_airframe(), jnp.array([0.1, 0.4])
    found = departure_criteria(frame, alpha)
    np.testing.assert_allclose(found.Cm_alpha, -0.35, rtol=1e-12)
    np.testing.assert_allclose(found.Cn_beta, 0.1, rtol=1e-12)
    np.testing.assert_allclose(found.Cl_beta, -0.08, rtol=1e-12)
    expected = 0.1 * np.cos(alpha) + 189543.0 / 33855.0 * 0.08 * np.sin(alpha)
    np.testing.assert_allclose(found.Cn_beta_dyn, expected, rtol=1e-12)


def test_directional_stability_is_lost_between_15_and_25_deg(criteria):
    alpha, found = criteria
    lost = alpha[np.flatnonzero(np.diff(np.sign(found.Cn_beta)))]
    assert len(lost) == 1
    assert 15.0 < lost[0] < 25.0
    assert found.Cn_beta[0] > 0


def test_the_f16_loses_it_later():
    """NASA TP-1538: near 29 deg with the flap fully down."""
    alpha = np.arange(20.0, 40.0, 0.5)
    found = jax.jit(lambda a: departure_criteria(f16(flap_deg=25.0), a))(jnp.asarray(alpha * DEG))
    assert 26.0 < alpha[np.argmax(np.asarray(found.Cn_beta) < 0)] < 31.0


def test_it_pitches_up_near_15_deg(criteria):
    alpha, found = criteria
    up = alpha[np.asarray(found.Cm_alpha) > 0]
    assert 11.0 < up[0] < 15.0 < up[-1] < 18.0


def test_one_stabilator_holds_three_angles_of_attack():
    """Because of the pitch-up: about 10, 14 and 18 deg with the trim of 10 deg."""
    alpha = jnp.asarray(np.arange(5.0, 22.0, 0.05) * DEG)
    still = dict.fromkeys(("beta", "aileron", "rudder", "phat", "qhat", "rhat"), jnp.zeros(()))
    aerodynamics = f4().aerodynamics
    pitching = COEFFICIENTS.index("Cm")

    def moment(angle, stabilator):
        return aerodynamics.coefficients(still | {"alpha": angle, "stabilator": stabilator})[pitching]

    zero, one = (moment(jnp.asarray(10.0 * DEG), jnp.asarray(s)) for s in (0.0, 1.0))
    Cm = np.asarray(jax.jit(jax.vmap(moment, (0, None)))(alpha, -zero / (one - zero)))
    balanced = np.asarray(alpha)[np.flatnonzero(np.diff(np.sign(Cm)))] / DEG
    np.testing.assert_allclose(balanced, [10.0, 14.0, 18.0], atol=1.0)


@pytest.fixture(scope="module")
def pulled():
    """From level flight at 20 deg, pulled further and tapped with the rudder: 30 s by two pulls."""
    aircraft, alpha = Aircraft(f4()), 20.0 * DEG
    trim = hold_alpha(aircraft, alpha, ALTITUDE)
    surfaces = {"stabilator": trim.value("stabilator"), "aileron": 0.0, "rudder": 0.0}
    aircraft = aircraft.trimmed(surfaces, trim.value("thrust"))
    place = jnp.array([0.0, 0.0, ALTITUDE])
    state = aircraft.flight_state(
        velocity(trim.value("V"), alpha, 0.0), jnp.zeros(3), quaternion(0.0, alpha, 0.0), place
    )
    t = 0.1 * jnp.arange(300, dtype=float)
    flights = {}
    for degrees in (-2.0, -8.0):
        inputs = {"pilot_stabilator": ramp(t, 1.0, 4.0, degrees * DEG), "pilot_rudder": half_sine(t, 1.0, 1.0, DEG)}
        with pytest.warns(UserWarning, match="outside 5 to 21 deg"):
            truth = fly(aircraft, t, inputs, state, key=jax.random.key(0)).truth
        flights[degrees] = {name: np.asarray(truth.channel(name)) for name in truth.outputs}
    return np.asarray(t), flights


def stiffness(criteria, alpha_deg, qbar):
    """`qbar S b Cn_beta_dyn / Iz` [1/s^2]."""
    frame = f4()
    scale = float(frame.S * frame.b / frame.mass_properties.Iz)
    return qbar * scale * np.interp(alpha_deg, criteria[0], np.asarray(criteria[1].Cn_beta_dyn))


def test_at_21_deg_it_rocks_with_the_period_that_the_criterion_predicts(criteria, pulled):
    """A limit cycle in roll; the report's simulation had 7.5 s, its flight test 4.5 s."""
    t, flown = pulled[0], pulled[1][-2.0]
    late = t > 15.0
    assert np.ptp(flown["phi"][late]) / 2 > 5.0 * DEG  # it grew from a tap of 1 deg on the rudder ...
    assert np.max(np.abs(flown["beta"])) < 10.0 * DEG  # ... and does not depart
    up = np.flatnonzero((flown["p"][:-1] < 0) & (flown["p"][1:] >= 0) & late[1:])
    period = np.mean(np.diff(t[up]))
    assert 4.5 < period < 7.5
    predicted = (
        2 * np.pi / np.sqrt(stiffness(criteria, np.mean(flown["alpha"][late]) / DEG, np.mean(flown["qbar"][late])))
    )
    assert period == pytest.approx(predicted, rel=0.15)


def test_at_25_deg_the_nose_slices_at_the_rate_that_the_criterion_predicts(criteria, pulled):
    t, flown = pulled[0], pulled[1][-8.0]
    beta = np.abs(flown["beta"]) / DEG
    assert np.max(beta) > 40.0
    grows = (t > 7.0) & (np.cumsum(beta > 15.0) == 0) & (beta > 1.0)
    rate = np.polyfit(t[grows], np.log(beta[grows]), 1)[0]
    alpha, qbar = (np.mean(flown[name][grows]) for name in ("alpha", "qbar"))
    predicted = stiffness(criteria, alpha / DEG, qbar)
    assert predicted < 0
    assert rate == pytest.approx(np.sqrt(-predicted), rel=0.25)
