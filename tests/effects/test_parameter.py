"""Effects on parameters of the declared model: absence at zero, sensitivities, behaviour."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.data import record
from jaxid.effects import Augmented
from jaxid.effects.parameter import (
    ParameterDrift,
    ParameterShift,
    ParameterStep,
    not_free,
    parameter_effects,
    with_parameter_offsets,
)
from jaxid.models import AbstractModel, free, with_values
from jaxid.models.names import read_parameters
from jaxid.simulation import RK4, simulate
from jaxid.study.candidates import candidates


class Spring(AbstractModel):
    """A spring with two dampers and a scale of its sensor."""

    k: object
    c: object
    scale: object
    states, inputs, outputs = ("x", "v"), ("u",), ("y",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c[0] * x[1] - self.c[1] * x[1] ** 3])

    def output(self, t, x, u):
        return self.scale * x[:1]

    def units(self):
        return {"k": "1/s^2"}


MODEL = Spring(jnp.array(4.0), jnp.array([0.4, 0.05]), jnp.array(1.5))
T = 0.1 * jnp.arange(60)
U = (jnp.sin(1.3 * T + 0.5) + 0.5 * jnp.cos(4.0 * T))[:, None]
START = jnp.array([0.7, 0.9])
SIGNALS = {"t": np.concatenate([np.asarray(T), np.asarray(T)])}
PARAMETERS = ("k", "c[1]", "scale")
EFFECTS = tuple(
    one.initialise_shape(SIGNALS, {}, 0.1)
    for one in parameter_effects(MODEL, PARAMETERS, moments=(0.3,))
)


def answer(model):
    return simulate(model, T, U, START, stepper=RK4(2, unrolled=False)).y[:, 0]


@pytest.fixture(scope="module")
def outcome():
    """Function from a vector of gains, in the order of the effects' names, to the outputs."""
    model = Augmented(MODEL, EFFECTS)

    @jax.jit
    def y(gains):
        return answer(eqx.tree_at(lambda m: [e.gain for e in m.effects_in], model, list(gains)))

    return y


def gain_of(kind, parameter, value):
    """Return a vector of gains with a single nonzero gain."""
    names = [(type(one), one.parameter) for one in Augmented(MODEL, EFFECTS).effects_in]
    return jnp.zeros(len(names)).at[names.index((kind, parameter))].set(value)


def test_equations_at_gain_zero_equal_those_of_the_model_to_the_last_bit():
    """Operation by operation: XLA rounds fused operations as it compiles them."""
    model = Augmented(MODEL, EFFECTS)
    for t, u in zip(T[::7], U[::7], strict=True):
        np.testing.assert_array_equal(model.rhs(t, START, u)[:2], MODEL.rhs(t, START, u))
        np.testing.assert_array_equal(model.output(t, START, u), MODEL.output(t, START, u))


def test_parameter_effects_are_absent_at_gain_zero(outcome):
    """Two programs with the same equations differ by the rounding of 60 samples of size one."""
    np.testing.assert_allclose(
        outcome(jnp.zeros(len(EFFECTS))), answer(MODEL), rtol=0, atol=60 * np.finfo(float).eps
    )


@pytest.mark.parametrize("parameter", PARAMETERS)
def test_shift_equals_other_value_of_parameter(outcome, parameter):
    other = with_values(MODEL, (parameter,), read_parameters(MODEL, (parameter,)) + 0.2)
    np.testing.assert_allclose(
        outcome(gain_of(ParameterShift, parameter, 0.2)), answer(other), rtol=0, atol=1e-13
    )


def test_sensitivities_at_gain_zero_equal_finite_differences(outcome):
    """Error of central differences: rounding of 1e-16/1e-5, and third derivative times 1e-10."""
    S, d = jax.jacfwd(outcome)(jnp.zeros(len(EFFECTS))), 1e-5
    for column, unit in enumerate(d * jnp.eye(len(EFFECTS))):
        difference = (outcome(unit) - outcome(-unit)) / (2 * d)
        scale = np.abs(S[:, column]).max()
        assert scale > 1e-3
        np.testing.assert_allclose(S[:, column], difference, rtol=0, atol=1e-8 * max(scale, 1.0))


class Integrator(AbstractModel):
    """The integral of a parameter; the outputs are the integral and the parameter."""

    rate: object
    states, inputs, outputs = ("x",), ("u",), ("x", "rate")

    def rhs(self, t, x, u):
        return self.rate[None]

    def output(self, t, x, u):
        return jnp.stack([x[0], self.rate])


def integrated(effect):
    t = 0.05 * jnp.arange(201)
    effect = eqx.tree_at(
        lambda e: e.gain, effect.initialise_shape({"t": np.asarray(t)}, {}, 0.05), jnp.array(-2.0)
    )
    y = simulate(
        Augmented(Integrator(jnp.array(3.0)), (effect,)), t, jnp.zeros((201, 1)), jnp.zeros(1)
    ).y
    return np.asarray(t), np.asarray(y)


def test_drift_is_ramp_about_middle_of_records():
    t, y = integrated(ParameterDrift("rate"))
    np.testing.assert_allclose(y[:, 1], 3.0 - 2.0 * (t - 5.0) / 10.0, rtol=1e-14)
    # The Runge-Kutta method integrates a polynomial of first degree exactly.
    np.testing.assert_allclose(y[:, 0], 3.0 * t - 0.1 * (t**2 - 10.0 * t), rtol=0, atol=1e-12)


def test_drift_from_start_is_absent_at_first_training_time():
    t, y = integrated(ParameterDrift("rate", from_start=True))
    np.testing.assert_allclose(y[:, 1], 3.0 - 2.0 * t / 10.0, rtol=1e-14)


def test_drift_from_start_continues_over_records_of_one_clock():
    t = np.r_[np.linspace(2.0, 4.0, 21), np.linspace(7.0, 10.0, 31)]
    drift = ParameterDrift("k", from_start=True).initialise_shape({"t": t}, {}, 0.1)
    assert [float(drift.origin), float(drift.span)] == [2.0, 8.0]
    drift = eqx.tree_at(lambda e: e.gain, drift, jnp.array(-2.0))
    offsets = [float(drift.parameter_offsets(time)["k"]) for time in (2.0, 7.0, 10.0)]
    np.testing.assert_allclose(offsets, [0.0, -1.25, -2.0], rtol=1e-15)


def test_step_is_sigmoid_at_its_time():
    t, y = integrated(ParameterStep("rate", 0.4))
    z = (t - 4.0) / 0.05
    np.testing.assert_allclose(y[:, 1], 3.0 - 2.0 / (1.0 + np.exp(-z)), rtol=1e-12)
    # The Runge-Kutta method is Simpson's rule here, with steps of one width. Its error is h^4/2880
    # of the sigmoid's largest fourth derivative, width^-4/8, over the few steps in which it is not
    # zero, times the gain.
    integral = 3.0 * t - 2.0 * 0.05 * (np.logaddexp(0.0, z) - np.logaddexp(0.0, z[0]))
    np.testing.assert_allclose(y[:, 0], integral, rtol=0, atol=2.0 * 6 * 0.05 / 8 / 2880)


def test_initial_times_lie_within_records():
    """Initial times are quantiles of the samples, because two flights can be hours apart."""
    t = np.r_[np.linspace(0.0, 20.0, 401), 1000.0 + np.linspace(0.0, 20.0, 401)]
    times = [
        float(ParameterStep("k", fraction).initialise_shape({"t": t}, {}, 0.05).time)
        for fraction in (0.2, 0.4, 0.6, 0.8)
    ]
    # tolerance of one sample interval
    np.testing.assert_allclose(times, [8.0, 16.0, 1004.0, 1012.0], rtol=0, atol=0.05)
    assert float(ParameterStep("k").initialise_shape({"t": t}, {}, 0.1).width) == 0.1
    drift = ParameterDrift("k").initialise_shape({"t": np.array([2.0, 10.0])}, {}, 0.1)
    assert [float(drift.origin), float(drift.span)] == [6.0, 8.0]


def test_shift_moves_further_parameters():
    effect = ParameterShift("c[0]", (("c[1]", -2.0), ("k", 0.5)), gain=jnp.array(0.1))
    np.testing.assert_allclose(
        Augmented(MODEL, (effect,)).rhs(T[0], START, U[0]),
        Spring(jnp.array(4.05), jnp.array([0.5, -0.15]), jnp.array(1.5)).rhs(T[0], START, U[0]),
        rtol=1e-14,
    )


def test_effects_on_same_parameter_add():
    two = (
        ParameterShift("k", gain=jnp.array(0.3)),
        ParameterShift("c[0]", (("k", 1.0),), gain=jnp.array(0.2)),
    )
    other = with_values(MODEL, ("k", "c[0]"), jnp.array([4.5, 0.6]))
    np.testing.assert_allclose(
        Augmented(MODEL, two).rhs(T[0], START, U[0]), other.rhs(T[0], START, U[0]), rtol=1e-14
    )


def test_parameter_effects_have_names_descriptions_and_units():
    names = [effect.name for effect in EFFECTS]
    assert len(set(names)) == len(names)
    first = parameter_effects(MODEL, ("k",), moments=(0.2, 0.6))
    assert [one.card.description for one in first] == [
        "k differs from its declared value",
        "k drifts with time from its declared value on",
        *["k changes suddenly"] * 2,
    ]
    assert {str(one.card.location) for one in first} == {"parameter k"}
    assert len({one.card.family for one in first}) == 3
    assert Augmented(MODEL, first).units()["shift of k.gain"] == "1/s^2"


def test_shift_of_free_parameter_is_not_a_candidate():
    left = not_free(EFFECTS, ("k", "initial_state.x"))
    removed = {one.name for one in EFFECTS} - {one.name for one in left}
    assert removed == {"shift of k", "drift of k from its declared value"}
    assert {one.name for one in left} - {one.name for one in EFFECTS} == {"drift of k"}


def test_drift_of_free_parameter_is_about_middle_of_records():
    """A drift that moves further parameters as well begins at the declared values."""
    linked = ParameterDrift("k", (("c[0]", 1.0),), from_start=True)
    alone, both = not_free((ParameterDrift("k", unit="1/s^2", from_start=True), linked), ("k",))
    assert alone == ParameterDrift("k", unit="1/s^2")
    assert both is linked


class Burning(Spring):
    """A spring whose model supplies a drift from the declared stiffness."""

    def effects(self):
        return (ParameterDrift("k", unit="1/s^2", from_start=True),)


@pytest.mark.parametrize(
    ("parameter", "drifts"),
    [
        ("k", {"drift of k"}),
        ("scale", {"drift of k from its declared value", "drift of scale"}),
    ],
)
def test_study_tries_one_drift_of_each_parameter(parameter, drifts):
    model = Burning(MODEL.k, MODEL.c, MODEL.scale)
    flown = record(T, U, np.zeros((T.size, 1)), inputs=("u",), outputs=("y",))
    offered = candidates(model, free(model, parameter), flown)
    assert {one.name for one in offered if isinstance(one, ParameterDrift)} == drifts


def test_unknown_parameter_is_refused():
    with pytest.raises(InputError, match="'m'"):
        with_parameter_offsets(MODEL, {"m": jnp.array(1.0)})
    with pytest.raises(InputError, match="'m'"):
        parameter_effects(MODEL, ("m",))
