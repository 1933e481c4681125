"""Differences of signals: dependence of a declared model on them, and effects that use them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import AbstractModel, free
from jaxid.effects import Augmented, DeadBand, DryFriction, QuadraticDrag, Term, general_effects
from jaxid.effects.library import initialise_shapes
from jaxid.effects.placement import Placement
from jaxid.models.signal_dependence import absent_signals, differences, with_differences
from jaxid.study.candidates import candidates

X = jnp.array([0.7, -0.2, 0.1, 0.5])  # x1, v1, x2, v2
U = jnp.array([0.3])
T = jnp.array(0.0)


class TwoMasses(AbstractModel):
    """Two masses with a spring and a damper between them; another spring holds the first mass."""

    k: jax.Array
    c: jax.Array
    ground: jax.Array
    states, inputs, outputs = ("x1", "v1", "x2", "v2"), ("force",), ("x1", "x2")

    def rhs(self, t, x, u):
        between = self.k * (x[0] - x[2]) + self.c * (x[1] - x[3])
        return jnp.stack([x[1], u[0] - between - self.ground * x[0], x[3], between])

    def output(self, t, x, u):
        return x[::2]


class House(AbstractModel):
    """A temperature with heat loss to the outside, and a heater."""

    loss: jax.Array
    heat: jax.Array
    states, inputs, outputs = ("T",), ("heater", "outside"), ("T",)

    def rhs(self, t, x, u):
        return -self.loss * (x - u[1]) + self.heat * u[0]

    def output(self, t, x, u):
        return x


MASSES = TwoMasses(jnp.array(1.0), jnp.array(1.0), jnp.array(0.5))


def test_difference_of_opposite_slopes_holds_in_all_equations_with_both_signals():
    result = differences(MASSES, ("v1", "v2"))
    # Another spring acts on the first mass, so that only the equation of the second mass shows that
    # x1 and x2 are a difference.
    assert result == {"x1-x2": ("v1", "v2"), "v1-v2": ("v1", "v2")}
    assert differences(House(jnp.array(1.0), jnp.array(1.0)), ("T",)) == {"T-outside": ("T",)}


def test_slopes_opposite_by_accident_are_not_a_difference():
    # With loss and heat one, the slopes in the temperature and the heater are -1 and 1; with other
    # values they are not.
    assert "T-heater" not in differences(House(jnp.array(1.0), jnp.array(1.0)), ("T",))
    assert differences(MASSES, ()) == {}


def test_signals_gain_requested_differences_only():
    signals = {"x1": jnp.array(3.0), "x2": jnp.array(1.0), "a-b": jnp.array(7.0)}
    extended = with_differences(signals, ("x1-x2", "a-b", "x1", "x1-unknown"))
    assert set(extended) == {*signals, "x1-x2"}
    assert float(extended["x1-x2"]) == 2.0
    assert float(extended["a-b"]) == 7.0


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        (Term("v2", "(x1-x2)^3"), 0.6**3),
        (Term("v2", "x1 (v1-v2)^2"), 0.7 * 0.7**2),
        (QuadraticDrag("v2", "v1-v2"), -(0.7**2)),
        (DryFriction("v2", "v1-v2"), np.tanh(-0.7 / 0.01)),
        (DeadBand(Placement.equation("v2"), "x1-x2"), 0.6 - 0.4 * 1.0),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_effect_of_difference_adds_known_rate(effect, expected):
    samples = {
        "x1": np.array([-1.0, 0.5, 1.0]),
        "x2": np.zeros(3),
        "v1": np.zeros(3),
        "v2": np.array([1.0, -0.5, -1.0]),
    }
    (effect,) = initialise_shapes((effect,), samples | {"t": np.arange(3.0)}, {}, 1.0)
    unit_effect = eqx.tree_at(lambda effect: effect.gain, effect, jnp.ones(()))
    added = Augmented(MASSES, (unit_effect,)).rhs(T, X, U) - MASSES.rhs(T, X, U)
    np.testing.assert_allclose(added, [0.0, 0.0, 0.0, expected], rtol=1e-12, atol=1e-15)
    assert "x1-x2" in Augmented(MASSES, (Term("v1", "(x1-x2)^2"),)).signals(T, X, U)


def test_equation_lacks_linear_term_of_absent_signal():
    unknown = absent_signals(MASSES, ("v1", "v2"))
    assert unknown == {"v1": (), "v2": ("force",)}
    names = {effect.name for effect in general_effects(MASSES, ("v1", "v2"))}
    assert "force in v2" in names
    # Terms of the declared model are not candidates, free or not.
    assert not {"x1 in v1", "v1 in v1", "x2 in v2", "v1 in v2"} & names
    assert absent_signals(MASSES, ()) == {}


def test_free_parameter_that_begins_at_zero_is_in_its_equation():
    loose = TwoMasses(jnp.array(0.0), jnp.array(0.0), jnp.array(0.5))
    assert absent_signals(loose, ("v2",)) == {"v2": ("x1", "v1", "x2", "v2", "force")}
    assert absent_signals(loose, ("v2",), ("k",)) == {"v2": ("v1", "v2", "force")}
    assert differences(loose, ("v2",)) == {}
    assert differences(loose, ("v2",), ("k",)) == {"x1-x2": ("v2",)}
    names = {effect.name for effect in candidates(loose, free(loose, "k", "c"))}
    assert {"(x1-x2)^3 in v2", "|v1-v2|v1-v2 in v2", "force in v2"} <= names
    assert not {"x1 in v2", "v2 in v2"} & names


def test_library_has_interaction_effects_of_two_parts():
    names = {effect.name for effect in general_effects(MASSES, ("v1", "v2"))}
    for state in ("v1", "v2"):
        assert {
            f"(x1-x2)^3 in {state}",
            f"|v1-v2|v1-v2 in {state}",
            f"dead band of x1-x2 in {state}",
        } <= names
        assert {f"(x1-x2)^2 in {state}", f"sign(v1-v2) in {state}"} <= names
    assert not any("-" in effect.name for effect in general_effects(MASSES, ()))
