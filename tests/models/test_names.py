"""Dotted names of parameters, and the flat vector of their values."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.effects import Augmented, SensorBias, Term
from jaxid.models import AbstractModel, LinearModel, Polynomial, parameter_names, with_values
from jaxid.models.base import canonical
from jaxid.models.names import flatten, read_parameters


class Part(eqx.Module):
    gain: object
    table: object = None
    label: str = eqx.field(static=True, default="")


class Named(eqx.Module):
    value: object
    name: str = eqx.field(static=True)


class Wrapper(eqx.Module):
    inner: object
    outer: object

    transparent: ClassVar[tuple[str, ...]] = ("inner",)


class Clash(eqx.Module):
    first: Part
    second: Part

    transparent: ClassVar[tuple[str, ...]] = ("first", "second")


class Nested(AbstractModel):
    Cm: Polynomial
    part: Part
    pair: tuple
    table: dict
    last: object
    flag: bool = True
    nothing: None = None
    states, inputs, outputs = ("x",), ("u",), ("x",)

    def rhs(self, t, x, u):
        return self.last * x

    def output(self, t, x, u):
        return x


def nested():
    return Nested(
        Cm=Polynomial({"1": 1.0, "alpha": 2.0, "alpha^2 q": 3.0}),
        part=Part(4.0, jnp.array([[5.0, 6.0], [7.0, 8.0]]), "a label is not a parameter"),
        pair=(9.0, Part(10.0), Named(11.0, "brake")),
        table={"z": 13.0, "a": jnp.array([12.0])},
        last=jnp.array(14.0),
    )


NAMES = (
    "Cm.1",
    "Cm.alpha",
    "Cm.alpha^2 q",
    "part.gain",
    "part.table[0,0]",
    "part.table[0,1]",
    "part.table[1,0]",
    "part.table[1,1]",
    "pair.0",
    "pair.1.gain",
    "pair.brake.value",
    "table.a[0]",
    "table.z",
    "last",
)


def test_parameter_names_cover_nested_modules_and_containers():
    assert parameter_names(nested()) == NAMES


def test_parameter_names_have_order_of_flat_vector():
    vector, unflatten = flatten(canonical(nested()))
    np.testing.assert_array_equal(vector, np.arange(1.0, 15.0))
    assert eqx.tree_equal(unflatten(vector), canonical(nested()))
    moved = unflatten(vector + 100.0)
    np.testing.assert_array_equal(moved.part.table, [[105.0, 106.0], [107.0, 108.0]])
    np.testing.assert_array_equal(read_parameters(moved, ("last", "Cm.alpha")), [114.0, 102.0])


def test_transparent_field_is_left_out_of_name():
    assert parameter_names(Wrapper(Part(1.0), Part(2.0))) == ("gain", "outer.gain")


def test_parameters_with_same_name_are_refused():
    with pytest.raises(InputError, match="parameter name 'gain' occurs twice"):
        parameter_names(Clash(Part(1.0), Part(2.0)))


@pytest.mark.parametrize(
    "number", [2, 2.0, np.float32(2), np.float64(2), jnp.float32(2), jnp.asarray(2.0)]
)
def test_number_of_any_type_is_one_parameter_of_widest_type(number):
    model = canonical(Part(number, jnp.ones(2, jnp.float32)))
    assert parameter_names(Part(number, jnp.ones(2, jnp.float32))) == (
        "gain",
        "table[0]",
        "table[1]",
    )
    assert model.gain.dtype == jnp.float64
    assert not model.gain.weak_type
    assert model.table.dtype == jnp.float64
    np.testing.assert_array_equal(flatten(model)[0], [2.0, 1.0, 1.0])


def test_boolean_is_not_a_parameter():
    model = canonical(Part(True, 1.0))
    assert model.gain is True
    assert parameter_names(model) == ("table",)


def test_augmented_model_has_names_of_model_and_effects():
    model = LinearModel(
        [[1.0]], [[2.0]], [[3.0]], [[4.0]], states=("x",), inputs=("u",), outputs=("x",)
    )
    names = ("A[0,0]", "B[0,0]", "C[0,0]", "D[0,0]")
    assert parameter_names(model) == names
    wider = Augmented(model, (Term("x", "x^2"), SensorBias("x")))
    assert parameter_names(wider) == (*names, "bias of x.gain", "x^2 in x.gain")


def test_with_values_sets_each_value_at_its_name():
    changed_model = with_values(
        nested(), ("last", "part.table[1,0]", "Cm.alpha^2 q"), jnp.array([-1.0, -2.0, -3.0])
    )
    changed = {"last": -1.0, "part.table[1,0]": -2.0, "Cm.alpha^2 q": -3.0}
    want = [
        changed.get(name, value) for name, value in zip(NAMES, np.arange(1.0, 15.0), strict=True)
    ]
    np.testing.assert_array_equal(flatten(changed_model)[0], want)


def test_polynomial_has_value_of_its_named_terms():
    signals = {"alpha": jnp.array(0.3), "q": jnp.array(-2.0)}
    np.testing.assert_allclose(
        nested().Cm(signals), 1.0 + 2.0 * 0.3 + 3.0 * 0.09 * -2.0, rtol=1e-15
    )
    with pytest.raises(InputError, match="There is no signal 'q'"):
        nested().Cm({"alpha": jnp.array(0.3)})


def test_integer_arrays_are_parameters_and_are_converted():
    """`jnp.array(4)` for a parameter is the number 4; keys, flags and strings are no parameters."""
    part = Part(jnp.array(4), table=np.array([1, 2]))
    assert parameter_names(part) == ("gain", "table[0]", "table[1]")
    values, unflatten = flatten(canonical(part))
    np.testing.assert_array_equal(values, [4.0, 1.0, 2.0])
    assert values.dtype == float
    assert float(unflatten(values + 0.5).gain) == 4.5
    other = Part(jnp.array(True), table=jax.random.PRNGKey(0))
    assert parameter_names(other) == ()
    assert canonical(other).table.dtype == jnp.uint32
