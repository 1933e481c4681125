"""EMPS: a carriage on a ball screw, driven by a motor; declared: a mass with viscous friction."""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are none.
# pyright: reportCallIssue=false, reportArgumentType=false

from pathlib import Path

import jax.numpy as jnp

from .._foundation.types import Array
from ..data.datasets import emps as load
from ..estimation.likelihoods import OutputError
from ..models.base import AbstractModel
from ..models.free import free
from .base import Declared


class Carriage(AbstractModel):
    """A mass with viscous friction: `d(position)/dt = velocity`, `d(velocity)/dt = (force - viscous velocity) / mass`."""

    mass: Array
    viscous: Array
    states, inputs, outputs = ("position", "velocity"), ("force",), ("position",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], (u[0] - self.viscous * x[1]) / self.mass])

    def output(self, t, x, u):
        return x[:1]

    def units(self):
        return {"position": "m", "velocity": "m/s", "force": "N", "mass": "kg", "viscous": "N*s/m"}


def emps(path: str | Path | None = None) -> Declared:
    """The EMPS with a mass and viscous friction declared for it, started at its first measured position at rest.

    Args:
        path: folder of the two files; the environment variable JAXID_DATA by default.

    Raises:
        InputError: when a file is not there or not the one that was published.
    """
    model = Carriage(mass=jnp.array(100.0), viscous=jnp.array(100.0))
    return Declared(load(path), model, free(model, "mass", "viscous"), OutputError())
