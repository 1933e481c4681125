"""`Augmented`: order of effects, names, extra states, outputs that depend on state derivatives."""

import itertools

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
    Effect,
    InputLag,
    SensorBias,
    SensorScale,
    Term,
    general_effects,
)
from jaxid.models import AbstractModel, LinearModel, parameter_names
from jaxid.models.free import with_values
from jaxid.simulation import simulate


class Cart(AbstractModel):
    """A cart with an accelerometer."""

    k: object
    states, inputs, outputs = ("x", "v"), ("u",), ("x", "a")

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0]])

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))

    def output_given(self, t, x, u, dx):
        return jnp.stack([x[0], dx[1]])


CART = Cart(jnp.array(3.0))
T = 0.1 * np.arange(20)
U = np.cos(2.0 * T)[:, None]
EFFECTS = (
    Term("v", "x^2 v", jnp.array(-0.4)),
    SensorScale("x", jnp.array(0.2)),
    SensorBias("x", jnp.array(0.5)),
    InputLag("u", jnp.array(0.6), jnp.array(0.3)),
)


def test_augmented_is_independent_of_order_of_effects():
    first = Augmented(CART, EFFECTS)
    want = simulate(first, T, U, np.array([0.5, 0.0, 0.0]))
    for order in itertools.islice(itertools.permutations(EFFECTS), 1, None, 5):
        other = Augmented(CART, order)
        assert jax.tree.structure(other) == jax.tree.structure(first)
        assert eqx.tree_equal(other, first)
    np.testing.assert_array_equal(
        simulate(Augmented(CART, EFFECTS[::-1]), T, U, np.array([0.5, 0.0, 0.0])).y, want.y
    )


def test_parameter_names_are_model_names_and_effect_names():
    assert parameter_names(Augmented(CART, EFFECTS)) == (
        "k",
        "bias of x.gain",
        "lag of input u.gain",
        "lag of input u.time",
        "scale of x.gain",
        "x^2 v in v.gain",
    )
    assert parameter_names(Augmented(CART, ())) == ("k",)


def test_augmented_without_effects_equals_model():
    plain, wrapped = (
        simulate(CART, T, U, np.array([0.5, 0.0])),
        simulate(Augmented(CART, ()), T, U, np.array([0.5, 0.0])),
    )
    # two programs: their fused operations may round differently
    np.testing.assert_allclose(wrapped.y, plain.y, rtol=0, atol=T.size * np.finfo(float).eps)


def test_terms_add_their_products_to_equations():
    effects = (
        Term("v", "x^2 v", jnp.array(-0.4)),
        Term("x", "1", jnp.array(0.1)),
        DryFriction("v", "v", jnp.array(2.0)),
    )
    actual = Augmented(CART, effects).rhs(jnp.zeros(()), jnp.array([0.5, 0.8]), jnp.array([0.3]))
    want = [0.8 + 0.1, 0.3 - 3.0 * 0.5 - 0.4 * 0.25 * 0.8 + 2.0 * np.tanh(0.8)]
    np.testing.assert_allclose(actual, want, rtol=1e-14)


def test_accelerometer_includes_terms_of_effects():
    model = Augmented(CART, (Term("v", "1", jnp.array(7.0)),))
    x, u = jnp.array([0.5, 0.8]), jnp.array([0.3])
    plain = CART.output(jnp.zeros(()), x, u)
    np.testing.assert_allclose(
        model.output(jnp.zeros(()), x, u) - plain, [0.0, 7.0], rtol=1e-14, atol=1e-15
    )


def test_nested_augmented_equals_flat_augmented():
    inner = Augmented(CART, (EFFECTS[0], EFFECTS[3]))
    # The bias acts before the scale in both cases: outer effects act after inner effects.
    nested, flat = Augmented(inner, EFFECTS[1:3]), Augmented(CART, EFFECTS)
    assert nested.states == flat.states == ("x", "v", "lagged u")
    assert set(parameter_names(nested)) == set(parameter_names(flat))
    start = np.array([0.5, 0.0, 0.0])
    actual, want = simulate(nested, T, U, start), simulate(flat, T, U, start)
    np.testing.assert_allclose(actual.x, want.x, rtol=0, atol=1e-14)
    np.testing.assert_allclose(actual.y, want.y, rtol=0, atol=1e-14)
    assert np.abs(want.y - simulate(CART, T, U, start[:2]).y).max() > 0.1


def test_inner_sensor_effect_acts_before_outer():
    nested = Augmented(
        Augmented(CART, (SensorScale("x", jnp.array(1.0)),)), (SensorBias("x", jnp.array(0.5)),)
    )
    plain = simulate(CART, T, U, np.array([0.5, 0.0])).y
    want = np.stack([2.0 * plain[:, 0] + 0.5, plain[:, 1]], axis=1)
    np.testing.assert_allclose(simulate(nested, T, U, np.array([0.5, 0.0])).y, want, rtol=1e-14)


class Doubled(Cart):
    def observe(self, t, y):
        return 2.0 * y


def test_observation_of_model_acts_before_sensor_effects():
    start = np.array([0.5, 0.0])
    actual = simulate(Augmented(Doubled(CART.k), (SensorBias("x", jnp.array(0.5)),)), T, U, start).y
    np.testing.assert_allclose(
        actual, 2.0 * simulate(CART, T, U, start).y + np.array([[0.5, 0.0]]), rtol=1e-13
    )


def test_extra_states_follow_model_states_and_start_in_equilibrium():
    data = record(T, 0.7 + U, np.stack([0.3 + T, 0 * T], axis=1), inputs=("u",), outputs=("x", "a"))
    np.testing.assert_array_equal(Augmented(CART, EFFECTS).initial_state(data), [0.3, 0.0, 1.7])


def test_duplicate_names_are_refused():
    with pytest.raises(InputError, match="effect name 'bias of x' occurs twice"):
        Augmented(CART, (SensorBias("x"), SensorBias("x", jnp.array(1.0))))
    clash = LinearModel(
        [[0.0]], [[0.0]], [[1.0]], [[0.0]], states=("lagged u",), inputs=("u",), outputs=("y",)
    )
    with pytest.raises(InputError, match="state name 'lagged u' occurs twice"):
        Augmented(clash, (InputLag("u"),))


def test_term_in_unknown_signal_is_refused():
    with pytest.raises(InputError, match="There is no signal 'w'"):
        Augmented(CART, (Term("v", "w^2"),)).rhs(jnp.zeros(()), jnp.zeros(2), jnp.zeros(1))


def test_nested_effect_with_duplicate_name_is_refused_by_parameter_names():
    twice = Augmented(Augmented(CART, (SensorBias("x"),)), (SensorBias("x"),))
    with pytest.raises(InputError, match=r"parameter name 'bias of x\.gain' occurs twice"):
        parameter_names(twice)


LIBRARY = general_effects(CART, equations=("v",))


def _flown(model: Augmented, effects: tuple[Effect, ...]):
    """Return the outputs of a flight, and their sensitivities to the gains of `effects`."""
    names = [f"{effect.name}.gain" for effect in effects]

    def outputs(gains):
        start = jnp.concatenate([jnp.array([0.5, 0.0]), jnp.zeros(len(model.states) - 2)])
        return simulate(with_values(model, names, gains), T, U, start).y

    gains = jnp.linspace(0.1, 0.2, len(effects))
    return outputs(gains), jax.jacfwd(outputs)(gains)


@pytest.mark.parametrize("first", range(0, len(LIBRARY), 8))
def test_skipping_absent_effects_changes_nothing(first):
    """The groups in which a program skips effects do not follow the choice of effects."""
    chosen = LIBRARY[first : first + 8 : 2]
    skipping = Augmented(CART, LIBRARY).with_present([effect.name for effect in chosen])
    alone, both = _flown(Augmented(CART, chosen), chosen), _flown(skipping, chosen)
    for want, got in zip(alone, both, strict=True):
        assert np.any(np.asarray(want))
        np.testing.assert_allclose(got, want, rtol=1e-11, atol=1e-13)


def test_skipped_effects_are_not_evaluated():
    """A gain of a skipped effect has no influence."""
    biased = Augmented(CART, (SensorBias("x", jnp.array(0.5)), Term("v", "x^2", jnp.array(0.3))))
    start = np.array([0.5, 0.0])
    declared = simulate(Augmented(CART, ()), T, U, start).y
    np.testing.assert_array_equal(simulate(biased.with_present(()), T, U, start).y, declared)
    assert np.any(simulate(biased, T, U, start).y != declared)
    with pytest.raises(InputError, match="bias of x"):
        biased.with_present(["bias of y"])
