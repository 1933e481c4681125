"""Lagged signal, resonance and hysteresis: closed forms, initial shapes, rates of signals."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import OutputError, estimate, free
from jaxid._foundation.checks import InputError
from jaxid.data import record
from jaxid.effects import Augmented, Hysteresis, LaggedSignal, Placement, Resonance
from jaxid.models import LinearModel
from jaxid.simulation import RK4, simulate

T = 0.05 * np.arange(161)
IN_Y = Placement.equation("y")


class Integrator(LinearModel):
    """`dx/dt = u`, and a state y that only effects change.

    The signal `twice` is a function of a state, and `ramp` is a function of time.
    """

    def __init__(self):
        zero = np.zeros((2, 2))
        super().__init__(
            zero,
            [[1.0], [0.0]],
            np.eye(2),
            np.zeros((2, 1)),
            states=("x", "y"),
            inputs=("u",),
            outputs=("x", "y"),
        )

    def signals(self, t, x, u):
        return super().signals(t, x, u) | {"twice": 2.0 * x[0], "ramp": 3.0 * t}


def lagged(signal, gain=1.0, time=0.4):
    return LaggedSignal(IN_Y, signal, gain=jnp.array(gain), time=jnp.array(time))


def run(effects, u, start=0.0):
    model = Augmented(Integrator(), effects)
    extra = len(model.states) - 2
    begin, stepper = np.r_[start, 0.0, np.zeros(extra)], RK4(2, unrolled=False)
    actual = simulate(model, T, u[:, None], begin, stepper=stepper).x
    return dict(zip(model.states, np.asarray(actual).T, strict=True))


@pytest.mark.parametrize("start", [0.0, 5.0])
def test_lagged_ramp_starts_at_signal_and_tends_to_rate_times_time(start):
    effect = lagged("x")
    actual = run((effect,), np.full(T.size, 3.0), start)
    # e = -3 time (1 - exp(-t/time)) for any initial x. RK4 with h/time = 1/16 has a relative error
    # of (h/time)^4/120 = 1e-7.
    want = -3.0 * 0.4 * (1 - np.exp(-T / 0.4))
    np.testing.assert_allclose(actual[effect.extra_states[0]], want, rtol=0, atol=2e-7)
    np.testing.assert_allclose(
        actual["y"], -1.2 * (T - 0.4 * (1 - np.exp(-T / 0.4))), rtol=0, atol=2e-7
    )


def test_short_lag_equals_derivative():
    effect = lagged("x", time=0.02)
    actual = run((effect,), np.cos(T))
    # After some time constants e = -time dx/dt, with a relative error of the order of time.
    np.testing.assert_allclose(
        actual[effect.extra_states[0]][10:], -0.02 * np.cos(T)[10:], rtol=0, atol=0.02**2 * 1.01
    )


def test_rate_of_computed_signal_follows_from_chain_rule():
    direct, through, of_time = lagged("x", 0.0), lagged("twice", 0.0), lagged("ramp", 0.0)
    actual = run((direct, through, of_time), np.cos(T))
    np.testing.assert_allclose(
        actual[through.extra_states[0]],
        2.0 * actual[direct.extra_states[0]],
        rtol=1e-12,
        atol=1e-15,
    )
    np.testing.assert_allclose(
        actual[of_time.extra_states[0]], -1.2 * (1 - np.exp(-T / 0.4)), rtol=0, atol=2e-7
    )


@pytest.mark.parametrize("signal", ["u", "z"])
def test_signal_without_rate_is_refused(signal):
    with pytest.raises(InputError, match=f"no signal with a rate '{signal}'"):
        Augmented(Integrator(), (lagged(signal),)).rhs(jnp.zeros(()), jnp.zeros(3), jnp.zeros(1))


def test_resonance_has_step_response_of_second_order_system():
    w, damping = 2.0, 0.1
    effect = Resonance(
        IN_Y, "u", gain=jnp.array(0.0), frequency=jnp.array(w), damping=jnp.array(damping)
    )
    actual = run((effect,), np.ones(T.size))
    damped = w * np.sqrt(1 - damping**2)
    decay = np.exp(-damping * w * T)
    want = 1 - decay * (np.cos(damped * T) + damping * w / damped * np.sin(damped * T))
    # RK4 with two steps per sample, w h = 0.05: (w h)^5/120 = 3e-9 in each of 320 steps.
    np.testing.assert_allclose(actual[effect.extra_states[0]], want, rtol=0, atol=1e-6)
    with_it = run(
        (
            Resonance(
                IN_Y, "u", gain=jnp.array(3.0), frequency=jnp.array(w), damping=jnp.array(damping)
            ),
        ),
        np.ones(T.size),
    )
    speed = decay * np.sin(damped * T) / np.sqrt(1 - damping**2)  # dz/dt = w times this
    np.testing.assert_allclose(
        with_it["y"], 3.0 * (T - (2 * damping * want + speed) / w), rtol=0, atol=1e-5
    )


def test_resonance_starts_at_peak_of_relative_residual():
    """The residual itself is largest at the declared model's resonance, here 1.5 rad/s."""
    t, unit = 0.1 * np.arange(400), 2 * np.pi / 40.0  # unit: the resolution of 40 s
    noise = 0.01 * np.random.default_rng(0).normal(size=(2, 400))
    shown = 10.0 * np.sin(1.5 * t) + 0.5 * np.sin(3.2 * t) + 0.5 * np.sin(5.03 * t)
    residual = np.sin(1.5 * t) + 0.1 * np.sin(3.2 * t) + 0.3 * np.sin(5.03 * t)
    both = {
        "t": np.r_[t, t],
        "simulated y": np.r_[shown, shown],
        "residual y": np.r_[residual, residual] + noise.reshape(-1),
    }
    both |= {"simulated still": np.zeros(800), "residual still": np.zeros(800)}
    high, low = (Resonance(IN_Y, "u", peak).initialise_shape(both, {}, 0.1) for peak in (1, 2))
    assert (float(high.frequency), float(low.frequency)) == (
        pytest.approx(5.03, abs=unit),
        pytest.approx(3.2, abs=unit),
    )
    assert float(high.damping) * float(high.frequency) == pytest.approx(unit, rel=1e-9)
    assert high.card.bounds["frequency"][1] == 10.0  # one radian in a step
    # records on a common clock
    common = both | {"t": np.r_[t, t + 100.0], "number of the record": np.repeat([0.0, 1.0], 400)}
    again = Resonance(IN_Y, "u", 2).initialise_shape(common, {}, 0.1)
    assert (float(again.frequency), float(again.damping)) == (
        float(low.frequency),
        float(low.damping),
    )
    still = Resonance(IN_Y, "u").initialise_shape({"t": t}, {}, 0.1)
    assert (float(still.frequency), float(still.damping)) == (1.0, 0.35)
    starts = {
        float(Resonance(IN_Y, "u", peak).initialise_shape({"t": t}, {}, 0.1).frequency)
        for peak in (1, 2, 3)
    }
    assert len(starts) == 3  # the initial frequencies differ also without a peak


def test_resonance_starts_in_equilibrium_with_first_input():
    """An input in trim is not zero, and does not excite the mode."""
    model = Augmented(
        Integrator(), (Resonance(IN_Y, "u", gain=jnp.array(3.0), frequency=jnp.array(5.0)),)
    )
    held = np.full((T.size, 1), -0.2)
    begin = model.initial_state(
        record(T, held, np.zeros((T.size, 2)), inputs=("u",), outputs=("x", "y"))
    )
    np.testing.assert_array_equal(begin, [0.0, 0.0, -0.2, 0.0])
    np.testing.assert_allclose(simulate(model, T, held, begin).x[:, 2], -0.2, rtol=0, atol=1e-14)


def test_hysteresis_follows_bouc_wen_and_encloses_area():
    effect = Hysteresis(IN_Y, "x", gain=jnp.array(0.0), width=jnp.array(0.3))
    w = 2 * np.pi / 4.0
    actual = run((effect,), w * np.cos(w * T))  # x = sin(w t), two cycles
    x, z = actual["x"], actual[effect.extra_states[0]]
    rising = slice(0, 21)
    # With linear inputs x has an error of (w h)^2/12 = 5e-4 of its rate; z is compared with the
    # simulated x, and its error is of the order of h^4.
    np.testing.assert_allclose(z[rising], np.tanh(x[rising] / 0.3), rtol=0, atol=1e-5)
    back = slice(20, 21 + 6)  # until z is zero again: z - z(20) = (x - x(20)) / width
    assert np.all(z[back] > 0)
    np.testing.assert_allclose(z[back] - z[20], (x[back] - x[20]) / 0.3, rtol=0, atol=1e-4)
    assert np.all(np.abs(z) <= 1.0)
    cycle = slice(80, 161)
    area = np.sum(0.5 * (z[cycle][1:] + z[cycle][:-1]) * np.diff(x[cycle]))
    # Trapezoidal rule: the relative error is (w h/width)^2/12 with w h/width = 0.26.
    assert area == pytest.approx(loop_area(1.0, 0.3), rel=5e-3)


def test_shape_of_hysteresis_follows_its_exponent_and_reversal():
    """With n = 1 and b = 1: z = 1 - exp(-x/width) on the way up, and from the peak at (x1, z1) down
    to z = 0, z = (1 + z1) exp((x - x1)/width) - 1.
    """
    shape = {"exponent": jnp.array(1.0), "reversal": jnp.array(1.0)}
    effect = Hysteresis(IN_Y, "x", width=jnp.array(0.3), **shape, free_shape=True)
    w = 2 * np.pi / 4.0
    actual = run((effect,), w * np.cos(w * T))
    x, z = actual["x"], actual[effect.extra_states[0]]
    np.testing.assert_allclose(z[:21], 1.0 - np.exp(-x[:21] / 0.3), rtol=0, atol=1e-4)
    down = 20 + np.flatnonzero(z[20:40] > 0)
    expected = (1.0 + z[20]) * np.exp((x[down] - x[20]) / 0.3) - 1.0
    np.testing.assert_allclose(z[down], expected, rtol=0, atol=1e-3)


def test_shape_of_hysteresis_is_estimated(seed):
    shape = {"gain": -0.8, "width": 0.3, "exponent": 1.2, "reversal": 0.8}
    loop = Hysteresis(IN_Y, "x", free_shape=True, **{n: jnp.array(v) for n, v in shape.items()})
    rng, truth = np.random.default_rng(seed), Augmented(Integrator(), (loop,))
    u = 0.3 * np.cumsum(rng.normal(size=(8, T.size, 1)), axis=1)
    sigma = np.array([0.02, 0.02])
    records, steps = [], RK4(4, unrolled=False)
    for one in u:
        y = simulate(truth, T, one, np.zeros(3), stepper=steps).y
        y = y + sigma * rng.normal(size=(T.size, 2))
        records.append(record(T, one, y, inputs=("u",), outputs=("x", "y")))
    begin = Hysteresis(IN_Y, "x", free_shape=True, gain=jnp.array(-0.5), width=jnp.array(0.5))
    model = Augmented(Integrator(), (begin,))
    names = [f"{begin.name}.{name}" for name in shape]
    fit = estimate(
        model,
        free(model, *names, per_record=("initial_state",)),
        records,
        OutputError(stepper=steps),
    )
    for name, true in zip(names, shape.values(), strict=True):
        error = fit.standard_error(name)
        assert abs(fit.value(name) - true) < 4.0 * error, name
        assert error < 0.2 * abs(true), name


def loop_area(amplitude, width):
    """Return the area of the steady loop between -amplitude and amplitude.

    The rising half cycle from (-a, -z1) consists of the line z = -z1 + (x + a)/width up to z = 0 at
    x0 = -a + z1 width, and of tanh((x - x0)/width), which ends at (a, z1), so that
    z1 = tanh((2 a - z1 width)/width).
    """
    z1 = 1.0
    for _ in range(50):
        z1 = np.tanh((2 * amplitude - z1 * width) / width)
    up = -0.5 * z1**2 * width + width * np.log(np.cosh((2 * amplitude - z1 * width) / width))
    return 2.0 * up


def test_hysteresis_stays_finite_for_too_long_step():
    effect = Hysteresis(IN_Y, "x", gain=jnp.array(1.0), width=jnp.array(1e-4))
    actual = run((effect,), np.sign(np.sin(3 * T)))
    assert np.all(np.isfinite(actual["y"]))


def test_shapes_start_at_time_scale_and_deviation_of_signals():
    t = np.linspace(0, 2 * np.pi, 1001)
    signals = {"t": t, "x": np.sin(5 * t)}
    assert float(
        LaggedSignal(IN_Y, "x", 2.0).initialise_shape(signals, {}, 0.01).time
    ) == pytest.approx(0.4, rel=1e-3)
    assert (
        float(LaggedSignal(IN_Y, "x", 0.01).initialise_shape(signals, {}, 0.01).time) == 0.02
    )  # no shorter than two steps
    # no longer than the record
    slow = LaggedSignal(IN_Y, "x", 100.0).initialise_shape(signals, {}, 0.01)
    assert float(slow.time) == slow.card.bounds["time"][1] == pytest.approx(2 * np.pi)
    assert float(Hysteresis(IN_Y, "x").initialise_shape(signals, {}, 0.01).width) == pytest.approx(
        0.2, rel=1e-4
    )


def test_states_of_lag_and_hysteresis_start_at_zero():
    z = np.stack([1.0 + T, T], axis=1)
    data = record(T, z[:, :1], z, inputs=("u",), outputs=("x", "y"))
    model = Augmented(Integrator(), (lagged("x"), Hysteresis(IN_Y, "x")))
    np.testing.assert_array_equal(model.initial_state(data), [1.0, 0.0, 0.0, 0.0])
