"""Silverbox: an electronic circuit that behaves like a mass on a spring.

The declared model is a linear oscillator.
"""
# Pyright treats equinox's abstract fields as arguments of the constructor, which they are not.
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
    """Return the Silverbox with a declared linear oscillator.

    The starting values are estimates from the response: a resonance near 60 Hz, `damping = 0.1
    sqrt(stiffness)`, and a static gain of one half. There are two steps per sample, which is about
    20 steps per period.

    Args:
        path: file or folder; the environment variable JAXID_DATA by default.

    Raises:
        InputError: when the file is missing or its SHA-256 differs from the published file.
    """
    squared = jnp.array((2 * jnp.pi * 60.0) ** 2)
    model = Oscillator(stiffness=squared, damping=0.1 * jnp.sqrt(squared), gain=0.5 * squared)
    chosen = free(model, "stiffness", "damping", "gain", per_record=("initial_state",))
    return Declared(load(path), model, chosen, OutputError(stepper=RK4(substeps=2)))
