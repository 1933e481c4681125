"""A second plain call of `simulate` with other numbers compiles nothing, whatever their type.

Compilations are counted by the events that JAX records: once for every program, cached on disk or
not.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.models import LinearModel
from jaxid.models.base import AbstractModel
from jaxid.simulation import RK4, Adaptive, BandLimited, Cubic, Linear, ZeroOrder, simulate


class Lag(AbstractModel):
    """A lag of first order."""

    p: object
    b: object
    states, inputs, outputs = ("x",), ("u",), ("x",)

    def rhs(self, t, x, u):
        return self.b * u - self.p * x

    def output(self, t, x, u):
        return x


def case(scale=1.0, n=60):
    t = 0.05 * np.arange(n)
    return t, scale * np.sin(3.0 * t)[:, None], np.array([0.1 * scale])


LEAVES = {
    "a float": lambda: (Lag(0.9, 1.1), *case(2.0)),
    "an int": lambda: (Lag(1, 2), *case(2.0)),
    "float32": lambda: (Lag(jnp.float32(0.9), np.float32(1.1)), *map(np.float32, case(2.0))),
    "a weak type": lambda: (Lag(jnp.asarray(0.9) * 1.0, jax.lax.full_like(0.0, 1.0)), *case(2.0)),
    "numpy": lambda: (Lag(np.float64(0.9), np.asarray(1.1)), *case(2.0)),
    "float64": lambda: (Lag(jnp.array(0.9), jnp.array(1.1)), *map(jnp.asarray, case(2.0))),
}


@pytest.mark.parametrize("leaf", LEAVES)
def test_simulate_with_other_numbers_does_not_compile(compilations, leaf):
    simulate(Lag(jnp.array(1.0), jnp.array(1.0)), *case())
    arguments = LEAVES[leaf]()
    compilations.clear()
    solution = simulate(*arguments)
    assert compilations == []
    assert solution.y.dtype == jnp.float64


METHODS = {
    "zero-order": lambda: {"hold": ZeroOrder()},
    "linear": lambda: {"hold": Linear(), "stepper": RK4(2)},
    "cubic": lambda: {"hold": Cubic(), "stepper": RK4(1, unrolled=False)},
    "band-limited": lambda: {"hold": BandLimited(half_width=8)},
    "adaptive": lambda: {"stepper": Adaptive(rtol=1e-6)},
}


@pytest.mark.parametrize("method", METHODS)
def test_simulate_with_another_hold_of_the_same_kind_does_not_compile(compilations, method):
    simulate(Lag(1.0, 1.0), *case(), **METHODS[method]())
    compilations.clear()
    simulate(Lag(0.9, 1.1), *case(2.0), **METHODS[method]())
    assert compilations == []


def test_simulate_under_vmap_and_jacfwd_does_not_compile_again(compilations):
    t, u, start = map(jnp.asarray, case())

    def sweep(scale):
        jax.vmap(lambda b: simulate(Lag(1.0, b), t, u, start).y)(scale * jnp.arange(1.0, 4.0))
        jax.jacfwd(lambda b: simulate(Lag(1.0, b), t, u, start).y)(scale)

    sweep(jnp.array(1.0))
    compilations.clear()
    sweep(jnp.array(0.5))
    assert compilations == []


def test_simulate_of_a_stack_does_not_compile_again(compilations):
    t, u, start = (np.stack([array, array, array]) for array in case())
    simulate(Lag(1.0, 1.0), t, u, start)
    compilations.clear()
    simulate(Lag(0.9, 1.1), t, 2.0 * u, start)
    assert compilations == []


def test_simulate_of_another_model_of_the_same_class_does_not_compile(compilations):
    def double(a):
        matrices = [[0.0, 1.0], [-a, -0.6]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]
        names = {"states": ("x", "v"), "inputs": ("u",), "outputs": ("x",)}
        return LinearModel(*map(np.asarray, matrices), **names)

    t, u, _ = case()
    simulate(double(4.0), t, u, np.zeros(2))
    compilations.clear()
    simulate(double(5.0), t, u, np.ones(2))
    assert compilations == []
