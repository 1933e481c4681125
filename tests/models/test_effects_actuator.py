"""Limits of rate and position and a dead zone: closed forms against ideal actuators."""

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
from jaxid.simulation import RK4, simulate

H = 0.05
T = H * np.arange(121)
DIRECT = LinearModel([[0.0]], [[1.0]], [[0.0]], [[1.0]], states=("x",), inputs=("u",), outputs=("y",))


def acting(effects, u):
    """The input that acts on the plant, at the samples."""
    model = Augmented(DIRECT, effects)
    made = record(T, u[:, None], u[:, None], inputs=("u",), outputs=("y",))
    found = simulate(model, T, u[:, None], model.initial_state(made), stepper=RK4(2))
    return np.asarray(found.y[:, 0])


def rate_limit(limit, gain=1.0):
    return InputRateLimit("u", gain=jnp.array(gain), limit=jnp.array(limit), time=jnp.array(H))


def ideal(u, limit):
    """The ideal limiter, sample by sample."""
    y = [u[0]]
    for value in u[1:]:
        y.append(y[-1] + np.clip(value - y[-1], -limit * H, limit * H))
    return np.array(y)


SIGNALS = {
    "a ramp too fast": 0.3 + 2.0 * np.clip(T - 1.0, 0.0, 1.0),
    "a doublet": 0.3 + np.where((T > 1) & (T < 3), 1.0, np.where((T >= 3) & (T < 5), -1.0, 0.0)),
    "a sine": 0.3 + np.sin(1.5 * T),
}


@pytest.mark.parametrize("name", SIGNALS)
def test_a_rate_limit_is_an_ideal_limiter_to_within_one_sample(name):
    u, limit = SIGNALS[name], 0.7
    found = acting((rate_limit(limit),), u)
    # `changed` runs ahead of the ideal limiter by at most limit * time at each onset.
    assert np.max(np.abs(found - ideal(u, limit))) <= limit * H * (1 + 1e-9)
    assert found[0] == 0.3
    assert np.max(np.abs(u - found)) > 4 * limit * H  # and it does limit
    behind = np.where(np.abs(u - found) > 2 * limit * H, np.sign(u - found), 0.0)
    running = (behind[1:] == behind[:-1]) & (behind[1:] != 0)  # limited all the way, and in one direction
    np.testing.assert_allclose(np.diff(found)[running], limit * H * behind[1:][running], rtol=1e-9)


def test_a_rate_limit_leaves_a_slower_input_as_it_is():
    u = SIGNALS["a sine"]
    np.testing.assert_allclose(acting((rate_limit(1.6),), u), u, rtol=0, atol=1e-14)


def test_half_a_gain_is_half_way():
    u = SIGNALS["a doublet"]
    half, whole = (acting((rate_limit(0.7, gain),), u) for gain in (0.5, 1.0))
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
    assert float(effect.time) == H
    low, high = np.min(signals["u"]), np.max(signals["u"])
    for end, fraction in (("upper", 0.8), ("lower", 0.2)):
        level = float(InputPositionLimit("u", end).start(signals, {}, H).level)
        assert level == pytest.approx(low + fraction * (high - low))
    zone = InputDeadZone("u").start({"t": T, "u": 3.0 + np.sin(T)}, {}, H)
    assert float(zone.centre) == pytest.approx(np.median(3.0 + np.sin(T)))
    assert 0.2 <= float(zone.width) <= 0.4
    assert float(InputRateLimit("u").start({"t": T, "u": 0.0 * T}, {}, H).limit) > 1e3  # an input that never moves
