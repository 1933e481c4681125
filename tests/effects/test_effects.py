"""All general effects: absence at gain zero, sensitivities by finite differences, behaviour."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.data import record
from jaxid.effects import (
    Augmented,
    DryFriction,
    InputBetweenSamples,
    InputBias,
    InputHysteresis,
    InputLag,
    InputScale,
    SensorDelay,
    SensorLag,
    SensorSaturation,
    SensorScale,
    StateLimit,
    Term,
    general_effects,
)
from jaxid.effects.library import initialise_shapes, uncertain_equations
from jaxid.models import AbstractModel, LinearModel, Polynomial
from jaxid.simulation import RK4, simulate


class Duffing(AbstractModel):
    k: object
    c: object
    states, inputs, outputs = ("x", "v"), ("u",), ("y",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1]])

    def output(self, t, x, u):
        return x[:1] + 0.2 * x[1:]


MODEL = Duffing(jnp.array(4.0), jnp.array(0.4))
T = 0.1 * np.arange(50)
U = np.sin(1.3 * T + 0.5)[:, None] + 0.5 * np.cos(4.0 * T)[:, None]
START = np.array([0.7, 0.9])
MEASURED = (InputBias("u"), InputScale("u"))  # effects of inputs measured by instruments
BY_HAND = (*MEASURED, InputHysteresis("u"))
LIBRARY = Augmented(MODEL, (*general_effects(MODEL, ("x", "v")), *BY_HAND)).effects_in
NAMES = [effect.name for effect in LIBRARY]
ONE_OF_EACH_CLASS = {type(effect): effect.name for effect in reversed(LIBRARY)}.values()
# effects without influence here: the level is not exceeded, or there is no grid
WITHOUT_INFLUENCE = {"upper saturation of y", "lower saturation of y", "quantisation of y"}
STEP = 1e-5


def answer(model, start=START):
    return simulate(model, T, U, start, stepper=RK4(2, unrolled=False))


@pytest.fixture(scope="module")
def plain():
    return answer(MODEL)


@pytest.fixture(scope="module")
def effects(plain):
    """All general effects with their shapes set from the simulation."""
    signals = {"t": T, "x": np.array(plain.x[:, 0]), "v": np.array(plain.x[:, 1]), "u": U[:, 0]}
    signals |= {"residual y": np.sin(3.0 * T), "simulated y": np.array(plain.y[:, 0])}
    return initialise_shapes(LIBRARY, signals, {"y": np.array(plain.y[:, 0])}, 0.1)


@pytest.fixture(scope="module")
def outcome(effects):
    """Function from a vector of gains to the outputs, compiled once for all effects."""
    model = Augmented(MODEL, effects)
    extra = len(model.states) - 2

    @jax.jit
    def y(gains):
        filled = eqx.tree_at(lambda m: [e.gain for e in m.effects_in], model, list(gains))
        return answer(filled, jnp.concatenate([jnp.asarray(START), jnp.zeros(extra)])).y[:, 0]

    return y


@pytest.fixture(scope="module")
def sensitivities(outcome):
    return np.asarray(jax.jit(jax.jacfwd(outcome))(jnp.zeros(len(NAMES))))


@pytest.fixture(scope="module")
def differences(outcome):
    """One-sided second-order differences on either side of zero."""
    count = len(NAMES)
    sizes = np.array([STEP, 2 * STEP, -STEP, -2 * STEP])
    gains = np.concatenate([np.zeros((1, count)), np.kron(sizes[:, None], np.eye(count))])
    zero, *moved = np.split(np.asarray(jax.lax.map(outcome, gains)), 1 + count * np.arange(4))
    return [
        (4 * near - far - 3 * zero) / (2 * d)
        for d, near, far in ((STEP, *moved[:2]), (-STEP, *moved[2:]))
    ]


def test_all_effects_together_are_absent_at_gain_zero(outcome, plain):
    np.testing.assert_allclose(outcome(jnp.zeros(len(NAMES))), plain.y[:, 0], rtol=0, atol=1e-12)


def test_each_effect_is_absent_at_gain_zero(effects, plain):
    for effect in {type(effect): effect for effect in effects}.values():
        assert effect.gain == 0
        model = Augmented(MODEL, (effect,))
        actual = answer(model, np.pad(START, (0, len(effect.extra_states))))
        np.testing.assert_allclose(
            actual.x[:, :2], plain.x, rtol=0, atol=1e-12, err_msg=effect.name
        )
        np.testing.assert_allclose(actual.y, plain.y, rtol=0, atol=1e-12, err_msg=effect.name)


def test_effects_with_default_shapes_are_constant_at_long_steps():
    """At steps of 4 s, as here, the additional states of effects could diverge."""
    slow = LinearModel(
        [[-0.01]], [[0.01]], [[1.0]], [[0.0]], states=("x",), inputs=("u",), outputs=("y",)
    )
    t, u = 4.0 * np.arange(1000), np.sign(np.sin(0.05 * np.arange(1000)))[:, None]
    library = general_effects(slow, ("x",))
    assert {"Hysteresis", "InputLag", "LaggedSignal", "Resonance"} <= {
        type(effect).__name__ for effect in library
    }
    model = Augmented(slow, library)
    actual = simulate(model, t, u, np.zeros(len(model.states)))
    assert np.all(np.isfinite(actual.x))
    np.testing.assert_allclose(actual.y, simulate(slow, t, u, np.zeros(1)).y, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_sensitivity_at_gain_zero_equals_finite_difference(
    effects, sensitivities, differences, name
):
    column = NAMES.index(name)
    assert effects[column].name == name
    S = sensitivities[:, column]
    assert np.all(np.isfinite(S))
    if name in WITHOUT_INFLUENCE:
        assert effects[column].card.initial_gain == 1.0  # a refit starts at a gain with influence
        np.testing.assert_allclose(S, 0.0, rtol=0, atol=1e-12)
        return
    # A delayed output is constant before the record, and an early output after it, so the two end
    # samples have different derivatives on either side.
    rows = slice(1, -1) if name == "delay of y" else slice(None)
    scale = np.abs(S).max()
    assert scale > 1e-3
    # Error: rounding of 1e-16/1e-5, and the third derivative times the square of the step. A
    # delayed input changes slope inside the two steps next to a sample; there the derivatives on
    # the two sides differ by h/6 of the change of slope.
    tolerance = 5e-2 if name == "delay of input u" else 1e-6
    best = min(np.abs(S - side[column])[rows].max() for side in differences)
    assert best < tolerance * scale, f"{best / scale:.1e} of {scale:.1e}"


def static(slope=1.0):
    """Return a model with `y = slope * u` and a constant state."""
    return LinearModel(
        [[0.0]], [[0.0]], [[0.0]], [[slope]], states=("x",), inputs=("u",), outputs=("y",)
    )


def observed(effect, t, signal):
    return simulate(Augmented(static(), (effect,)), t, signal[:, None], np.zeros(1)).y[:, 0]


@pytest.mark.parametrize("lag", [0.03, 0.1, 2.0])
def test_sensor_lag_is_exact_for_ramp_on_uneven_samples(seed, lag):
    t = np.concatenate([[0.0], np.cumsum(np.random.default_rng(seed).uniform(0.02, 0.3, 40))])
    actual = observed(SensorLag("y", jnp.array(lag)), t, 3.0 + 2.0 * t)
    # w = y - lag * slope * (1 - exp(-t/lag)), from equilibrium.
    np.testing.assert_allclose(
        actual, 3.0 + 2.0 * t - 2.0 * lag * (1 - np.exp(-t / lag)), rtol=1e-13
    )


def test_sensor_lag_begins_in_motion():
    t, w, lag = np.linspace(0, 6, 601), 2.0, 0.4
    # steady response to sin(w t): amplitude 1 / |1 + i w lag|, phase -atan(w lag)
    steady = np.imag(np.exp(1j * w * t) / (1 + 1j * w * lag))
    effect = SensorLag("y", jnp.array(lag), jnp.array(-steady[0]))
    # A straight line between samples is off by at most (w h)^2/8.
    atol = (w * t[1]) ** 2 / 8
    np.testing.assert_allclose(observed(effect, t, np.sin(w * t)), steady, rtol=0, atol=atol)


def test_sensor_delay_shifts_sine():
    t, w = 0.05 * np.arange(100), 2.0
    actual = observed(SensorDelay("y", jnp.array(0.033)), t, np.sin(w * t))
    # The slopes at the samples are central differences, with an error of (w h)^3/6 of the rate; the
    # cubics reduce it to at most a tenth.
    np.testing.assert_allclose(
        actual[2:-2], np.sin(w * (t - 0.033))[2:-2], rtol=0, atol=0.1 * (w * 0.05) ** 3 / 6 + 1e-6
    )
    two_samples = observed(SensorDelay("y", jnp.array(0.1)), t, np.sin(w * t))
    np.testing.assert_allclose(two_samples[2:], np.sin(w * t[:-2]), rtol=0, atol=1e-13)
    # before the record the output is a straight line
    line = np.sin(w * 0.05) / 0.05 * (t[:2] - 0.1)
    np.testing.assert_allclose(two_samples[:2], line, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("gain", [0.05, -0.05])
def test_sensor_delay_is_independent_of_padding(gain):
    t, effect = 0.1 * np.arange(30), SensorDelay("y", jnp.array(gain))
    padded = observed(
        effect, np.pad(t, (0, 6), mode="edge"), np.pad(np.sin(2 * t), (0, 6), mode="edge")
    )
    np.testing.assert_allclose(padded[:30], observed(effect, t, np.sin(2 * t)), rtol=0, atol=1e-14)


@pytest.mark.parametrize("end", ["upper", "lower"])
def test_sensor_saturation_clips_in_proportion_to_gain(end):
    t = 0.1 * np.arange(60)
    signal = np.sin(t)
    sign = 1.0 if end == "upper" else -1.0
    clipped = sign * np.minimum(sign * signal, 0.3)
    for gain in (1.0, 0.5):
        effect = SensorSaturation("y", end, jnp.array(gain), jnp.array(0.3 * sign))
        want = signal + gain * (clipped - signal)
        np.testing.assert_allclose(observed(effect, t, signal), want, rtol=0, atol=1e-15)


def test_sensor_saturation_is_scored_blind_if_extreme_value_repeats():
    effect = SensorSaturation("y", "upper")
    signal = np.sin(np.arange(50.0))
    assert not effect.score_blind({"y": signal})
    assert effect.score_blind({"y": np.minimum(signal, 0.8)})
    assert not SensorSaturation("y", "lower").score_blind({"y": np.minimum(signal, 0.8)})
    assert effect.initialise_shape({}, {"y": np.minimum(signal, 0.8)}, 1.0).level == 0.8


@pytest.mark.parametrize(
    ("read", "expected"),
    [
        (lambda y: np.minimum(y, 0.8), True),
        (lambda y: y, False),
        # coarse quantisation: no more samples at the end than elsewhere
        (lambda y: np.round(y, 1), False),
        # long time at rest
        (lambda y: np.where(np.arange(y.size) < 60, 0.0, np.minimum(y, 0.8)), False),
    ],
    ids=["saturated", "not saturated", "coarse", "at rest"],
)
def test_sensor_saturation_is_evident_if_only_extreme_value_repeats_often(read, expected):
    signal = np.sin(0.3 * np.arange(200.0)) + 0.01 * np.random.default_rng(0).normal(size=200)
    assert SensorSaturation("y", "upper").evident_in_data({"y": (read(signal),)}) is expected
    assert not SensorSaturation("y", "lower").evident_in_data({"y": (np.minimum(signal, 0.8),)})
    assert not Term("v", "x").evident_in_data({"y": (np.minimum(signal, 0.8),)})


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rest_at_start_or_end_of_records_is_no_saturation(sign):
    saturation = SensorSaturation("y", "upper" if sign > 0 else "lower")
    assert not saturation.evident_in_data({"y": (np.zeros(100),)})
    rest, motion = np.zeros(200), -np.abs(np.round(np.sin(0.3 * np.arange(1.0, 200.0)), 2))
    begins, ends = sign * np.r_[rest, motion], sign * np.r_[motion, rest]
    assert not saturation.evident_in_data({"y": (begins, ends)})
    # The same number of equal samples amid a record is a saturation.
    assert saturation.evident_in_data({"y": (np.r_[ends, begins],)})


def tanks():
    """Return a model of two integrators with an input into the first."""
    return LinearModel(
        np.zeros((2, 2)),
        [[1.0], [0.0]],
        np.eye(2),
        np.zeros((2, 1)),
        states=("a", "b"),
        inputs=("u",),
        outputs=("a", "b"),
    )


@pytest.mark.parametrize("share", [1.0, 0.25, 0.0])
def test_overflow_arrives_in_its_share(share):
    effect = StateLimit("a", "b", gain=jnp.array(2.0), level=jnp.array(1.0), share=jnp.array(share))
    t = 0.1 * np.arange(60)
    actual = simulate(
        Augmented(tanks(), (effect,)),
        t,
        np.ones((60, 1)),
        np.zeros(2),
        stepper=RK4(4, unrolled=False),
    ).x
    # Filled at one per second: above the level the excess is (1 - exp(-2 s))/2 with s = t - 1.
    since = np.maximum(t - 1.0, 0.0)
    excess = 0.5 * (1 - np.exp(-2 * since))
    # RK4 with h = 0.025 s has an error of (2 h)^4/120 = 5e-8; the level is reached at a sample.
    np.testing.assert_allclose(actual[:, 0], np.minimum(t, 1.0) + excess, rtol=0, atol=1e-7)
    np.testing.assert_allclose(actual[:, 1], share * (since - excess), rtol=0, atol=1e-7)
    if share == 1.0:
        # the sum is conserved up to rounding
        np.testing.assert_allclose(actual.sum(axis=1), t, rtol=1e-13, atol=1e-14)


def test_dry_friction_is_zero_at_rest_and_constant_in_motion():
    effect = DryFriction("x", "x", jnp.array(-0.7)).initialise_shape(
        {"x": np.array([-3.0, 2.0])}, {}, 0.1
    )
    np.testing.assert_allclose(effect.width, 0.03, rtol=1e-15)
    model = Augmented(static(), (effect,))
    for speed, rate in [(0.0, 0.0), (2.0, -0.7), (-2.0, 0.7)]:
        np.testing.assert_allclose(
            model.rhs(jnp.zeros(()), jnp.array([speed]), jnp.zeros(1)), [rate], rtol=1e-15
        )
    slope = jax.jacfwd(lambda x: model.rhs(jnp.zeros(()), x, jnp.zeros(1)))(jnp.zeros(1))
    np.testing.assert_allclose(slope, [[-0.7 / 0.03]], rtol=1e-13)
    still = DryFriction("x", "x").initialise_shape({"x": np.zeros(4)}, {}, 0.1)
    assert still.width == 1.0  # default for a speed that is always zero


def test_input_lag_adds_state():
    integrator = LinearModel(
        [[0.0]], [[1.0]], [[1.0]], [[0.0]], states=("x",), inputs=("u",), outputs=("x",)
    )
    model = Augmented(integrator, (InputLag("u", jnp.array(1.0), jnp.array(0.5)),))
    assert model.states == ("x", "lagged u")
    t = 0.1 * np.arange(40)
    actual = simulate(model, t, np.ones((40, 1)), np.zeros(2), stepper=RK4(4, unrolled=False)).x
    # (h/time)^4/120 with h = 0.025 s is 5e-8.
    np.testing.assert_allclose(actual[:, 1], 1 - np.exp(-2 * t), rtol=0, atol=1e-7)
    np.testing.assert_allclose(actual[:, 0], t - 0.5 * (1 - np.exp(-2 * t)), rtol=0, atol=1e-7)


@pytest.mark.parametrize("error", [InputBias, InputScale])
def test_lag_starts_in_equilibrium_if_record_has_bias_or_scale_error(error):
    integrator = LinearModel(
        [[0.0]], [[1.0]], [[1.0]], [[0.0]], states=("x",), inputs=("u",), outputs=("x",)
    )
    t, held = 0.1 * np.arange(40), np.full((40, 1), 0.5)
    made = record(t, held, np.zeros((40, 1)), inputs=("u",), outputs=("x",))

    def end(gain, *effects):
        model = Augmented(integrator, (error("u", gain), *effects))
        start = model.initial_state(made)
        return simulate(model, t, held, start, stepper=RK4(4, unrolled=False)).x[-1, 0]

    lag = InputLag("u", jnp.array(1.0), jnp.array(0.5))
    # The input is constant, so that no step has an error: value and derivative up to rounding.
    actual, want = (jax.value_and_grad(end)(jnp.array(0.3), *own) for own in ((lag,), ()))
    np.testing.assert_allclose(actual, want, rtol=1e-12)


def test_equation_without_free_parameter_is_not_uncertain():
    assert uncertain_equations(MODEL, np.array([0, 1])) == ("v",)
    assert uncertain_equations(MODEL, np.array([], int)) == ()
    assert general_effects(MODEL) == general_effects(MODEL, ("v",))
    terms = {effect.name for effect in general_effects(MODEL, ("v",))}
    assert "x^2 v in v" in terms
    assert not any(name.endswith(" in x") for name in terms)


def test_only_equation_of_free_polynomial_is_uncertain():
    class Two(AbstractModel):
        first: Polynomial
        second: Polynomial
        states, inputs, outputs = ("x", "v"), ("u",), ("x",)

        def rhs(self, t, x, u):
            signals = self.signals(t, x, u)
            return jnp.stack([self.first(signals), self.second(signals)])

        def output(self, t, x, u):
            return x[:1]

    model = Two(Polynomial({"v": 1.0}), Polynomial({"x": -1.0, "u": 2.0}))
    assert uncertain_equations(model, np.array([0])) == ("x",)
    assert uncertain_equations(model, np.array([2])) == ("v",)
    assert uncertain_equations(model, np.array([0, 1])) == ("x", "v")


def test_equation_with_dependence_far_from_zero_is_uncertain():
    class Heated(AbstractModel):
        loss: object
        states, inputs, outputs = ("T", "level"), ("heat",), ("T",)

        def rhs(self, t, x, u):
            return jnp.stack(
                [u[0] - self.loss * jnp.maximum(x[0] - 20.0, 0.0), -jnp.sqrt(x[1] - 0.5)]
            )

        def output(self, t, x, u):
            return x[:1]

    assert uncertain_equations(Heated(jnp.array(0.1)), np.array([0])) == ("T",)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_equation_with_dependence_on_one_side_of_zero_is_uncertain(sign):
    class Stop(AbstractModel):
        """A stop on one side; the equations of the levels are finite for positive levels only."""

        stiffness: object
        states, inputs, outputs = ("x", "v", "a", "b", "c"), ("u",), ("x",)

        def rhs(self, t, x, u):
            force = u[0] - self.stiffness * jnp.maximum(sign * x[0], 0.0)
            flow = jnp.sum(jnp.sqrt(x[2:]))
            return jnp.stack([x[1], force, -flow, flow, flow * x[0]])

        def output(self, t, x, u):
            return x[:1]

    assert uncertain_equations(Stop(jnp.array(2.0)), np.array([0])) == ("v",)


@pytest.fixture(scope="module")
def candidates():
    """The general effects of the declared model."""
    return general_effects(MODEL)


@pytest.mark.parametrize("name", NAMES)
def test_effect_in_model_is_not_a_candidate(effects, candidates, name):
    model = Augmented(MODEL, (effects[NAMES.index(name)],))
    offered = general_effects(model)
    assert name not in {one.name for one in offered}
    same = {one.name for one in candidates} - {one.name for one in offered}
    family = effects[NAMES.index(name)].card.family
    assert all(one.card.family == family for one in candidates if one.name in same)
    Augmented(model, offered)  # checks names, states and terms


@pytest.mark.parametrize("name", ONE_OF_EACH_CLASS)
def test_rates_with_effect_and_all_candidates_are_finite(effects, name):
    model = Augmented(MODEL, (effects[NAMES.index(name)],))
    both = Augmented(model, general_effects(model))
    rates = both.rhs(jnp.zeros(()), jnp.full(len(both.states), 0.5), jnp.ones(1))
    assert np.all(np.isfinite(rates))


def test_name_that_cannot_be_in_term_is_refused():
    spring = LinearModel(
        [[-1.0]], [[1.0]], [[1.0]], [[0.0]], states=("roll rate",), inputs=("u",), outputs=("y",)
    )
    with pytest.raises(InputError, match=r"'roll rate' cannot be used in a term.*'roll_rate'"):
        general_effects(spring)


def test_sensor_saturation_acts_after_scale():
    model = Augmented(
        MODEL,
        (
            SensorScale("y", jnp.array(0.2)),
            *(
                SensorSaturation("y", end, jnp.array(1.0), jnp.array(level))
                for end, level in (("upper", 0.5), ("lower", -0.5))
            ),
        ),
    )
    y = model.observe(jnp.arange(2.0), jnp.array([[-1.0], [1.0]]))
    np.testing.assert_allclose(y, [[-0.5], [0.5]], rtol=1e-15)


def test_band_limited_input_is_refused_on_uneven_samples():
    InputBetweenSamples("u").check(np.arange(5.0))
    with pytest.raises(InputError, match=r"u between samples.*uneven"):
        InputBetweenSamples("u").check(np.r_[0.0, 1.0, 3.0])


def test_candidates_have_unique_names_and_no_band_limited_input_if_uneven():
    even, uneven = (
        [effect.name for effect in general_effects(MODEL, ("x", "v"), uniform=uniform)]
        for uniform in (True, False)
    )
    assert sorted(set(even)) == even
    assert set(even) - set(uneven) == {"u between samples"}
