"""Flight-path reconstruction: exact motion, instrument errors as parameters, their removal."""

import analytic_motion as motion
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxid
from jaxid._foundation.checks import InputError
from jaxid.aircraft import Instruments, Kinematics, StandardAtmosphere
from jaxid.aircraft.reconstruction.kinematics import KINEMATIC_OUTPUTS
from jaxid.data import stack
from jaxid.models import free, parameter_names, with_values
from jaxid.simulation import RK4, Cubic
from jaxid.simulation.simulate import run

T = 0.05 * jnp.arange(120, dtype=float)
PLACES = {"ax": (1.0, 0.2, 0.3), "ay": (2.0, -0.1, 0.1), "az": (0.5, 0.3, -0.4)}
VANES = {"alpha": (10.0, 0.1, 0.2), "beta": (9.0, 0.1, 0.1)}


def state(t):
    over_ground = motion.to_earth(t).T @ motion.rate(motion.place)(t)
    return jnp.concatenate([over_ground, motion.attitude(t), -motion.place(t)[2:]])


def true_inputs(names, t):
    """Readings of error-free gyros and accelerometers, the accelerometers at their positions."""
    signals = motion.signals(t)
    signals |= {
        name: motion.specific_force(jnp.array(PLACES[name]))(t)["xyz".index(name[1])]
        for name in PLACES
    }
    return jnp.stack([signals[name] for name in names])


@pytest.fixture(scope="module")
def model():
    return Kinematics(
        Instruments(KINEMATIC_OUTPUTS, position=VANES, delay={"alpha": 0.0}),
        input_position=PLACES,
        angular_acceleration=True,
        wind=motion.WIND,
        beta="vane",
    )


@pytest.fixture(scope="module")
def inputs(model):
    return jax.jit(jax.vmap(lambda t: true_inputs(model.inputs, t)))(T)


@eqx.filter_jit
def simulated(model, u, x):
    return run(model, T, u, x, Cubic(), RK4())


@pytest.fixture(scope="module")
def solution(model, inputs):
    return simulated(model, inputs, state(T[0]))


def test_kinematics_reproduce_exact_motion_in_wind(solution):
    """To 1e-5 m/s, 1e-7 rad, 1e-4 m: cubics through 20 samples a second, with an error of fourth
    order.
    """
    exact = jax.jit(jax.vmap(state))(T)
    np.testing.assert_allclose(solution.x[:, :3], exact[:, :3], atol=2e-5)
    np.testing.assert_allclose(solution.x[:, 3:6], exact[:, 3:6], atol=1e-7)
    np.testing.assert_allclose(solution.x[:, 6], exact[:, 6], atol=1e-4)


def test_vanes_off_the_cg_and_true_airspeed_match_exact_motion(model, solution):
    def readings(t):
        u, v, w = (
            motion.air_velocity(jnp.array(VANES[name]))(t) for name in ("alpha", "beta", "beta")
        )
        centre = motion.air_velocity(jnp.zeros(3))(t)
        return jnp.stack(
            [jnp.sqrt(centre @ centre), jnp.arctan2(u[2], u[0]), jnp.arctan2(v[1], w[0])]
        )

    exact = jax.jit(jax.vmap(readings))(T)
    np.testing.assert_allclose(solution.y[:, 0], exact[:, 0], atol=2e-5)
    np.testing.assert_allclose(solution.y[:, 1:3], exact[:, 1:3], atol=3e-7)


def test_declared_input_errors_leave_the_outputs_unchanged(model, inputs, solution):
    """`measured = (1 + scale) true + bias` is inverted to rounding."""
    bias, scale = 0.01 * jnp.arange(1.0, 10.0), 0.002 * jnp.arange(-4.0, 5.0)
    erring = eqx.tree_at(
        lambda m: (m.input_bias.values, m.input_scale.values), model, (bias, scale)
    )
    again = simulated(erring, (1.0 + scale[None]) * inputs + bias[None], state(T[0]))
    np.testing.assert_allclose(again.y, solution.y, rtol=1e-10, atol=1e-10)


def test_derivative_with_respect_to_a_delay_is_minus_the_slope(model, solution):
    """`d y(t - d)/dd = -dy/dt`, at zero delay and at a delay between the samples.

    The tolerance is 1e-3 of its size: the slope of the cubics is taken by central differences.
    """

    def delayed(delay):
        changed = with_values(model, ["instruments.delay.alpha"], delay[None])
        return changed.observe(T, solution.y)[:, 1]

    slope = jnp.gradient(solution.y[:, 1], 0.05)
    for delay in (0.0, 0.1):
        moved = jax.jacfwd(delayed)(jnp.array(delay))
        behind = round(delay / 0.05)
        np.testing.assert_allclose(
            moved[5:-5], -slope[5 - behind : -5 - behind], atol=1e-3 * float(np.ptp(slope))
        )
    delay, step = jnp.array(0.083), 1e-5
    by_differences = (delayed(delay + step) - delayed(delay - step)) / (2 * step)
    np.testing.assert_allclose(jax.jacfwd(delayed)(delay), by_differences, atol=1e-7)


def test_sensitivities_match_central_differences(model, inputs):
    names = (
        "input_bias.q",
        "input_scale.az",
        "input_position.ax.z",
        "wind.east",
        "instruments.scale.alpha",
    )
    begin = jnp.array([0.01, 0.01, 0.3, -4.0, 0.02])

    @jax.jit
    def outputs(values):
        return run(with_values(model, names, values), T, inputs, state(T[0]), Cubic(), RK4()).y

    S = jax.jit(jax.jacfwd(outputs))(begin)
    for k in range(len(names)):
        step = 1e-5 * jnp.eye(len(names))[k]
        by_differences = (outputs(begin + step) - outputs(begin - step)) / 2e-5
        np.testing.assert_allclose(
            S[..., k], by_differences, rtol=1e-6, atol=1e-6 * float(jnp.max(jnp.abs(S[..., k])))
        )


def test_beta_is_flank_angle_or_sideslip_as_declared():
    x, u = jnp.array([100.0, 8.0, 30.0, 0.1, 0.2]), jnp.zeros(6)
    flank = Kinematics(Instruments(("V", "beta")), beta="vane").output(jnp.zeros(()), x, u)
    slip = Kinematics(Instruments(("V", "beta"), scale={"beta": 0.1})).output(jnp.zeros(()), x, u)
    np.testing.assert_allclose(flank[1], np.arctan2(8.0, 100.0), rtol=1e-14)
    np.testing.assert_allclose(slip[1], 1.1 * np.arcsin(8.0 / float(slip[0])), rtol=1e-14)


@pytest.mark.parametrize("beta", ["vane", "sideslip"])
@pytest.mark.parametrize("atmosphere", [None, StandardAtmosphere()])
def test_initial_state_follows_from_the_first_samples(beta, atmosphere):
    model = Kinematics(wind=(3.0, -5.0, 1.0), atmosphere=atmosphere, beta=beta)
    x = jnp.array([120.0, 8.0, 30.0, 0.3, 0.2, -0.5, 4000.0])
    y = model.output(jnp.zeros(()), x, jnp.zeros(6))
    record = jaxid.record(
        T[:2], jnp.zeros((2, 6)), jnp.stack([y, y]), inputs=model.inputs, outputs=model.outputs
    )
    # the indicated airspeed is inverted by iteration
    np.testing.assert_allclose(model.initial_state(record), x, rtol=1e-9)


def test_states_and_parameter_names_follow_from_the_options(model):
    assert Kinematics(Instruments(("V", "alpha"))).states == ("u", "v", "w", "phi", "pitch")
    assert model.states == ("u", "v", "w", "phi", "pitch", "psi", "altitude")
    assert "wind.north" in parameter_names(model)
    assert not any(
        "position" in name or "wind" in name
        for name in parameter_names(Kinematics(Instruments(("V",))))
    )
    units = model.units()
    assert set(parameter_names(model)) <= set(units)
    assert units["input_bias.ax"] == "m/s^2"
    assert units["instruments.delay.alpha"] == "s"
    free(model, *model.sensor_errors())  # raises for an unknown name
    assert "instruments.delay.alpha" in model.sensor_errors()


@pytest.fixture(scope="module")
def erring(model):
    names = (
        "input_bias.p",
        "input_scale.p",
        "instruments.bias.beta",
        "instruments.scale.beta",
        "instruments.delay.alpha",
    )
    return with_values(model, names, jnp.array([0.01, 0.02, 0.005, 0.1, 0.06]))


@pytest.fixture(scope="module")
def records(model, erring, inputs, solution):
    """The same motion recorded without and with errors.

    The record has a channel that the model lacks, and a gap in alpha.
    """
    extra = solution.y[:, :1] ** 2
    bias, scale = erring.input_bias.values[None], erring.input_scale.values[None]
    channels = {"inputs": model.inputs, "outputs": (*model.outputs, "extra"), "name": "flight"}
    wrong = simulated(erring, (1.0 + scale) * inputs + bias, state(T[0])).y
    wrong = np.array(jnp.concatenate([wrong, extra], axis=1))
    wrong[40:42, 1] = np.nan
    right = jaxid.record(T, inputs, jnp.concatenate([solution.y, extra], axis=1), **channels)
    return right, jaxid.record(T, (1.0 + scale) * inputs + bias, wrong, **channels)


def test_corrected_record_equals_the_record_without_errors(erring, records):
    """To rounding; for the delayed channel the model's cubics and the spline that inverts them
    agree to 1e-5 rad.
    """
    right, wrong = records
    corrected = erring.corrected(wrong)
    np.testing.assert_allclose(corrected.u, right.u, rtol=1e-12, atol=1e-12)
    others = [k for k, name in enumerate(right.outputs) if name != "alpha"]
    np.testing.assert_allclose(corrected.z[:, others], right.z[:, others], rtol=1e-9, atol=1e-9)
    mask = np.asarray(corrected.mask[:, 1])
    # A sample is valid if the samples on both sides of it, 0.06 s later, are valid: 2 are beyond
    # the end, 3 next to the gap.
    assert list(np.flatnonzero(~mask)) == [38, 39, 40, 118, 119]
    inside = mask & (np.arange(120) > 5) & (np.abs(np.arange(120) - 40) > 5)
    np.testing.assert_allclose(corrected.z[inside, 1], right.z[inside, 1], atol=1e-5)
    assert bool(jnp.all(corrected.z[~mask, 1] == 0.0))


def test_stack_is_corrected_record_by_record(erring, records):
    both = erring.corrected(stack(records))
    single = erring.corrected(records[1])
    np.testing.assert_array_equal(both[1].z, single.z)
    np.testing.assert_array_equal(both[1].mask, single.mask)


def test_model_input_recorded_as_output_is_corrected(erring):
    record = jaxid.record(T, np.zeros((120, 0)), jnp.ones((120, 1)), inputs=(), outputs=("p",))
    np.testing.assert_allclose(erring.corrected(record).z, (1.0 - 0.01) / 1.02, rtol=1e-15)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Kinematics(Instruments(("V", "q"))), "no output of a kinematic model 'q'"),
        (lambda: Kinematics(input_bias={"pdot": 0.1}), "no channel .*'pdot'"),
        (
            lambda: Kinematics(input_position={"ax": (1.0, 0.0, 0.0)}),
            "'ax' is at .* takes angular accelerations",
        ),
        (lambda: Kinematics(input_position={"p": (0.0, 0.0, 0.0)}), "no accelerometer .*'p'"),
        (lambda: Kinematics(Instruments(("V", "alpha")), wind=(1.0, 0.0, 0.0)), "without psi"),
        (
            lambda: Kinematics(Instruments(("V",)), atmosphere=StandardAtmosphere()),
            "depends on the altitude",
        ),
        (lambda: Kinematics(wind=(1.0, 0.0)), "three numbers"),
    ],
)
def test_invalid_kinematic_model_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_record_without_airspeed_and_lag_correction_are_refused(records):
    still = Kinematics(Instruments(("alpha",)))
    record = jaxid.record(
        T, jnp.zeros((120, 6)), jnp.zeros((120, 1)), inputs=still.inputs, outputs=("alpha",)
    )
    with pytest.raises(InputError, match="has no airspeed"):
        still.initial_state(record)
    with pytest.raises(InputError, match=r"alpha lags by 0\.1 s"):
        Kinematics(Instruments(("V", "alpha"), lag={"alpha": 0.1})).corrected(records[0])
