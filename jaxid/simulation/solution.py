"""`Solution`: the result of a simulation with any stepper."""

import equinox as eqx

from .._foundation.types import Array, Bool, Float


class Solution(eqx.Module):
    """A simulated time history.

    Attributes:
        t: sample times [s].
        x: states at the samples, in the model's units.
        y: outputs at the samples, in the model's units.
        finite: False where the simulation diverged; the values of that case are then invalid.
    """

    t: Float[Array, "*case time"]
    x: Float[Array, "*case time state"]
    y: Float[Array, "*case time output"]
    finite: Bool[Array, "*case"]
