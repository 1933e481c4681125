"""Limits of rate and position and a dead zone: closed forms against ideal actuators."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxid.data import record
from jaxid.models import (
    Augmented,
    InputDeadZone,
    InputDelay,
    InputHysteresis,
    InputLag,
    InputPositionLimit,
    InputRateLimit,
    LinearModel,
)
from jaxid.simulation import RK4, BandLimited, Cubic, Linear, ZeroOrder, simulate

H = 0.05
T = H * np.arange(121)
DIRECT = LinearModel([[0.0]], [[1.0]], [[0.0]], [[1.0]], states=("x",), inputs=("u",), outputs=("y",))


def acting(effects, u, hold=None):
    """The input that acts on the plant, at the samples."""
    model = Augmented(DIRECT, effects)
    made = record(T, u[:, None], u[:, None], inputs=("u",), outputs=("y",))
    found = simulate(model, T, u[:, None], model.initial_state(made), hold=hold, stepper=RK4(2))
    return np.asarray(found.y[:, 0])


def limited(u, limit, gain=1.0, hold=None, at=T):
    """What follows the input no faster than a limit, at some times."""
    effect = InputRateLimit("u", gain=jnp.array(gain), limit=jnp.array(limit))
    path = effect.input_path((hold or Linear()).path(jnp.asarray(T), jnp.asarray(u)[:, None]), ("u",))
    return np.asarray(jax.vmap(path)(jnp.asarray(at)))[:, 0]


def ideal(u, limit, step):
    """The ideal limiter, step by step."""
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
def test_a_rate_limit_is_an_ideal_limiter_at_the_samples(name):
    u, limit = SIGNALS[name], 0.7
    found = limited(u, limit)
    fine = np.linspace(T[0], T[-1], 1000 * (T.size - 1) + 1)
    want = ideal(np.interp(fine, T, u), limit, H / 1000)[::1000]
    # The ideal one goes on by up to a step of the fine grid where it meets the input, once in each of a few reversals.
    np.testing.assert_allclose(found, want, rtol=0, atol=3 * limit * H / 1000)
    assert np.max(np.abs(u - found)) > 4 * limit * H  # and it does limit


@pytest.mark.parametrize("hold", [Linear(), Cubic(), BandLimited()], ids=["linear", "cubic", "band-limited"])
def test_between_the_samples_it_runs_no_faster(hold):
    fine = np.linspace(T[0], T[-1], 3001)
    found = limited(SIGNALS["a sine"], 0.7, hold=hold, at=fine)
    # Cubics between a free and a limited sample overshoot the slope of the one interval by up to a half.
    assert np.quantile(np.abs(np.diff(found) / np.diff(fine)), 0.97) <= 0.7 * (1 + 1e-6)
    want = ideal(np.interp(fine, T, SIGNALS["a sine"]), 0.7, fine[1])
    np.testing.assert_allclose(found, want, rtol=0, atol=0.02)  # a third of what the limit allows in a sample


def test_a_held_input_keeps_the_impulse_of_the_ramp():
    u = np.where(T >= 1.0, 1.0, 0.0)
    found = limited(u, 0.8, hold=ZeroOrder(), at=T[:-1] + 0.5 * H)
    # The ramp of 1/0.8 = 1.25 s loses half of that, times one.
    assert np.sum(u[:-1] - found) * H == pytest.approx(0.625, rel=1e-12)
    assert np.all(np.diff(found) <= 0.8 * H * (1 + 1e-12))


def test_a_rate_limit_leaves_a_slower_input_as_it_is():
    u = SIGNALS["a sine"]
    np.testing.assert_allclose(limited(u, 1.6), u, rtol=0, atol=1e-14)


def test_half_a_gain_is_half_way():
    u = SIGNALS["a doublet"]
    half, whole = (limited(u, 0.7, gain) for gain in (0.5, 1.0))
    np.testing.assert_allclose(half, 0.5 * (u + whole), rtol=1e-13)


def hysteretic(u, gain, width, hold=None, at=T):
    """What is behind an input with hysteresis, at some times."""
    effect = InputHysteresis("u", gain=jnp.array(gain), width=jnp.array(width))
    path = effect.input_path((hold or Linear()).path(jnp.asarray(T), jnp.asarray(u)[:, None]), ("u",))
    return np.asarray(jax.vmap(path)(jnp.asarray(at)))[:, 0]


def bouc_wen(u, width):
    """z by its differential equation, interval by interval, as the straight line in each has one slope."""
    found = [0.0]
    for far in np.diff(u) / width:
        rate = lambda _, z, far=far: far - 0.5 * (np.abs(far) * np.abs(z) * z + far * z**2)  # noqa: E731
        found.append(solve_ivp(rate, (0.0, 1.0), [found[-1]], rtol=1e-10, atol=1e-12).y[0, -1])
    return np.array(found)


@pytest.mark.parametrize("name", SIGNALS)
@pytest.mark.parametrize("width", [0.05, 0.4])
def test_hysteresis_of_an_input_is_that_of_bouc_and_wen_at_the_samples(name, width):
    u = SIGNALS[name]
    # Where z passes zero its rate has a corner, at which the reference's steps are no better than 1e-7.
    np.testing.assert_allclose(hysteretic(u, 0.3, width), u - 0.3 * bouc_wen(u, width), rtol=0, atol=1e-6)


def test_between_the_samples_of_a_smooth_input_it_runs_as_its_equation_says():
    u, fine = SIGNALS["a sine"], np.linspace(T[0], T[-1], 10 * (T.size - 1) + 1)
    smooth = 0.3 + np.sin(1.5 * fine)
    want = smooth - 0.3 * bouc_wen(smooth, 0.4)
    # A spline's interval in which the input turns, or z leaves zero, holds a corner of z, which a cubic rounds off.
    error = np.abs(hysteretic(u, 0.3, 0.4, Cubic(), fine) - want)
    assert np.max(error) < 1e-3 * 0.3
    assert np.median(error) < 1e-5 * 0.3  # (slope h)^4 / 384 of a cubic through slopes, h = 0.19 widths


def test_a_gain_of_the_width_is_play():
    u = np.interp(T, [0.0, 3.0, 6.0], [0.0, 3.0, 0.0])
    found = hysteretic(u, 0.2, 0.2)
    back = (T >= 3.0) & (T <= 3.2)  # the way of one width, at one unit a second
    np.testing.assert_allclose(found[back], 2.8, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[(T > 2.0) & (T < 3.0)], u[(T > 2.0) & (T < 3.0)] - 0.2, rtol=0, atol=1e-7)


def test_a_held_input_has_the_hysteresis_of_its_jumps():
    u = np.where(T >= 1.0, np.where(T >= 2.0, 0.5, 1.0), 0.0)
    z = np.where(T >= 1.0, np.where(T >= 2.0, np.tanh(1.0 / 0.4) - 0.5 / 0.4, np.tanh(1.0 / 0.4)), 0.0)
    z = np.where(z < 0, np.tanh(z), z)  # beyond zero it saturates on the other side
    np.testing.assert_allclose(hysteretic(u, 0.3, 0.4, ZeroOrder()), u - 0.3 * z, rtol=1e-12)


@pytest.mark.parametrize("hold", [Linear(), ZeroOrder()], ids=["linear", "zero order"])
def test_outputs_feel_the_input_as_it_arrives(hold):
    u = SIGNALS["a doublet"] + 0.1 * T
    late = (InputDelay("u", gain=jnp.array(2.5 * H)), InputHysteresis("u", gain=jnp.array(0.3), width=jnp.array(0.2)))
    found = acting(late, u, hold)
    held = (u - 0.3 * bouc_wen(u, 0.2))[np.maximum(np.arange(T.size) - 3, 0)]
    fine = 0.5 * H * np.arange(2 * T.size - 1)
    between = np.interp(fine, T, u)
    straight = np.interp(T - 2.5 * H, fine, between - 0.3 * bouc_wen(between, 0.2))
    np.testing.assert_allclose(found, held if isinstance(hold, ZeroOrder) else straight, rtol=0, atol=1e-6)


@pytest.mark.parametrize(("end", "level"), [("upper", 0.4), ("lower", -0.3)])
def test_a_position_limit_clips(end, level):
    u = np.sin(T)
    found = acting((InputPositionLimit("u", end, gain=jnp.array(1.0), level=jnp.array(level)),), u)
    np.testing.assert_allclose(found, np.minimum(u, level) if end == "upper" else np.maximum(u, level), rtol=1e-14)


def test_a_dead_zone_takes_small_inputs_away():
    u = 1.0 + np.sin(T)
    effect = InputDeadZone("u", gain=jnp.array(1.0), width=jnp.array(0.2), centre=jnp.array(1.0))
    d = u - 1.0
    np.testing.assert_allclose(acting((effect,), u), 1.0 + np.sign(d) * np.maximum(np.abs(d) - 0.2, 0.0), rtol=1e-13)


def test_a_lag_follows_what_the_dead_zone_before_it_leaves():
    u = np.full(T.size, 0.5)
    zone = InputDeadZone("u", gain=jnp.array(1.0), width=jnp.array(0.2))
    found = acting((zone, InputLag("u", jnp.array(1.0), jnp.array(0.5))), u)
    # From the recorded 0.5 it falls to 0.3; (h/time)^4/120 of RK4 with h = 0.025 s is 5e-8.
    np.testing.assert_allclose(found, 0.3 + 0.2 * np.exp(-2.0 * T), rtol=0, atol=1e-7)


def test_shapes_start_within_what_was_recorded():
    signals = {"t": np.r_[T, T], "u": np.r_[2.0 * np.sin(T), 5.0 + 2.0 * np.sin(T)]}
    effect = InputRateLimit("u", 0.5).start(signals, {}, H)
    assert float(effect.limit) == pytest.approx(1.0, rel=1e-3)  # half of the largest rate; the jump of records is none
    low, high = np.min(signals["u"]), np.max(signals["u"])
    for end, fraction in (("upper", 0.8), ("lower", 0.2)):
        level = float(InputPositionLimit("u", end).start(signals, {}, H).level)
        assert level == pytest.approx(low + fraction * (high - low))
    zone = InputDeadZone("u").start({"t": T, "u": 3.0 + np.sin(T)}, {}, H)
    assert float(zone.centre) == pytest.approx(np.median(3.0 + np.sin(T)))
    assert 0.2 <= float(zone.width) <= 0.4
    assert float(InputRateLimit("u").start({"t": T, "u": 0.0 * T}, {}, H).limit) > 1e3  # an input that never moves
