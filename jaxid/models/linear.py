"""Linear time-invariant models; their exact solutions are references for tests of the library."""

import equinox as eqx
import jax.numpy as jnp

from .._foundation.checks import require
from .._foundation.types import Array, Float
from .base import AbstractModel


class LinearModel(AbstractModel):
    """A linear model: `dx/dt = A x + B u`, `y = C x + D u`.

    Args:
        A, B, C, D: the matrices, whose elements are parameters named `A[0,1]`.
        states, inputs, outputs: names of the channels.

    Raises:
        InputError: when a matrix does not fit the names.
    """

    A: Float[Array, "state state"]
    B: Float[Array, "state input"]
    C: Float[Array, "output state"]
    D: Float[Array, "output input"]
    states: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)

    def __init__(self, A, B, C, D, *, states, inputs, outputs):
        n, m, p = len(states), len(inputs), len(outputs)
        self.A, self.B, self.C, self.D = (jnp.asarray(matrix, float) for matrix in (A, B, C, D))
        for name, shape in (("A", (n, n)), ("B", (n, m)), ("C", (p, n)), ("D", (p, m))):
            actual = getattr(self, name).shape
            require(
                actual == shape, f"{name} has shape {actual}, but the channel names need {shape}."
            )
        self.states, self.inputs, self.outputs = tuple(states), tuple(inputs), tuple(outputs)

    def rhs(self, t, x, u):
        return self.A @ x + self.B @ u

    def output(self, t, x, u):
        return self.C @ x + self.D @ u
