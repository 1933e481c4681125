"""Digest of the user's code: it differs with every change of the equations, and with no other."""

import os
import subprocess
import sys
import types

import equinox as eqx
import jax.numpy as jnp
import pytest

from jaxid.batches.identity import digest_of_code

SOURCE = """
import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import jaxid

GRAVITY = 9.81
TABLE = np.arange(3.0)
UNUSED = 1.0


class Air(NamedTuple):
    density: float


def drag(v):
    return 0.5 * v * v


@jax.custom_jvp
def root(x):
    return jnp.sqrt(x)


@root.defjvp
def root_slope(x, dx):
    return root(x[0]), dx[0] / 2.0


class Spring(eqx.Module):
    k: jax.Array

    def force(self, x):
        return self.k * x


def made(order):
    class Mass(jaxid.AbstractModel):
        spring: Spring
        shape: object = eqx.field(static=True, default=jnp.tanh)
        states, inputs, outputs = ("x",), ("u",), ("x",)
        mass = 2.0

        def rhs(self, t, x, u):
            # the equation
            force = jax.lax.cond(t > 0, lambda: GRAVITY * drag(x[0]), lambda: 0.0)
            force = force + order * root(u[0]) + TABLE[1] + Air(1.2).density + self.weight
            return jnp.stack([self.spring.force(x[0]) - force])

        @functools.partial(jax.jit)
        def output(self, t, x, u):
            return x + helpers.offset(t)

        @property
        def weight(self):
            return self.mass if self.states[0] in {"x", "y", "z"} else 0.0

    return Mass


model = made(2)(Spring(jnp.array(1.0)))
"""
HELPERS = "def offset(t):\n    return 0.1"
PRINTED = """
import sys
from jaxid.batches.identity import digest_of_code
from test_user_code import model
print(digest_of_code(model()))
"""


def model(old="", new="", module="springs"):
    """Return the model of the source after a replacement."""
    helpers, springs = types.ModuleType("helpers"), types.ModuleType(module)
    exec(HELPERS.replace(old, new) if old else HELPERS, vars(helpers))
    vars(springs)["helpers"] = helpers
    file = f"/somewhere/{module}.py"
    exec(compile(SOURCE.replace(old, new) if old else SOURCE, file, "exec"), vars(springs))
    return springs.model


@pytest.fixture(scope="module")
def digest():
    return digest_of_code(model())


@pytest.mark.parametrize(
    ("part", "old", "new"),
    [
        ("method", "(x[0]) - force", "(x[0]) + force"),
        ("constant of a module", "9.81", "9.80"),
        ("array of a module", "arange(3.0)", "arange(4.0)"),
        ("function of a module", "0.5 * v", "0.6 * v"),
        ("function of another module", "return 0.1", "return 0.2"),
        ("class of a module", "density: float", "density: float\n    speed: float = 0.0"),
        ("derivative of its own", "/ 2.0", "/ 3.0"),
        ("model inside the model", "self.k * x", "self.k + x"),
        ("value of a factory", "made(2)", "made(3)"),
        ("static function", "jnp.tanh", "jnp.sin"),
        ("attribute of the class", "mass = 2.0", "mass = 3.0"),
        ("decorated method", "return x + helpers", "return x - helpers"),
        ("property", "else 0.0", "else 1.0"),
    ],
)
def test_digest_differs_with_another(part, old, new, digest):
    assert old in SOURCE + HELPERS
    assert digest_of_code(model(old, new)) != digest


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("# the equation", "# the equation,\n            # in newtons"),
        ("array(1.0)", "array(3.0)"),
        ("UNUSED = 1.0", "UNUSED = 2.0\n\n"),
    ],
)
def test_digest_is_equal_with_other_comments_and_values(old, new, digest):
    """Values of the model are data."""
    assert digest_of_code(model(old, new)) == digest


def test_digest_is_equal_in_another_module_and_after_use(digest):
    used = model(module="__main__")
    used.rhs(0.0, jnp.ones(1), jnp.ones(1))
    used.output(0.0, jnp.ones(1), jnp.ones(1))
    assert digest_of_code([used]) == digest_of_code([model()])
    assert digest_of_code(used) == digest


def test_digest_is_equal_in_another_process(digest):
    """Sets have another order in it."""
    folder = os.path.dirname(__file__)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([folder, *sys.path])}
    environment["PYTHONHASHSEED"] = "7"
    command = [sys.executable, "-c", PRINTED]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert run.stdout.split() == [digest]


def test_functions_that_call_each_other_have_a_digest():
    def even(n):
        return n == 0 or odd(n - 1)

    def odd(n):
        return n > 0 and even(n - 1)

    class Parity(eqx.Module):
        def __call__(self, n):
            return even(n) + super().__hash__()

    assert digest_of_code(Parity()) == digest_of_code(Parity())
