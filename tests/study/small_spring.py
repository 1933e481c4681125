"""The spring on which the loop is tried."""

import jax.numpy as jnp

from jaxid import AbstractModel
from jaxid._foundation.types import Array


class Spring(AbstractModel):
    """`dv/dt = force - k x - c v`, with the position seen."""

    k: Array
    c: Array
    states, inputs, outputs = ("x", "v"), ("force",), ("x",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1]])

    def output(self, t, x, u):
        return x[:1]
