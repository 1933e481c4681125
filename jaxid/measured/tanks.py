"""Cascaded tanks: a pump fills an upper tank, which drains into a lower tank.

The declared model is two tanks that drain by Bernoulli's law.
"""
# Pyright treats equinox's abstract fields as arguments of the constructor, which they are not.
# pyright: reportCallIssue=false, reportArgumentType=false

from pathlib import Path

import jax.numpy as jnp

from .._foundation.types import Array
from ..data.datasets import cascaded_tanks as load
from ..estimation.likelihoods import OutputError
from ..models.base import AbstractModel
from ..models.free import free
from .base import Declared


class Tanks(AbstractModel):
    """Two tanks that drain by Bernoulli's law, with levels in volts of the sensor.

        d(upper)/dt = inflow u - outlet sqrt(upper)
        d(lower)/dt = outlet sqrt(upper) - drain sqrt(lower)

    The upper level is not measured, so that its scale is arbitrary. It is chosen such that the
    outflow of the upper tank equals the inflow of the lower tank.
    """

    inflow: Array
    outlet: Array
    drain: Array
    states, inputs, outputs = ("upper", "lower"), ("pump",), ("level",)

    def rhs(self, t, x, u):
        upper, lower = jnp.sqrt(jnp.maximum(x, EMPTY))
        filled = self.inflow * u[0] - self.outlet * upper
        return jnp.stack([filled, self.outlet * upper - self.drain * lower])

    def output(self, t, x, u):
        return x[1:]

    def initial_state(self, record):
        return jnp.stack([record.z[0, 0], record.z[0, 0]])


EMPTY = 1e-3  # [V] lower limit of a level (chosen), for a finite derivative of the root


def tanks(path: str | Path | None = None) -> Declared:
    """Return the cascaded tanks with a declared model of two tanks that drain by Bernoulli's law.

    The starting values are estimates from the response: all rates are 0.05 V^(1/2)/s, which is a
    time constant of a minute and a half at half height.

    Args:
        path: file or folder; the environment variable JAXID_DATA by default.

    Raises:
        InputError: when the file is missing or its SHA-256 differs from the published file.
    """
    rate = jnp.array(0.05)
    model = Tanks(inflow=rate, outlet=rate, drain=rate)
    chosen = free(model, "inflow", "outlet", "drain", per_record=("initial_state",))
    return Declared(load(path), model, chosen, OutputError())
