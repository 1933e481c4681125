"""`InnovationModel`: a model with the gain of a steady filter among its parameters."""

import equinox as eqx
import jax.numpy as jnp

from .._foundation.types import Array, Float
from .base import AbstractModel
from .wrapper import AbstractWrapper, observed_sample


class InnovationModel(AbstractWrapper):
    """A model whose states are corrected by its innovations.

        x(i|i) = x(i|i-1) + K v_i,    v_i = z_i - output(t_i, x(i|i-1), u_i)     (A.57)

    Simulated, it moves as the model; a likelihood applies the gain.

    Args:
        model: the model.
        gain: elements of K, by state and output [unit of the state per unit of the output]; all
            others are zero.
    """

    model: AbstractModel
    gain: dict[str, dict[str, Float[Array, ""]]]

    states: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)

    def __init__(self, model: AbstractModel, gain: dict[str, dict[str, Float[Array, ""]]]):
        self.model, self.gain = model, gain
        self.states, self.inputs, self.outputs = model.states, model.inputs, model.outputs

    def rhs(self, t, x, u):
        return self.model.rhs(t, x, u)

    def output(self, t, x, u):
        return observed_sample(self.model, t, self.model.output(t, x, u))

    def output_given(self, t, x, u, dx):
        return observed_sample(self.model, t, self.model.output_given(t, x, u, dx))

    def observe(self, t, y):
        return y  # in `output`

    def units(self):
        units = self.model.units()

        def unit(state: str, output: str) -> str:
            above, below = units.get(state, ""), units.get(output, "")
            return "" if above == below else f"{above or '1'}/({below or '1'})"

        return units | {
            f"gain.{state}.{output}": unit(state, output)
            for state, row in self.gain.items()
            for output in row
        }

    def matrix(self) -> Float[Array, "state output"]:
        """Return the gain K."""
        K = jnp.zeros((len(self.states), len(self.outputs)))
        for state, row in self.gain.items():
            for output, value in row.items():
                K = K.at[self.states.index(state), self.outputs.index(output)].set(value)
        return K
