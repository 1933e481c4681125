"""A signal that acts with a lag, a resonance, and hysteresis: closed forms, and rates of signals that are no states."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.data import record
from jaxid.models import Acting, Augmented, Hysteresis, LaggedSignal, LinearModel, Resonance
from jaxid.simulation import RK4, simulate

T = 0.05 * np.arange(161)
BESIDE = Acting.equation("y")


class Integrator(LinearModel):
    """`dx/dt = u`, beside a y that only effects move; `twice` is a signal made of a state, and `ramp` one of time."""

    def __init__(self):
        zero = np.zeros((2, 2))
        super().__init__(
            zero, [[1.0], [0.0]], np.eye(2), np.zeros((2, 1)), states=("x", "y"), inputs=("u",), outputs=("x", "y")
        )

    def signals(self, t, x, u):
        return super().signals(t, x, u) | {"twice": 2.0 * x[0], "ramp": 3.0 * t}


def lagged(signal, gain=1.0, time=0.4):
    return LaggedSignal(BESIDE, signal, gain=jnp.array(gain), time=jnp.array(time))


def run(effects, u, start=0.0):
    model = Augmented(Integrator(), effects)
    extra = len(model.states) - 2
    found = simulate(model, T, u[:, None], np.r_[start, 0.0, np.zeros(extra)], stepper=RK4(2)).x
    return dict(zip(model.states, np.asarray(found).T, strict=True))


@pytest.mark.parametrize("start", [0.0, 5.0])
def test_a_lag_behind_a_ramp_starts_at_the_signal_and_falls_back_by_rate_times_time(start):
    effect = lagged("x")
    found = run((effect,), np.full(T.size, 3.0), start)
    # e = -3 time (1 - exp(-t/time)), whatever x begins with. RK4 with h/time = 1/16: (h/time)^4/120 = 1e-7 of it.
    want = -3.0 * 0.4 * (1 - np.exp(-T / 0.4))
    np.testing.assert_allclose(found[effect.extra_states[0]], want, rtol=0, atol=2e-7)
    np.testing.assert_allclose(found["y"], -1.2 * (T - 0.4 * (1 - np.exp(-T / 0.4))), rtol=0, atol=2e-7)


def test_a_short_lag_is_a_derivative():
    effect = lagged("x", time=0.02)
    found = run((effect,), np.cos(T))
    # e -> -time dx/dt, with an error of the order of time; after the start of some times.
    np.testing.assert_allclose(found[effect.extra_states[0]][10:], -0.02 * np.cos(T)[10:], rtol=0, atol=0.02**2 * 1.01)


def test_the_rate_of_a_signal_that_is_no_state_comes_by_the_chain_rule():
    direct, through, of_time = lagged("x", 0.0), lagged("twice", 0.0), lagged("ramp", 0.0)
    found = run((direct, through, of_time), np.cos(T))
    np.testing.assert_allclose(
        found[through.extra_states[0]], 2.0 * found[direct.extra_states[0]], rtol=1e-12, atol=1e-15
    )
    np.testing.assert_allclose(found[of_time.extra_states[0]], -1.2 * (1 - np.exp(-T / 0.4)), rtol=0, atol=2e-7)


@pytest.mark.parametrize("signal", ["u", "z"])
def test_a_signal_without_a_rate_is_refused(signal):
    with pytest.raises(InputError, match=f"no signal with a rate '{signal}'"):
        Augmented(Integrator(), (lagged(signal),)).rhs(jnp.zeros(()), jnp.zeros(3), jnp.zeros(1))


def test_a_resonance_answers_a_step_as_a_second_order_system():
    w, damping = 2.0, 0.1
    effect = Resonance(BESIDE, "u", gain=jnp.array(0.0), frequency=jnp.array(w), damping=jnp.array(damping))
    found = run((effect,), np.ones(T.size))
    quick = w * np.sqrt(1 - damping**2)
    decay = np.exp(-damping * w * T)
    want = 1 - decay * (np.cos(quick * T) + damping * w / quick * np.sin(quick * T))
    # RK4 of two steps to a sample, w h = 0.05: (w h)^5/120 a step, 3e-9 in each of 320 of them.
    np.testing.assert_allclose(found[effect.extra_states[0]], want, rtol=0, atol=1e-6)
    with_it = run(
        (Resonance(BESIDE, "u", gain=jnp.array(3.0), frequency=jnp.array(w), damping=jnp.array(damping)),),
        np.ones(T.size),
    )
    speed = decay * np.sin(quick * T) / np.sqrt(1 - damping**2)  # dz/dt = w times this
    np.testing.assert_allclose(with_it["y"], 3.0 * (T - (2 * damping * want + speed) / w), rtol=0, atol=1e-5)


def test_a_resonance_starts_where_the_declared_model_errs_most_beside_what_it_shows():
    """Not where the residual is largest: that is at the declared model's own resonance, here 1.5 rad/s, whatever it lacks."""
    t, unit = 0.1 * np.arange(400), 2 * np.pi / 40.0  # unit: the resolution of 40 s
    noise = 0.01 * np.random.default_rng(0).normal(size=(2, 400))
    shown = 10.0 * np.sin(1.5 * t) + 0.5 * np.sin(3.2 * t) + 0.5 * np.sin(5.03 * t)
    residual = np.sin(1.5 * t) + 0.1 * np.sin(3.2 * t) + 0.3 * np.sin(5.03 * t)
    both = {
        "t": np.r_[t, t],
        "shown y": np.r_[shown, shown],
        "residual y": np.r_[residual, residual] + noise.reshape(-1),
    }
    both |= {"shown still": np.zeros(800), "residual still": np.zeros(800)}
    high, low = (Resonance(BESIDE, "u", peak).start(both, {}, 0.1) for peak in (1, 2))
    assert (float(high.frequency), float(low.frequency)) == (
        pytest.approx(5.03, abs=unit),
        pytest.approx(3.2, abs=unit),
    )
    assert float(high.damping) * float(high.frequency) == pytest.approx(unit, rel=1e-9)
    assert high.bounds["frequency"][1] == 10.0  # one radian in a step
    apart = both | {"t": np.r_[t, t + 100.0], "number of the record": np.repeat([0.0, 1.0], 400)}  # on one clock
    again = Resonance(BESIDE, "u", 2).start(apart, {}, 0.1)
    assert (float(again.frequency), float(again.damping)) == (float(low.frequency), float(low.damping))
    still = Resonance(BESIDE, "u").start({"t": t}, {}, 0.1)
    assert (float(still.frequency), float(still.damping)) == (1.0, 0.35)
    starts = {float(Resonance(BESIDE, "u", peak).start({"t": t}, {}, 0.1).frequency) for peak in (1, 2, 3)}
    assert len(starts) == 3  # without a peak they differ all the same


def test_a_resonance_is_settled_where_the_first_input_holds_it():
    """An input in trim is not zero, and does not set off what bends."""
    model = Augmented(Integrator(), (Resonance(BESIDE, "u", gain=jnp.array(3.0), frequency=jnp.array(5.0)),))
    held = np.full((T.size, 1), -0.2)
    begin = model.initial_state(record(T, held, np.zeros((T.size, 2)), inputs=("u",), outputs=("x", "y")))
    np.testing.assert_array_equal(begin, [0.0, 0.0, -0.2, 0.0])
    np.testing.assert_allclose(simulate(model, T, held, begin).x[:, 2], -0.2, rtol=0, atol=1e-14)


def test_hysteresis_follows_wen_and_encloses_an_area():
    effect = Hysteresis(BESIDE, "x", gain=jnp.array(0.0), width=jnp.array(0.3))
    w = 2 * np.pi / 4.0
    found = run((effect,), w * np.cos(w * T))  # x = sin(w t), two cycles
    x, z = found["x"], found[effect.extra_states[0]]
    rising = slice(0, 21)
    # RK4 with linear inputs: (w h)^2/12 = 5e-4 of the rate enters x itself, which is taken as it is; z follows to h^4.
    np.testing.assert_allclose(z[rising], np.tanh(x[rising] / 0.3), rtol=0, atol=1e-5)
    back = slice(20, 21 + 6)  # until z is zero again: z - z(20) = (x - x(20)) / width
    assert np.all(z[back] > 0)
    np.testing.assert_allclose(z[back] - z[20], (x[back] - x[20]) / 0.3, rtol=0, atol=1e-4)
    assert np.all(np.abs(z) <= 1.0)
    cycle = slice(80, 161)
    area = np.sum(0.5 * (z[cycle][1:] + z[cycle][:-1]) * np.diff(x[cycle]))
    # Trapezoids of h: the bend of tanh within w h/width = 0.26 of a width leaves (0.26)^2/12 of it.
    assert area == pytest.approx(loop_area(1.0, 0.3), rel=5e-3)


def loop_area(amplitude, width):
    """The area of the steady loop between -amplitude and amplitude, from the two pieces of each half cycle.

    On the way up from (-a, -z1): the line z = -z1 + (x + a)/width up to z = 0 at x0 = -a + z1 width, then tanh((x - x0)/width),
    which ends at (a, z1): z1 = tanh((2 a - z1 width)/width).
    """
    z1 = 1.0
    for _ in range(50):
        z1 = np.tanh((2 * amplitude - z1 * width) / width)
    up = -0.5 * z1**2 * width + width * np.log(np.cosh((2 * amplitude - z1 * width) / width))
    return 2.0 * up


def test_hysteresis_stays_finite_where_a_step_is_too_long():
    effect = Hysteresis(BESIDE, "x", gain=jnp.array(1.0), width=jnp.array(1e-4))
    found = run((effect,), np.sign(np.sin(3 * T)))
    assert np.all(np.isfinite(found["y"]))


def test_shapes_start_from_the_signals():
    t = np.linspace(0, 2 * np.pi, 1001)
    signals = {"t": t, "x": np.sin(5 * t)}
    assert float(LaggedSignal(BESIDE, "x", 2.0).start(signals, {}, 0.01).time) == pytest.approx(0.4, rel=1e-3)
    assert float(LaggedSignal(BESIDE, "x", 0.01).start(signals, {}, 0.01).time) == 0.02  # no shorter than two steps
    slow = LaggedSignal(BESIDE, "x", 100.0).start(signals, {}, 0.01)  # no longer than the record
    assert float(slow.time) == slow.bounds["time"][1] == pytest.approx(2 * np.pi)
    assert float(Hysteresis(BESIDE, "x").start(signals, {}, 0.01).width) == pytest.approx(0.2, rel=1e-4)


def test_their_states_start_at_zero():
    z = np.stack([1.0 + T, T], axis=1)
    data = record(T, z[:, :1], z, inputs=("u",), outputs=("x", "y"))
    model = Augmented(Integrator(), (lagged("x"), Hysteresis(BESIDE, "x")))
    np.testing.assert_array_equal(model.initial_state(data), [1.0, 0.0, 0.0, 0.0])
