"""`simulate`: exact solutions, order, agreement of the two steppers, and errors."""

import diffrax
import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from scipy.linalg import expm

from jaxid._foundation.checks import InputError
from jaxid.data import record, stack
from jaxid.models import AbstractModel, LinearModel
from jaxid.simulation import RK4, Adaptive, BandLimited, Cubic, Linear, ZeroOrder, simulate
from jaxid.simulation.simulate import explain_divergence

A = np.array([[0.0, 1.0], [-4.0, -0.6]])
B = np.array([[0.0, 0.3], [1.0, -0.5]])
C = np.array([[1.0, 0.0], [0.2, 1.0], [0.5, -0.5]])
D = np.array([[0.0, 0.0], [0.7, 0.0], [0.0, -1.1]])
START = np.array([0.4, -0.2])
HOLDS = {
    "zero-order": ZeroOrder(),
    "linear": Linear(),
    "cubic": Cubic(),
    "band-limited": BandLimited(half_width=8),
}


def system():
    return LinearModel(A, B, C, D, states=("x", "v"), inputs=("a", "b"), outputs=("p", "q", "r"))


def uneven(seed, n=40):
    """Sample times with steps between 0.05 and 0.15 s, and random inputs."""
    generator = np.random.default_rng(seed)
    t = 3.0 + np.concatenate([[0.0], np.cumsum(generator.uniform(0.05, 0.15, n - 1))])
    return t, generator.normal(size=(n, 2))


def exact(t, u, ramps):
    """Return the states by the matrix exponential.

    The system has the input, and the input's slope, as further states.
    """
    x, states, zero = START, [START], np.zeros((2, 2))
    big = np.block([[A, B, zero], [np.zeros((2, 4)), np.eye(2)], [np.zeros((2, 6))]])
    for k, h in enumerate(np.diff(t)):
        slope = (u[k + 1] - u[k]) / h if ramps else np.zeros(2)
        x = (expm(big * h) @ np.concatenate([x, u[k], slope]))[:2]
        states.append(x)
    return np.array(states)


@pytest.mark.parametrize(("hold", "ramps"), [(ZeroOrder(), False), (Linear(), True)])
def test_linear_system_equals_matrix_exponential(seed, hold, ramps):
    t, u = uneven(seed)
    result = simulate(system(), t, u, START, hold=hold, stepper=RK4(40, unrolled=False))
    x = exact(t, u, ramps)
    # The step is at most 0.15/40 s and the frequency 2 rad/s: (w h)^4/120 = 3e-11 of the motion in
    # each radian.
    np.testing.assert_allclose(result.x, x, atol=1e-9, rtol=0)
    np.testing.assert_allclose(result.y, x @ C.T + u @ D.T, atol=2e-9, rtol=0)
    assert bool(result.finite)
    np.testing.assert_array_equal(result.t, t)


@pytest.mark.parametrize(("hold", "ramps"), [(ZeroOrder(), False), (Linear(), True)])
def test_order_is_four_for_input_with_jumps_or_bends(seed, hold, ramps):
    t, u = uneven(seed)
    x = exact(t, u, ramps)
    steppers = [RK4(n, unrolled=n < 8) for n in (2, 4, 8, 16)]
    errors = [
        np.abs(simulate(system(), t, u, START, hold=hold, stepper=stepper).x - x).max()
        for stepper in steppers
    ]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    # The next term of the error is w h < 0.15 of the leading one at the coarsest pair, and halves
    # from pair to pair.
    np.testing.assert_allclose(orders, 4.0, atol=0.15)


def test_ramp_with_linear_hold_is_exact():
    t = np.array([0.0, 0.3, 0.5, 1.2, 2.0])
    double = LinearModel(
        [[0.0, 1.0], [0.0, 0.0]],
        [[0.0], [1.0]],
        [[1.0, 0.0]],
        [[0.0]],
        states=("x", "v"),
        inputs=("u",),
        outputs=("x",),
    )
    result = simulate(double, t, 1.0 + 2.0 * t[:, None], np.array([0.5, -1.0]), hold=Linear())
    # A method of fourth order integrates a cubic in time exactly, so the error is rounding.
    np.testing.assert_allclose(result.x[:, 0], 0.5 - t + t**2 / 2 + t**3 / 3, rtol=0, atol=1e-14)
    np.testing.assert_allclose(result.x[:, 1], -1.0 + t + t**2, rtol=0, atol=1e-14)


class Pendulum(AbstractModel):
    """A damped pendulum, for tests on nonlinear equations."""

    k: jax.Array
    c: jax.Array
    states, inputs, outputs = ("angle", "rate"), ("torque",), ("angle",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * jnp.sin(x[0]) - self.c * x[1]])

    def output(self, t, x, u):
        return x[:1]


def pendulum_case(n=25):
    t = 0.1 * np.arange(n)
    return t, np.sign(np.sin(3.0 * t + 0.4))[:, None] * (1 + t[:, None]), np.array([0.8, 0.3])


TIGHT = Adaptive(diffrax.Tsit5(), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("hold", [ZeroOrder(), Linear()], ids=["zero-order", "linear"])
def test_adaptive_and_fixed_steps_agree_in_value_and_sensitivity(hold):
    t, u, start = pendulum_case()

    def outcome(theta, stepper):
        return simulate(Pendulum(theta[0], theta[1]), t, u, start, hold=hold, stepper=stepper).y[
            :, 0
        ]

    theta, fine = jnp.array([2.0, 0.3]), RK4(16, unrolled=False)
    fixed, adaptive = outcome(theta, fine), outcome(theta, TIGHT)
    # (w h)^4/120 with h = 0.1/16 s and w < 2 rad/s is 2e-10; the tolerance of the adaptive steps
    # is 1e-11.
    np.testing.assert_allclose(adaptive, fixed, rtol=0, atol=1e-8)
    S_fixed, S_adaptive = (jax.jacfwd(outcome)(theta, stepper) for stepper in (fine, TIGHT))
    assert np.abs(S_fixed).max() > 0.1
    np.testing.assert_allclose(S_adaptive, S_fixed, rtol=0, atol=1e-8)
    # Central differences: step^2 of the third derivative, and 1e-16/step of rounding.
    central = [
        (outcome(theta + d, fine) - outcome(theta - d, fine)) / 2e-5 for d in 1e-5 * np.eye(2)
    ]
    np.testing.assert_allclose(S_fixed, np.stack(central, axis=1), rtol=0, atol=1e-9)


@pytest.mark.parametrize("hold", HOLDS.values(), ids=HOLDS)
def test_padding_with_fixed_steps_changes_nothing(seed, hold):
    t, u = uneven(seed)
    t = 0.1 * np.arange(t.size)
    padded_t, padded_u = np.pad(t, (0, 7), mode="edge"), np.pad(u, ((0, 7), (0, 0)), mode="edge")
    bare = simulate(system(), t, u, START, hold=hold, stepper=RK4(2))
    padded = simulate(system(), padded_t, padded_u, START, hold=hold, stepper=RK4(2))
    # The same operations on the same numbers, in another order where a spline or a convolution is
    # longer: rounding.
    np.testing.assert_allclose(padded.x[: t.size], bare.x, rtol=0, atol=1e-13)
    np.testing.assert_allclose(padded.y[: t.size], bare.y, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(padded.x[t.size :], np.broadcast_to(padded.x[t.size - 1], (7, 2)))
    assert bool(padded.finite)


def test_padding_with_adaptive_steps_changes_nothing():
    t, u, start = pendulum_case()
    bare = simulate(Pendulum(2.0, 0.3), t, u, start, hold=ZeroOrder(), stepper=TIGHT)
    padded_t, padded_u = np.pad(t, (0, 4), mode="edge"), np.pad(u, ((0, 4), (0, 0)), mode="edge")
    padded = simulate(
        Pendulum(2.0, 0.3), padded_t, padded_u, start, hold=ZeroOrder(), stepper=TIGHT
    )
    np.testing.assert_allclose(padded.x[: t.size], bare.x, rtol=0, atol=1e-13)
    np.testing.assert_allclose(
        padded.x[t.size :], np.broadcast_to(bare.x[-1], (4, 2)), rtol=0, atol=1e-13
    )


@pytest.mark.parametrize("hold", HOLDS.values(), ids=HOLDS)
def test_stack_equals_single_cases(seed, hold):
    t, u = uneven(seed)
    t = 0.1 * np.arange(t.size)
    channels = {"inputs": ("a", "b"), "outputs": ("p", "q", "r")}
    parts = [(t, u), (t[:23], -2.0 * u[17:])]
    both = stack(
        [record(time, values, np.zeros((time.size, 3)), **channels) for time, values in parts]
    )
    starts = np.stack([START, -START])
    result = simulate(system(), both.t, both.u, starts, hold=hold)
    assert result.x.shape == (2, t.size, 2)
    assert result.finite.shape == (2,)
    for case, (time, values) in enumerate(parts):
        alone = simulate(system(), time, values, starts[case], hold=hold)
        np.testing.assert_allclose(result.x[case, : time.size], alone.x, rtol=0, atol=1e-13)
        np.testing.assert_allclose(result.y[case, : time.size], alone.y, rtol=0, atol=1e-13)


def test_vmap_over_model_and_jit_equal_single_calls():
    t, u, start = pendulum_case()

    def outcome(k):
        return simulate(Pendulum(k, 0.3), t, u, start).y

    stiffness = jnp.array([1.0, 2.0, 4.0])
    together = jax.jit(jax.vmap(outcome))(stiffness)
    np.testing.assert_allclose(
        together, np.stack([outcome(k) for k in stiffness]), rtol=0, atol=1e-13
    )
    assert np.abs(together[0] - together[1]).max() > 0.1


class Explosion(AbstractModel):
    """`dx/dt = x^2` reaches infinity at `t = 1/x0`; the other state never moves."""

    states, inputs, outputs = ("still", "blows"), ("u",), ("blows",)

    def rhs(self, t, x, u):
        return jnp.stack([0.0 * x[0], x[1] ** 2])

    def output(self, t, x, u):
        return x[1:]


@pytest.mark.parametrize("stepper", [RK4(4), Adaptive(max_steps=2000)], ids=["fixed", "adaptive"])
def test_divergence_is_flagged_without_exception(stepper):
    t = 0.5 * np.arange(12)
    result = simulate(Explosion(), t, np.zeros((12, 1)), np.array([1.0, 0.5]), stepper=stepper)
    assert not bool(result.finite)
    calm = simulate(Explosion(), t[:3], np.zeros((3, 1)), np.array([1.0, 0.5]), stepper=stepper)
    assert bool(calm.finite)


def test_divergence_message_names_time_and_state():
    t = 0.5 * np.arange(12)
    result = simulate(Explosion(), t, np.zeros((12, 1)), np.array([1.0, 0.5]), stepper=RK4(4))
    first = t[np.argmax(~np.isfinite(result.x[:, 1]))]
    assert 2.0 <= first < 5.5  # the pole is at 2 s; fixed steps pass it slightly later
    error = explain_divergence(result, Explosion(), "record 'loop'")
    assert isinstance(error, InputError)
    assert f"record 'loop' stops being finite at t = {first:g} s, in blows." in str(error)
    assert "still" not in str(error)
    assert "substeps" in str(error)


class Falling(AbstractModel):
    """`dx/dt = -1`, whose logarithm is not finite from `t = x0` on."""

    states, inputs, outputs = ("x",), ("u",), ("y", "w")

    def rhs(self, t, x, u):
        return -jnp.ones(1)

    def output(self, t, x, u):
        return jnp.stack([x[0], jnp.log(x[0])])


def test_divergence_message_names_output_where_states_are_finite():
    t = 0.5 * np.arange(12)
    result = simulate(Falling(), t, np.zeros((12, 1)), np.array([4.8]))
    error = explain_divergence(result, Falling(), "record 'log'")
    assert "record 'log' stops being finite at t = 5 s, in w." in str(error)


@pytest.mark.parametrize(
    ("u", "start", "message"),
    [
        (np.zeros((5, 2)), np.zeros(2), "u has 2 channels, but the model has 1: torque."),
        (
            np.zeros((5, 1)),
            np.zeros(3),
            "initial_state has 3 channels, but the model has 2: angle, rate.",
        ),
        (np.zeros((4, 1)), np.zeros(2), "u has 4 rows for 5 sample times."),
    ],
)
def test_wrong_shapes_are_refused_with_channel_names(monkeypatch, u, start, message):
    # for users, annotations are not checked
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(InputError, match=f"^{message}$"):
        simulate(Pendulum(1.0, 0.1), 0.1 * np.arange(5), u, start)


def test_single_precision_is_refused_with_remedy():
    t, u, start = pendulum_case(5)
    with jax.enable_x64(False), pytest.raises(InputError, match=r"`jaxid\.configure\(\)`"):
        simulate(Pendulum(1.0, 0.1), t, u, start)


def test_inputs_of_any_number_type_give_same_solution():
    t, u, start = pendulum_case()
    want = simulate(Pendulum(jnp.array(2.0), jnp.array(0.25)), t, u, start).y
    for k, c in [
        (2, 0.25),
        (np.float32(2), np.float64(0.25)),
        (jnp.float32(2), jnp.asarray(0.25, jnp.float32)),
    ]:
        got = simulate(Pendulum(k, c), t, u, start).y
        assert got.dtype == jnp.float64
        np.testing.assert_array_equal(got, want)
