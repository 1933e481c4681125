"""Silverbox: an electronic circuit that behaves as a mass on a spring; declared: a linear oscillator."""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are none.
# pyright: reportCallIssue=false, reportArgumentType=false

from pathlib import Path

import jax.numpy as jnp

from .._foundation.types import Array
from ..data.datasets import silverbox as load
from ..estimation.likelihoods import OutputError
from ..models.base import AbstractModel
from ..models.free import free
from ..simulation.steppers import RK4
from .base import Declared


class Oscillator(AbstractModel):
    """A linear oscillator: `dx/dt = v`, `dv/dt = gain u - stiffness x - damping v`, `y = x`."""

    stiffness: Array
    damping: Array
    gain: Array
    states, inputs, outputs = ("x", "v"), ("u",), ("y",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], self.gain * u[0] - self.stiffness * x[0] - self.damping * x[1]])

    def output(self, t, x, u):
        return x[:1]

    def initial_state(self, record):
        return jnp.stack([record.z[0, 0], jnp.zeros(())])


def silverbox(path: str | Path | None = None) -> Declared:
    """The Silverbox with a linear oscillator declared for it.

    Starting values: a resonance near 60 Hz with a tenth of critical damping, a static gain of one half, read off the
    response; two steps per sample, of a tenth of a period each.

    Args:
        path: file or folder; the environment variable JAXID_DATA by default.

    Raises:
        InputError: when the file is not there or not the one that was published.
    """
    squared = jnp.array((2 * jnp.pi * 60.0) ** 2)
    model = Oscillator(stiffness=squared, damping=0.1 * jnp.sqrt(squared), gain=0.5 * squared)
    chosen = free(model, "stiffness", "damping", "gain", per_record=("initial_state",))
    return Declared(load(path), model, chosen, OutputError(stepper=RK4(substeps=2)))
