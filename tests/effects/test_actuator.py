"""Effects of an actuator: rate limit, position limit, dead zone and hysteresis."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxid.data import record
from jaxid.effects import (
    Augmented,
    InputDeadZone,
    InputDelay,
    InputHysteresis,
    InputLag,
    InputPositionLimit,
    InputRateLimit,
)
from jaxid.models import LinearModel
from jaxid.simulation import RK4, BandLimited, Cubic, Linear, ZeroOrder, simulate

H = 0.05
T = H * np.arange(121)
DIRECT = LinearModel(
    [[0.0]], [[1.0]], [[0.0]], [[1.0]], states=("x",), inputs=("u",), outputs=("y",)
)


def plant_input(effects, u, hold=None):
    """Return the input that the plant receives, at the samples."""
    model = Augmented(DIRECT, effects)
    made = record(T, u[:, None], u[:, None], inputs=("u",), outputs=("y",))
    begin, stepper = model.initial_state(made), RK4(2, unrolled=False)
    actual = simulate(model, T, u[:, None], begin, hold=hold, stepper=stepper)
    return np.asarray(actual.y[:, 0])


@eqx.filter_jit
def changed_input(effect, hold, u, at):
    """Return the input behind an effect at some times."""
    path = effect.input_signal(hold.path(jnp.asarray(T), u[:, None]), ("u",))
    return jax.vmap(path)(at)[:, 0]


def limited(u, limit, gain=1.0, hold=None, at=T):
    """Return the rate-limited input at some times."""
    effect = InputRateLimit("u", gain=jnp.array(gain), limit=jnp.array(limit))
    return np.asarray(changed_input(effect, hold or Linear(), u, at))


def ideal(u, limit, step):
    """Return the output of an ideal rate limiter, step by step."""
    y = [u[0]]
    for value in u[1:]:
        y.append(y[-1] + np.clip(value - y[-1], -limit * step, limit * step))
    return np.array(y)


SIGNALS = {
    "a ramp too fast": 0.3 + 2.0 * np.clip(T - 1.0, 0.0, 1.0),
    "a doublet": 0.3 + np.where((T > 1) & (T < 3), 1.0, np.where((T >= 3) & (T < 5), -1.0, 0.0)),
    "a sine": 0.3 + np.sin(1.5 * T),
}


@pytest.mark.parametrize("name", SIGNALS)
def test_rate_limit_equals_ideal_limiter_at_samples(name):
    u, limit = SIGNALS[name], 0.7
    actual = limited(u, limit)
    fine = np.linspace(T[0], T[-1], 1000 * (T.size - 1) + 1)
    want = ideal(np.interp(fine, T, u), limit, H / 1000)[::1000]
    # The ideal limiter overshoots by up to a step of the fine grid where it reaches the input, once
    # in each of a few reversals.
    np.testing.assert_allclose(actual, want, rtol=0, atol=3 * limit * H / 1000)
    assert np.max(np.abs(u - actual)) > 4 * limit * H  # the limit is active


@pytest.mark.parametrize(
    "hold", [Linear(), Cubic(), BandLimited()], ids=["linear", "cubic", "band-limited"]
)
def test_rate_limit_holds_between_samples(hold):
    fine = np.linspace(T[0], T[-1], 3001)
    actual = limited(SIGNALS["a sine"], 0.7, hold=hold, at=fine)
    # A cubic between a free and a limited sample exceeds the limit in that interval by up to a
    # half.
    assert np.quantile(np.abs(np.diff(actual) / np.diff(fine)), 0.97) <= 0.7 * (1 + 1e-6)
    want = ideal(np.interp(fine, T, SIGNALS["a sine"]), 0.7, fine[1])
    # a third of the largest change in a sample interval
    np.testing.assert_allclose(actual, want, rtol=0, atol=0.02)


def test_rate_limit_of_held_input_preserves_impulse():
    u = np.where(T >= 1.0, 1.0, 0.0)
    actual = limited(u, 0.8, hold=ZeroOrder(), at=T[:-1] + 0.5 * H)
    # The ramp lasts 1/0.8 = 1.25 s and loses half of the step's impulse in that time.
    assert np.sum(u[:-1] - actual) * H == pytest.approx(0.625, rel=1e-12)
    assert np.all(np.diff(actual) <= 0.8 * H * (1 + 1e-12))


def test_rate_limit_does_not_change_slower_input():
    u = SIGNALS["a sine"]
    np.testing.assert_allclose(limited(u, 1.6), u, rtol=0, atol=1e-14)


def test_rate_limit_at_half_gain_is_mean_of_input_and_limited_input():
    u = SIGNALS["a doublet"]
    half, full = (limited(u, 0.7, gain) for gain in (0.5, 1.0))
    np.testing.assert_allclose(half, 0.5 * (u + full), rtol=1e-13)


def hysteretic(u, gain, width, hold=None, at=T):
    """Return the input after hysteresis at some times."""
    effect = InputHysteresis("u", gain=jnp.array(gain), width=jnp.array(width))
    return np.asarray(changed_input(effect, hold or Linear(), u, at))


def bouc_wen(u, width):
    """Return z at the samples by integration of its equation over each linear interval."""

    def rate(_, z, slope):
        return slope - 0.5 * (np.abs(slope) * np.abs(z) * z + slope * z**2)

    z = [0.0]
    for slope in np.diff(u) / width:
        solution = solve_ivp(rate, (0.0, 1.0), [z[-1]], args=(slope,), rtol=1e-10, atol=1e-12)
        z.append(solution.y[0, -1])
    return np.array(z)


@pytest.mark.parametrize("name", SIGNALS)
@pytest.mark.parametrize("width", [0.05, 0.4])
def test_input_hysteresis_equals_bouc_wen_at_samples(name, width):
    u = SIGNALS[name]
    # The rate has a corner where z is zero, which limits the accuracy of the reference to 1e-7.
    np.testing.assert_allclose(
        hysteretic(u, 0.3, width), u - 0.3 * bouc_wen(u, width), rtol=0, atol=1e-6
    )


def test_input_hysteresis_of_smooth_input_follows_its_equation_between_samples():
    u, fine = SIGNALS["a sine"], np.linspace(T[0], T[-1], 10 * (T.size - 1) + 1)
    smooth = 0.3 + np.sin(1.5 * fine)
    want = smooth - 0.3 * bouc_wen(smooth, 0.4)
    # z has a corner where the input reverses or z is zero, which a cubic rounds off.
    error = np.abs(hysteretic(u, 0.3, 0.4, Cubic(), fine) - want)
    assert np.max(error) < 1e-3 * 0.3
    # (slope h)^4 / 384 of a cubic through slopes, h = 0.19 widths
    assert np.median(error) < 1e-5 * 0.3


def test_input_hysteresis_with_gain_equal_to_width_is_play():
    u = np.interp(T, [0.0, 3.0, 6.0], [0.0, 3.0, 0.0])
    actual = hysteretic(u, 0.2, 0.2)
    back = (T >= 3.0) & (T <= 3.2)  # change of one width at one unit per second
    np.testing.assert_allclose(actual[back], 2.8, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        actual[(T > 2.0) & (T < 3.0)], u[(T > 2.0) & (T < 3.0)] - 0.2, rtol=0, atol=1e-7
    )


def test_input_hysteresis_of_held_input_follows_its_jumps():
    u = np.where(T >= 1.0, np.where(T >= 2.0, 0.5, 1.0), 0.0)
    z = np.where(
        T >= 1.0, np.where(T >= 2.0, np.tanh(1.0 / 0.4) - 0.5 / 0.4, np.tanh(1.0 / 0.4)), 0.0
    )
    z = np.where(z < 0, np.tanh(z), z)  # below zero z tends to minus one
    np.testing.assert_allclose(hysteretic(u, 0.3, 0.4, ZeroOrder()), u - 0.3 * z, rtol=1e-12)


@pytest.mark.parametrize("hold", [Linear(), ZeroOrder()], ids=["linear", "zero order"])
def test_outputs_depend_on_input_after_the_effects(hold):
    u = SIGNALS["a doublet"] + 0.1 * T
    late = (
        InputDelay("u", gain=jnp.array(2.5 * H)),
        InputHysteresis("u", gain=jnp.array(0.3), width=jnp.array(0.2)),
    )
    actual = plant_input(late, u, hold)
    held = (u - 0.3 * bouc_wen(u, 0.2))[np.maximum(np.arange(T.size) - 3, 0)]
    fine = 0.5 * H * np.arange(2 * T.size - 1)
    between = np.interp(fine, T, u)
    straight = np.interp(T - 2.5 * H, fine, between - 0.3 * bouc_wen(between, 0.2))
    np.testing.assert_allclose(
        actual, held if isinstance(hold, ZeroOrder) else straight, rtol=0, atol=1e-6
    )


@pytest.mark.parametrize(("end", "level"), [("upper", 0.4), ("lower", -0.3)])
def test_position_limit_clips_input(end, level):
    u = np.sin(T)
    actual = plant_input(
        (InputPositionLimit("u", end, gain=jnp.array(1.0), level=jnp.array(level)),), u
    )
    np.testing.assert_allclose(
        actual, np.minimum(u, level) if end == "upper" else np.maximum(u, level), rtol=1e-14
    )


def test_dead_zone_removes_small_inputs():
    u = 1.0 + np.sin(T)
    effect = InputDeadZone("u", gain=jnp.array(1.0), width=jnp.array(0.2), centre=jnp.array(1.0))
    d = u - 1.0
    np.testing.assert_allclose(
        plant_input((effect,), u), 1.0 + np.sign(d) * np.maximum(np.abs(d) - 0.2, 0.0), rtol=1e-13
    )


def test_input_lag_follows_output_of_dead_zone():
    u = np.full(T.size, 0.5)
    zone = InputDeadZone("u", gain=jnp.array(1.0), width=jnp.array(0.2))
    actual = plant_input((zone, InputLag("u", jnp.array(1.0), jnp.array(0.5))), u)
    # From the recorded 0.5 it falls to 0.3; (h/time)^4/120 of RK4 with h = 0.025 s is 5e-8.
    np.testing.assert_allclose(actual, 0.3 + 0.2 * np.exp(-2.0 * T), rtol=0, atol=1e-7)


def test_actuator_shapes_start_within_recorded_range():
    signals = {"t": np.r_[T, T], "u": np.r_[2.0 * np.sin(T), 5.0 + 2.0 * np.sin(T)]}
    effect = InputRateLimit("u", 0.5).initialise_shape(signals, {}, H)
    # half of the largest rate; the jump between records is not a rate
    assert float(effect.limit) == pytest.approx(1.0, rel=1e-3)
    low, high = np.min(signals["u"]), np.max(signals["u"])
    for end, fraction in (("upper", 0.8), ("lower", 0.2)):
        level = float(InputPositionLimit("u", end).initialise_shape(signals, {}, H).level)
        assert level == pytest.approx(low + fraction * (high - low))
    zone = InputDeadZone("u").initialise_shape({"t": T, "u": 3.0 + np.sin(T)}, {}, H)
    assert float(zone.centre) == pytest.approx(np.median(3.0 + np.sin(T)))
    assert 0.2 <= float(zone.width) <= 0.4
    assert (
        float(InputRateLimit("u").initialise_shape({"t": T, "u": 0.0 * T}, {}, H).limit) > 1e3
    )  # a constant input
