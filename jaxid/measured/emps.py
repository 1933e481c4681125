"""EMPS: a carriage on a ball screw, driven by a motor.

The declared model is a mass with viscous friction, alone or with its controller.
"""
# Pyright treats equinox's abstract fields as arguments of the constructor, which they are not.
# pyright: reportCallIssue=false, reportArgumentType=false

from pathlib import Path

import jax.numpy as jnp

from .._foundation.types import Array
from ..data.datasets import emps as load
from ..data.datasets import emps_closed_loop as load_closed_loop
from ..estimation.likelihoods import OutputError
from ..models.base import AbstractModel
from ..models.free import free
from .base import Declared


class Carriage(AbstractModel):
    """A mass with viscous friction.

    d(position)/dt = velocity,    d(velocity)/dt = (force - viscous velocity) / mass
    """

    mass: Array
    viscous: Array
    states, inputs, outputs = ("position", "velocity"), ("force",), ("position",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], (u[0] - self.viscous * x[1]) / self.mass])

    def output(self, t, x, u):
        return x[:1]

    def units(self):
        return {"position": "m", "velocity": "m/s", "force": "N", "mass": "kg", "viscous": "N*s/m"}


# Gains of the controller and of the motor, published with the records (variables kp, kv, gtau of
# both files).
KP, KV, GTAU = 160.18, 243.45, 35.15065188248547  # [1/s], [V s/m], [N/V]


class ControlledCarriage(AbstractModel):
    """The same mass with its controller of known gains, a feedback of position and velocity.

        command = KV (KP (reference - position) - velocity) + pulse
        d(position)/dt = velocity,    d(velocity)/dt = (GTAU command - viscous velocity) / mass

    On both records this law reproduces the recorded command, of 1.5 V (RMS), within 0.07 V. The
    controller is modelled in continuous time and without a limit of the command, which stays below
    9.1 V.
    """

    mass: Array
    viscous: Array
    states, inputs, outputs = ("position", "velocity"), ("reference", "pulse"), ("position",)

    def rhs(self, t, x, u):
        command = KV * (KP * (u[0] - x[0]) - x[1]) + u[1]
        return jnp.stack([x[1], (GTAU * command - self.viscous * x[1]) / self.mass])

    def output(self, t, x, u):
        return x[:1]

    def units(self):
        units = {"position": "m", "velocity": "m/s", "reference": "m", "pulse": "V"}
        return units | {"mass": "kg", "viscous": "N*s/m"}


def emps(path: str | Path | None = None) -> Declared:
    """Return the EMPS with a declared mass and viscous friction, starting at rest at the first
    measured position.

    Args:
        path: folder of the two files; the environment variable JAXID_DATA by default.

    Raises:
        InputError: when a file is missing or its SHA-256 differs from the published file.
    """
    # Rough starting values (chosen).
    model = Carriage(mass=jnp.array(100.0), viscous=jnp.array(100.0))
    return Declared(load(path), model, free(model, "mass", "viscous"), OutputError())


def emps_closed_loop(path: str | Path | None = None) -> Declared:
    """Return the EMPS with a declared mass, viscous friction and the published controller.

    The input is the reference, the output is the position.

    Args:
        path: folder of the two files; the environment variable JAXID_DATA by default.

    Raises:
        InputError: when a file is missing or its SHA-256 differs from the published file.
    """
    # Starting values as in `emps`.
    model = ControlledCarriage(mass=jnp.array(100.0), viscous=jnp.array(100.0))
    chosen = free(model, "mass", "viscous", per_record=("initial_state",))
    return Declared(load_closed_loop(path), model, chosen, OutputError())
