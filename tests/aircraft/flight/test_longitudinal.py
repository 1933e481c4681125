"""The longitudinal aircraft: physics, initial state, effects and accelerometers."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.aircraft.air.atmosphere import GRAVITY
from jaxid.aircraft.effects.coefficient_term import CoefficientTerm
from jaxid.aircraft.flight.longitudinal import LONGITUDINAL_AFFECTED_STATES, Longitudinal
from jaxid.aircraft.flight.longitudinal_flight import LONGITUDINAL_SPEED, level_trim, true_aircraft
from jaxid.data.build import record
from jaxid.data.units import to_si
from jaxid.effects import Augmented, Term
from jaxid.models import Polynomial, parameter_names
from jaxid.models.free import with_values
from jaxid.simulation import RK4, simulate

T = jnp.zeros(())


@pytest.fixture(scope="module")
def trimmed():
    """The aircraft in level flight: model, state, elevator."""
    model = true_aircraft()
    state, elevator, thrust = level_trim(model, LONGITUDINAL_SPEED)
    return eqx.tree_at(lambda m: m.thrust, model, thrust), state, elevator


def without_air(model: Longitudinal) -> Longitudinal:
    return with_values(model, ("density", "thrust"), jnp.zeros(2))


def output(model, x, u):
    return dict(zip(model.outputs, model.output(T, x, u), strict=True))


# Physics ------------------------------------------------------------------------------------------


def test_level_trim_has_zero_rates(trimmed):
    model, state, elevator = trimmed
    np.testing.assert_allclose(model.rhs(T, state, elevator[None]), 0.0, atol=1e-12)
    readings = output(model, state, elevator[None])
    np.testing.assert_allclose(readings["pitch"], readings["alpha"], rtol=1e-12)  # no climb
    np.testing.assert_allclose(readings["V"], LONGITUDINAL_SPEED, rtol=1e-12)
    assert 0.0 < float(model.thrust) < 0.5 * float(model.mass) * GRAVITY


def test_specific_force_in_trim_carries_the_weight(trimmed):
    model, state, elevator = trimmed
    readings = output(model, state, elevator[None])
    np.testing.assert_allclose(readings["az"], -GRAVITY * np.cos(state[3]), rtol=1e-12)
    np.testing.assert_allclose(readings["ax"], GRAVITY * np.sin(state[3]), rtol=1e-12)


def test_az_is_minus_one_g_at_level_attitude_and_zero_rate():
    """Only weight and the force that balances it: az = -g and ax = 0."""
    model = true_aircraft()
    x = jnp.array([LONGITUDINAL_SPEED, 0.0, 0.0, 0.0])
    readings = dict(
        zip(model.outputs, model.output_given(T, x, jnp.zeros(1), jnp.zeros(4)), strict=True)
    )
    np.testing.assert_allclose([readings["ax"], readings["az"]], [0.0, -GRAVITY], atol=1e-14)


def test_accelerometers_read_zero_in_free_fall():
    model = without_air(true_aircraft())
    readings = output(model, jnp.array([120.0, 20.0, 0.3, 0.4]), jnp.array([0.1]))
    np.testing.assert_allclose([readings["ax"], readings["az"]], 0.0, atol=1e-12)


def test_motion_without_air_is_that_of_a_projectile():
    """Horizontal velocity and pitch rate are constant; the vertical velocity decreases by g t."""
    model = without_air(true_aircraft())
    t = jnp.linspace(0.0, 5.0, 251)
    x = simulate(
        *(model, t, jnp.zeros((251, 1)), jnp.array([150.0, 10.0, 0.2, 0.5])),
        stepper=RK4(4, unrolled=False),
    ).x
    u, w, q, pitch = np.asarray(x).T
    north = u * np.cos(pitch) + w * np.sin(pitch)
    up = u * np.sin(pitch) - w * np.cos(pitch)
    np.testing.assert_allclose(north, north[0], rtol=1e-9)
    np.testing.assert_allclose(up, up[0] - GRAVITY * t, rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(q, 0.2)


def test_rate_of_energy_equals_the_power_of_the_forces(trimmed):
    """The rate of mechanical energy is the power of air forces and thrust: m (ax u + az w)."""
    model, state, elevator = trimmed
    x = state + jnp.array([5.0, 8.0, 0.1, 0.2])
    u, w, _, pitch = x
    udot, wdot, _, _ = model.rhs(T, x, elevator[None])
    climb = u * jnp.sin(pitch) - w * jnp.cos(pitch)
    readings = output(model, x, elevator[None])
    np.testing.assert_allclose(
        u * udot + w * wdot + GRAVITY * climb, readings["ax"] * u + readings["az"] * w, rtol=1e-12
    )


def test_responses_have_the_signs_of_a_stable_aircraft(trimmed):
    """Elevator down pitches down; a larger angle of attack lifts, pitches down and decelerates; a
    pitch rate is damped.
    """
    model, state, elevator = trimmed
    down = jax.jit(jax.jacfwd(lambda de: model.rhs(T, state, de)))(elevator[None])[:, 0]
    assert down[2] < 0.0
    by_state = np.asarray(jax.jit(jax.jacfwd(lambda x: model.rhs(T, x, elevator[None])))(state))
    assert by_state[1, 1] < 0.0
    assert by_state[2, 1] < 0.0
    assert by_state[2, 2] < 0.0
    readings = jax.jit(jax.jacfwd(lambda x: model.output(T, x, elevator[None])))(state)
    assert readings[4, 1] < 0.0
    eigenvalues = np.linalg.eigvals(by_state)
    short_period = eigenvalues[np.argmax(np.abs(eigenvalues))]
    assert short_period.real < 0.0
    assert 1.0 < abs(short_period) < 4.0


def test_rhs_matches_the_equations_of_the_report(trimmed):
    """E.1 and E.3 term by term, in NumPy, at a state away from trim."""
    model, _, _ = trimmed
    u, w, q, pitch, de = 170.0, 30.0, 0.2, 0.3, -0.05
    V, alpha = np.hypot(u, w), np.arctan2(w, u)
    qbar, qhat = 0.5 * 0.46 * V**2, q * 4.88 / (2 * V)
    CX = -0.02 - 0.6 * alpha**2
    CZ = -0.15 - 3.2 * alpha - 5.0 * qhat - 0.45 * de
    Cm = 0.01 - 0.35 * alpha - 6.5 * qhat - 0.55 * de
    expected = [
        -q * w + qbar * 49.2 / 17700 * CX + float(model.thrust) / 17700 - GRAVITY * np.sin(pitch),
        q * u + qbar * 49.2 / 17700 * CZ + GRAVITY * np.cos(pitch),
        qbar * 49.2 * 4.88 / 165000 * Cm,
        q,
    ]
    np.testing.assert_allclose(
        model.rhs(T, jnp.array([u, w, q, pitch]), jnp.array([de])), expected, rtol=1e-12
    )


# Initial state ------------------------------------------------------------------------------------


def measured(model, z):
    t = 0.04 * np.arange(len(z))
    return record(t, np.zeros((len(z), 1)), z, inputs=model.inputs, outputs=model.outputs)


def test_initial_state_follows_from_measurements():
    model = true_aircraft()
    z = np.tile([0.1, 0.02, 0.15, 0.0, -9.8, 180.0], (3, 1))
    z[1:] += 1.0
    expected = [180 * np.cos(0.1), 180 * np.sin(0.1), 0.02, 0.15]
    np.testing.assert_allclose(model.initial_state(measured(model, z)), expected, rtol=1e-14)


def test_initial_state_takes_the_first_valid_sample_of_each_channel():
    model = true_aircraft()
    z = np.tile([0.1, 0.02, 0.15, 0.0, -9.8, 180.0], (4, 1))
    z[:, 0] = [np.nan, np.nan, 0.2, 0.3]
    z[:, 5] = [np.nan, 190.0, 191.0, 192.0]
    expected = [190 * np.cos(0.2), 190 * np.sin(0.2), 0.02, 0.15]
    np.testing.assert_allclose(model.initial_state(measured(model, z)), expected, rtol=1e-14)


def test_initial_state_without_speed_carries_the_weight():
    """Without a valid speed the initial state is finite and of the right order of magnitude."""
    model = true_aircraft()
    made = measured(model, np.tile([0.0, 0.0, 0.0, 0.0, -9.8, 180.0], (3, 1)))
    made = eqx.tree_at(
        lambda r: (r.mask, r.z), made, (made.mask.at[:, 5].set(False), made.z.at[:, 5].set(0.0))
    )
    u = model.initial_state(made)[0]
    np.testing.assert_allclose(0.5 * 0.46 * u**2 * 49.2, 17700 * GRAVITY, rtol=1e-12)


# Names and units ----------------------------------------------------------------------------------


def test_parameters_and_channels_have_units_in_si():
    model = true_aircraft()
    names = parameter_names(model)
    assert names[:3] == ("CX.1", "CX.alpha^2", "CZ.1")
    assert {"Cm.qhat", "mass", "Iy", "S", "cbar", "thrust", "density"} <= set(names)
    units = model.units()
    assert set(units) == {*names, *model.states, *model.inputs, *model.outputs}
    assert units["CX.alpha^2"] == "1/rad^2"
    for name, unit in units.items():
        np.testing.assert_array_equal(
            to_si(np.ones(1), unit, name)[0], 1.0
        )  # raises for an unknown unit; one in SI


# Effects ------------------------------------------------------------------------------------------


def test_candidate_effects_are_no_terms_of_the_model():
    model = true_aircraft()
    names = {effect.name for effect in model.effects()}
    assert "alpha^3 in Cm" in names
    assert "alphadot_hat in Cm" in names
    assert "|qhat| qhat in CZ" in names
    assert not {"alpha in CZ", "1 in CX", "alpha^2 in CX", "elevator in Cm"} & names
    assert model.equations_with_terms() == ()
    assert Augmented(model, model.effects()).equations_with_terms() == ()


def test_effects_at_zero_gain_leave_the_model_unchanged(trimmed):
    model, state, elevator = trimmed
    augmented = Augmented(model, model.effects())
    x, u = state + jnp.array([3.0, 5.0, 0.1, 0.1]), elevator[None] + 0.02
    np.testing.assert_array_equal(augmented.rhs(T, x, u), model.rhs(T, x, u))
    np.testing.assert_array_equal(augmented.output(T, x, u), model.output(T, x, u))


@pytest.mark.parametrize("coefficient", ["CX", "CZ", "Cm"])
def test_coefficient_effect_equals_a_term_of_the_polynomial(trimmed, coefficient):
    model, state, elevator = trimmed
    x, u = state + jnp.array([3.0, 5.0, 0.1, 0.1]), elevator[None] + 0.02
    effect = CoefficientTerm(
        coefficient=coefficient,
        product="alpha^2 qhat",
        affected_states=LONGITUDINAL_AFFECTED_STATES[coefficient],
        gain=jnp.array(-3.0),
    )
    old = getattr(model, coefficient)
    wider = Polynomial(
        dict(zip(old.terms, map(float, old.coefficients), strict=True)) | {"alpha^2 qhat": -3.0}
    )
    extended = eqx.tree_at(lambda m: getattr(m, coefficient), model, wider)
    augmented = Augmented(model, (effect,))
    np.testing.assert_allclose(augmented.rhs(T, x, u), extended.rhs(T, x, u), rtol=1e-12)
    np.testing.assert_allclose(augmented.output(T, x, u), extended.output(T, x, u), rtol=1e-12)


def test_reduced_rate_of_alpha_follows_from_the_equations(trimmed):
    model, state, elevator = trimmed
    x, u = state + jnp.array([3.0, 5.0, 0.1, 0.1]), elevator[None] + 0.02
    alphadot = jax.jvp(lambda x: jnp.arctan2(x[1], x[0]), (x,), (model.rhs(T, x, u),))[1]
    V = jnp.hypot(x[0], x[1])
    np.testing.assert_allclose(
        model.signals(T, x, u)["alphadot_hat"], alphadot * model.cbar / (2 * V), rtol=1e-12
    )


@pytest.mark.parametrize(
    "effect",
    [
        CoefficientTerm(coefficient="CZ", product="alpha^2", affected_states=("w",)),
        CoefficientTerm(coefficient="CX", product="alpha elevator", affected_states=("u",)),
        Term(state="w", product="q^2"),
    ],
    ids=lambda effect: effect.name,
)
def test_accelerometer_readings_include_the_force_of_an_effect(trimmed, effect):
    """ax = udot + q w + g sin(pitch) and az = wdot - q u - g cos(pitch), udot and wdot by
    differences of the velocity.

    Central differences over 2 ms of a motion at 2 rad/s are accurate to about 1e-4 m/s^2; without
    the force of the effect the readings would be wrong by 0.1 m/s^2 and more.
    """
    model, state, elevator = trimmed
    augmented = Augmented(model, (eqx.tree_at(lambda e: e.gain, effect, jnp.array(4.0)),))
    t = 0.002 * jnp.arange(1001)
    de = elevator + 0.05 * jnp.sin(2.0 * t)
    start = state + jnp.array([0.0, 10.0, 0.15, 0.0])
    solution = simulate(augmented, t, de[:, None], start, stepper=RK4(1))
    u, w, q, pitch = np.asarray(solution.x.T)
    slope = np.gradient(np.stack([u, w]), np.asarray(t), axis=1)
    expected = np.stack(
        [slope[0] + q * w + GRAVITY * np.sin(pitch), slope[1] - q * u - GRAVITY * np.cos(pitch)]
    )
    readings = np.asarray(solution.y[:, 3:5]).T
    np.testing.assert_allclose(readings[:, 1:-1], expected[:, 1:-1], atol=2e-4)
    without_effect = jax.vmap(model.output)(t, solution.x, de[:, None])[:, 3:5].T
    assert np.max(np.abs(without_effect - readings)) > 0.1
