"""Models whose `rhs` or `output` does not fit their channels are refused at every entry."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import close_loop
from jaxid._foundation.checks import InputError
from jaxid.data import record
from jaxid.diagnosis import predict
from jaxid.estimation import OutputError, estimate
from jaxid.models import AbstractModel, LinearModel, free
from jaxid.models.equation_shapes import check_equations
from jaxid.simulation import linearise, simulate


class Oscillator(AbstractModel):
    """A linear oscillator; the classes below spoil one of its methods."""

    k: object = 4.0
    states, inputs, outputs = ("x", "v"), ("u",), ("p", "q")

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0]])

    def output(self, t, x, u):
        return x


def with_rhs(function):
    return type("Wrong", (Oscillator,), {"rhs": lambda self, t, x, u: function(x, u)})()


def with_output(function):
    return type("Wrong", (Oscillator,), {"output": lambda self, t, x, u: function(x, u)})()


def branch(x, u):
    return x if x[0] > 0 else -x


def indexed(x, u):
    return jnp.stack([x[0], [1.0, 2.0][x[1].astype(int)]])


def unpacked(x, u):
    angle, rate, _ = x
    return jnp.stack([rate, -angle])


WRONG = {
    "too few": (lambda x, u: x[:1], r"returns shape \(1,\), but the model names 2 .*jnp\.stack"),
    "too many": (lambda x, u: jnp.append(x, u), r"returns shape \(3,\), but .* 2 .*jnp\.stack"),
    "a column": (lambda x, u: x[:, None], r"returns shape \(2, 1\), but the model names 2"),
    "a scalar": (
        lambda x, u: x[0],
        r"returns a single number, of shape \(\), but .* 2 .*jnp\.stack",
    ),
    "a Python number": (lambda x, u: 0.0, r"returns a float, not an array.*jnp\.stack"),
    "a list": (lambda x, u: [x[0], x[1]], r"returns a list, not an array.*jnp\.stack"),
    "a tuple": (lambda x, u: (x[0], x[1]), r"returns a tuple, not an array.*jnp\.stack"),
    "nothing": (lambda x, u: None, r"returns a NoneType, not an array"),
    "integers": (lambda x, u: jnp.zeros(2, int), r"returns int64 numbers"),
    "a NumPy function": (lambda x, u: np.sin(x), r"NumPy.*jax\.numpy"),
    "a NumPy array": (lambda x, u: np.array([x[0], x[1]]), r"NumPy.*jax\.numpy"),
    "a branch": (branch, r"Python branch.*jnp\.where"),
    "a Python minimum": (lambda x, u: x * min(x[0], x[1]), r"Python branch.*jnp\.minimum"),
    "a math function": (lambda x, u: x * math.sin(x[0]), r"Python number.*jnp\.sin"),
    "an index": (indexed, r"Python number.*jnp\.take"),
    "another unpacking": (unpacked, r"fails for a state of shape \(2,\) .*unpack"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_method_is_refused_by_name_with_remedy(wrong):
    function, words = WRONG[wrong]
    with pytest.raises(InputError, match=rf"(?s)`rhs` of Wrong .*{words}"):
        check_equations(with_rhs(function))
    with pytest.raises(InputError, match=rf"(?s)`output` of Wrong .*{words}"):
        check_equations(with_output(function))


T = 0.1 * np.arange(40)
U = np.sin(T)[:, None]


def data():
    z = np.stack([np.sin(T), np.cos(T)], axis=1)
    return record(T, U, z, inputs=("u",), outputs=("p", "q"))


ENTRIES = {
    "simulate": lambda model: simulate(model, T, U, np.zeros(2)),
    "linearise": lambda model: linearise(model, 0.0, np.zeros(2), np.zeros(1)),
    "estimate": lambda model: estimate(model, free(model, "k"), data(), OutputError()),
    "predict": lambda model: predict(model, data(), OutputError()),
    "close_loop": lambda model: close_loop(model, free(model, "k"), OutputError(), train=data()),
}


@pytest.mark.parametrize("entry", ENTRIES)
def test_every_entry_refuses_output_of_one_value_for_two_names(entry):
    """The one value would be broadcast to both outputs, and a fit would be wrong."""
    words = r"`output` of Wrong returns shape \(1,\), but the model names 2 outputs: p, q"
    with pytest.raises(InputError, match=words):
        ENTRIES[entry](with_output(lambda x, u: x[:1]))


@pytest.mark.parametrize("entry", ENTRIES)
def test_every_entry_refuses_rhs_that_returns_a_list(entry):
    with pytest.raises(InputError, match=r"`rhs` of Wrong returns a list"):
        ENTRIES[entry](with_rhs(lambda x, u: [x[1], -x[0]]))


def test_output_given_rates_is_checked():
    class Accelerometer(Oscillator):
        def output_given(self, t, x, u, dx):
            return dx[1:]

    with pytest.raises(InputError, match=r"`output_given` of Accelerometer returns shape \(1,\)"):
        check_equations(Accelerometer())


def test_refusal_of_the_model_itself_passes():
    def refuse(x, u):
        raise InputError("alpha is beyond its table")

    with pytest.raises(InputError, match=r"^alpha is beyond its table"):
        check_equations(with_rhs(refuse))


def test_one_structure_is_traced_once_whatever_its_numbers():
    count = []

    class Counted(Oscillator):
        def rhs(self, t, x, u):
            count.append(1)
            return super().rhs(t, x, u)

    for k in (1.0, 2, np.float32(3.0), jnp.array(4.0), jnp.asarray(5.0) * 1.0):
        check_equations(Counted(k))
    jax.vmap(lambda k: check_equations(Counted(k)) or k)(jnp.arange(3.0))
    assert len(count) == 1


class Measured(Oscillator):
    """An oscillator with outputs that are states, in another order, without a method for them."""

    outputs = ("v", "x")
    output = AbstractModel.output


def test_outputs_that_are_states_need_no_method():
    t = 0.1 * np.arange(20)
    y = simulate(Measured(), t, np.sin(t)[:, None], np.ones(2)).y
    x = simulate(Oscillator(), t, np.sin(t)[:, None], np.ones(2)).x
    np.testing.assert_array_equal(y, x[:, ::-1])


def test_other_outputs_without_a_method_are_refused_by_name():
    class Accelerometer(Measured):
        outputs = ("x", "acceleration")

    with pytest.raises(InputError, match=r"no method `output`.*no states: acceleration\. Write"):
        check_equations(Accelerometer())


def test_right_models_pass():
    check_equations(Oscillator())
    static = {"states": (), "inputs": ("u",), "outputs": ("y",)}
    matrices = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.eye(1)
    check_equations(LinearModel(*matrices, **static))
    assert bool(jax.jit(lambda k: simulate(Oscillator(k), T, U, np.zeros(2)).finite)(4.0))
