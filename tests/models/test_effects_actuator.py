"""Limits of rate and position and a dead zone: closed forms against ideal actuators."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.data import record
from jaxid.models import (
    Augmented,
    InputDeadZone,
    InputLag,
    InputPositionLimit,
    InputRateLimit,
    LinearModel,
)
from jaxid.simulation import RK4, BandLimited, Cubic, Linear, ZeroOrder, simulate

H = 0.05
T = H * np.arange(121)
DIRECT = LinearModel([[0.0]], [[1.0]], [[0.0]], [[1.0]], states=("x",), inputs=("u",), outputs=("y",))


def acting(effects, u):
    """The input that acts on the plant, at the samples."""
    model = Augmented(DIRECT, effects)
    made = record(T, u[:, None], u[:, None], inputs=("u",), outputs=("y",))
    found = simulate(model, T, u[:, None], model.initial_state(made), stepper=RK4(2))
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
