"""Interpolation of inputs between samples: against sines, shifts and finite differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from jaxid._foundation.checks import InputError
from jaxid._foundation.grid import is_uniform
from jaxid.effects import Augmented, InputBetweenSamples, InputDelay
from jaxid.models import LinearModel
from jaxid.simulation import RK4, BandLimited, Cubic, Linear, ZeroOrder, simulate

HOLDS = {
    "zero-order": ZeroOrder(),
    "linear": Linear(),
    "cubic": Cubic(),
    "band-limited": BandLimited(),
}


def by_holds(*names):
    return pytest.mark.parametrize("hold", [HOLDS[name] for name in names], ids=names)


def signal(seed, n=60):
    """Return a smooth and a rough signal, sampled every 0.1 s."""
    t = 2.0 + 0.1 * np.arange(n)
    return jnp.array(t), jnp.array(
        np.stack([np.sin(2 * t), np.random.default_rng(seed).normal(size=n)], axis=1)
    )


@jax.jit
def values(path, t):
    return jax.vmap(path)(t)


@eqx.filter_jit
def path_of(hold, t, u):
    return hold.path(t, u)


@eqx.filter_jit
def stages(path, t, substeps):
    return path.stages(t, substeps)


@eqx.filter_jit
def delayed(path, lag):
    """The path whose second input is late."""
    return path.delayed(1, lag)


@eqx.filter_jit
def blended(path, weight):
    """The path whose second input is band-limited by a weight."""
    return path.blend_band_limited(1, weight)


def oscillator():
    return LinearModel(
        [[0.0, 1.0], [-4.0, -0.6]],
        [[0.0, 0.0], [1.0, 0.5]],
        [[1.0, 0.0]],
        [[0.0, 0.0]],
        states=("x", "v"),
        inputs=("a", "b"),
        outputs=("x",),
    )


@pytest.mark.parametrize(
    ("hold", "error"),
    [
        # Spline of the fourth order: the error of a component of w per sample is (w^4/384) of its
        # curve, 3e-3 at pi/3.
        (Cubic(), 5e-3),
        # As its documentation states, at less than a third of the sampling rate.
        (BandLimited(), 1e-5),
    ],
    ids=["cubic", "band-limited"],
)
def test_sine_at_third_of_nyquist_is_interpolated_between_samples(hold, error):
    h, n = 0.05, 120
    t = 1.0 + h * np.arange(n)
    w = np.pi / 3 / h

    def wave(t):
        return np.stack([np.sin(w * t + 0.3), np.cos(w * t)], axis=-1)

    path = path_of(hold, jnp.array(t), jnp.array(wave(t)))
    between = np.linspace(t[35], t[-36], 500)
    interpolated = values(path, jnp.array(between))
    np.testing.assert_allclose(interpolated, wave(between), rtol=0, atol=error)
    straight = values(path_of(Linear(), jnp.array(t), jnp.array(wave(t))), jnp.array(between))
    # straight lines leave (w h)^2/8 = 0.14
    assert np.abs(straight - wave(between)).max() > 10 * error


@by_holds("zero-order", "linear", "cubic", "band-limited")
def test_signal_passes_through_samples_and_is_constant_outside(seed, hold):
    t, u = signal(seed)
    path = path_of(hold, t, u)
    # Grid times are sums of steps: a rounding of 1e-14 s meets a slope of 50 per second.
    np.testing.assert_allclose(
        values(path, t + 1e-13 * (hold == ZeroOrder())), u, rtol=0, atol=1e-11
    )
    outside = jnp.array([t[0] - 0.7, t[-1] + 0.7])
    np.testing.assert_allclose(values(path, outside), u[jnp.array([0, -1])], rtol=0, atol=1e-11)


def test_cubic_signal_equals_scipy_spline_with_and_without_padding(seed):
    generator = np.random.default_rng(seed)
    t, u = np.cumsum(generator.uniform(0.1, 0.3, 15)), generator.normal(size=(15, 2))
    between = np.linspace(t[0], t[-1], 101)
    want = CubicSpline(t, u)(between)
    for rows in (0, 4):
        padded = np.pad(t, (0, rows), mode="edge"), np.pad(u, ((0, rows), (0, 0)), mode="edge")
        path = path_of(Cubic(), *map(jnp.array, padded))
        # a solve of 15 rows
        np.testing.assert_allclose(values(path, jnp.array(between)), want, rtol=0, atol=1e-12)


@by_holds("linear", "cubic", "band-limited")
def test_padding_does_not_change_signal_inside_record(seed, hold):
    t, u = signal(seed)
    padded = path_of(
        hold, jnp.pad(t, (0, 9), mode="edge"), jnp.pad(u, ((0, 9), (0, 0)), mode="edge")
    )
    between = jnp.linspace(t[0] - 0.2, t[-1] + 0.3, 201)
    np.testing.assert_allclose(
        values(padded, between), values(path_of(hold, t, u), between), rtol=0, atol=1e-12
    )


def test_held_sample_jumps_at_next_sample():
    path = path_of(ZeroOrder(), jnp.array([0.0, 1.0, 3.0]), jnp.array([[5.0], [-2.0], [7.0]]))
    held = values(path, jnp.array([-1.0, 0.0, 0.999, 1.0, 2.999, 3.0, 4.0]))
    np.testing.assert_array_equal(held[:, 0], [5.0, 5.0, 5.0, -2.0, -2.0, 7.0, 7.0])


def test_stages_use_limits_from_their_side_of_jump(seed):
    t, u = signal(seed, 6)
    held = stages(path_of(ZeroOrder(), t, u), t, 3)
    np.testing.assert_allclose(
        held, np.repeat(u[:-1], 3, axis=0)[:, None] + np.zeros((1, 3, 1)), rtol=0, atol=1e-14
    )
    lines = stages(path_of(Linear(), t, u), t, 2)
    start, rise = np.repeat(u[:-1], 2, axis=0), np.repeat(np.diff(u, axis=0), 2, axis=0)
    share = np.tile([[0.0, 0.25, 0.5], [0.5, 0.75, 1.0]], (5, 1))
    want = start[:, None] + share[:, :, None] * rise[:, None]
    # rounding of times near 2 s, slopes of 30 per second
    np.testing.assert_allclose(lines, want, rtol=0, atol=1e-13)


@pytest.mark.parametrize("factor", [1.001, 3.0])
def test_band_limited_refuses_uneven_sampling(factor):
    even = np.arange(50) * 0.1
    BandLimited().check(even)
    BandLimited().check(np.pad(even, (0, 5), mode="edge"))
    uneven = even.copy()
    uneven[25:] += (factor - 1) * 0.1
    with pytest.raises(InputError, match=r"these sample times are uneven. Use Cubic\(\)"):
        BandLimited().check(uneven)


def test_band_limited_accepts_records_with_different_steps():
    fast = 0.1 * np.arange(40)
    slow = np.pad(1.0 * np.arange(35), (0, 5), mode="edge")
    for interpolation in (BandLimited(), InputBetweenSamples("u")):
        interpolation.check(np.stack([fast, slow]))


@pytest.mark.parametrize(
    ("hold", "least"), [(BandLimited(), 33), (BandLimited(half_width=4), 5), (Cubic(), 4)]
)
def test_too_few_samples_are_refused(hold, least):
    """Padding, which makes a record as long as the others of its stack, does not count."""
    enough, few = np.arange(least) * 1.0, np.arange(least - 1) * 1.0
    hold.check(enough)
    padded = np.stack([enough, np.pad(few, (0, 1), mode="edge")])
    for short in (few, padded):
        with pytest.raises(
            InputError, match=f"more than {least - 1} samples.*one with {least - 1}"
        ):
            hold.check(short)


@by_holds("zero-order", "linear")
def test_delay_by_integer_samples_equals_shift(seed, hold):
    t, u = signal(seed)
    shifted = np.stack([u[:, 0], np.concatenate([np.full(3, u[0, 1]), u[:-3, 1]])], axis=1)
    late, plain = delayed(path_of(hold, t, u), jnp.array(0.3)), path_of(hold, t, jnp.array(shifted))
    # Delayed knots and sample times differ by 1e-15 s, which meets slopes, or jumps in a step of
    # 0.05 s, of up to 50.
    np.testing.assert_allclose(stages(late, t, 2), stages(plain, t, 2), rtol=0, atol=1e-11)
    inside = t[:-1] + 0.037
    np.testing.assert_allclose(values(late, inside), values(plain, inside), rtol=0, atol=1e-11)
    twice = delayed(delayed(path_of(hold, t, u), jnp.array(0.1)), jnp.array(0.2))
    np.testing.assert_allclose(values(twice, inside), values(late, inside), rtol=0, atol=1e-11)


def test_delayed_jump_inside_step_keeps_impulse(seed):
    t, u = signal(seed)
    integrator = LinearModel(
        [[0.0]],
        [[0.0, 1.0]],
        [[1.0]],
        [[0.0, 0.0]],
        states=("x",),
        inputs=("a", "b"),
        outputs=("x",),
    )
    late = Augmented(integrator, (InputDelay("b", jnp.array(0.034)),))
    states = simulate(late, t, u, np.zeros(1), hold=ZeroOrder()).x[:, 0]
    # Each interval integrates 0.034 s of the sample before and 0.066 s of its own.
    before = np.concatenate([u[:1, 1], u[:-2, 1]])
    np.testing.assert_allclose(
        np.diff(states), 0.034 * before + 0.066 * u[:-1, 1], rtol=0, atol=1e-13
    )


def test_step_over_several_delayed_jumps_uses_their_mean(seed):
    """Lost samples leave intervals of several steps, into which a delay moves several jumps."""
    t, u = (array[np.r_[0:7, 9:24, 28:60]] for array in signal(seed))
    path, length = path_of(ZeroOrder(), t, u), np.repeat(np.diff(t) / 2, 2)
    begin = np.repeat(t[:-1], 2) + length * np.tile([0, 1], t.size - 1)
    before = 10.0  # s of the first sample before the record
    knots, held = np.append(t[0] - before, t), np.append(u[0, 1], u[:, 1])
    area = np.append(0.0, np.cumsum(held[:-1] * np.diff(knots)))

    def mean(lag):
        return stages(delayed(path, lag), t, 2)[:, 0, 1]

    for lag in (0.034, 0.134, 0.262):
        want = np.interp(begin + length - lag, knots, area) - np.interp(begin - lag, knots, area)
        # rounding of the integral, of up to 50 u s, over steps of 0.05 s
        np.testing.assert_allclose(mean(jnp.array(lag)), want / length, rtol=0, atol=1e-11)
        ends = (np.searchsorted(knots, at - lag) - 1 for at in (begin, begin + length))
        first, last = (held[rows] for rows in ends)
        slope = jax.jacfwd(mean)(jnp.array(lag))
        np.testing.assert_allclose(slope, (first - last) / length, rtol=0, atol=1e-9)


@by_holds("zero-order", "linear", "cubic", "band-limited")
def test_sensitivity_to_delay_equals_finite_differences(seed, hold):
    """At zero delay the derivative is one-sided, of a delayed signal, also at jumps and bends."""
    t, u = signal(seed)

    @jax.jit
    def outcome(gain):
        model = Augmented(oscillator(), (InputDelay("b", gain),))
        begin, stepper = np.array([0.3, 0.0]), RK4(2, unrolled=False)
        return simulate(model, t, u, begin, hold=hold, stepper=stepper).y[:, 0]

    S = jax.jacfwd(outcome)(jnp.zeros(()))
    scale = np.abs(S).max()
    assert scale > 0.05
    # Half of the second derivative, 1e3 per s^2, times the delay; and 1e-16 of rounding over it.
    forward = (outcome(jnp.array(1e-8)) - outcome(jnp.zeros(()))) / 1e-8
    np.testing.assert_allclose(S, forward, rtol=0, atol=1e-5 * scale)
    # At a delay inside a step nothing bends: third derivative times d^2 and 1e-16/d of rounding.
    inside, d = jnp.array(0.0137), 1e-5
    central = (outcome(inside + d) - outcome(inside - d)) / (2 * d)
    np.testing.assert_allclose(jax.jacfwd(outcome)(inside), central, rtol=0, atol=1e-7 * scale)


@by_holds("zero-order", "linear", "cubic")
def test_blend_of_weight_one_is_band_limited_and_zero_is_original(seed, hold):
    t, u = signal(seed)
    path, target = path_of(hold, t, u), path_of(BandLimited(), t, u)
    inside = jnp.linspace(t[0], t[-1] - 1e-6, 173)
    whole = blended(path, jnp.array(1.0))
    assert np.abs(values(path, inside)[:, 1] - values(target, inside)[:, 1]).max() > 0.1
    for mixed, original, band_limited in (
        (values(whole, inside), values(path, inside), values(target, inside)),
        (stages(whole, t, 2), stages(path, t, 2), stages(target, t, 2)),
    ):
        np.testing.assert_allclose(mixed[..., 1], band_limited[..., 1], rtol=0, atol=1e-13)
        np.testing.assert_allclose(mixed[..., 0], original[..., 0], rtol=0, atol=1e-13)
    none = blended(path, jnp.array(0.0))
    np.testing.assert_allclose(values(none, inside), values(path, inside), rtol=0, atol=1e-14)
    late = blended(delayed(path, jnp.array(0.2)), jnp.array(1.0))
    band_limited = delayed(target, jnp.array(0.2))
    np.testing.assert_allclose(
        values(late, inside)[:, 1], values(band_limited, inside)[:, 1], rtol=0, atol=1e-13
    )


def test_two_effects_on_one_input_commute(seed):
    t, u = signal(seed)
    delay, between = InputDelay("b", jnp.array(0.05)), InputBetweenSamples("b", jnp.array(0.4))
    first, second = (
        simulate(Augmented(oscillator(), pair), t, u, np.zeros(2)).y
        for pair in [(delay, between), (between, delay)]
    )
    np.testing.assert_array_equal(first, second)
    plain = simulate(Augmented(oscillator(), (delay,)), t, u, np.zeros(2)).y
    assert np.abs(plain - first).max() > 1e-4


@pytest.mark.parametrize("first", [0, 30, 333, 1000])
def test_held_sample_belongs_to_its_own_time(first):
    """Also on a grid that begins late, and delayed by whole steps: the knots of a signal are
    the sample times to the last bit.
    """
    t = jnp.asarray(0.01 * np.arange(first, first + 500))
    u = jnp.arange(500.0)[:, None]
    path = path_of(ZeroOrder(), t, u)
    np.testing.assert_array_equal(values(path, t), u)
    late = np.asarray(values(path.delayed(0, jnp.array(0.05)), t))
    np.testing.assert_array_equal(late[5:], u[:-5])


def test_uneven_times_are_uneven_at_any_epoch():
    uneven = 0.05 * np.arange(40) + 0.01 * np.sin(np.arange(40.0))
    for start in (0.0, 86400.0, 1.7e9):
        assert not is_uniform(start + uneven)
        assert is_uniform(start + 0.05 * np.arange(400))
