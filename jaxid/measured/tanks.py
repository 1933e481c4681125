"""Cascaded tanks: a pump fills an upper tank that runs into a lower one; declared: two tanks after Bernoulli."""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are none.
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
    """Two tanks that drain by Bernoulli's law, levels in volts of the sensor.

        d(upper)/dt = inflow u - outlet sqrt(upper)
        d(lower)/dt = outlet sqrt(upper) - drain sqrt(lower)

    The upper level is not seen, so that its scale is free; it is chosen such that the lower tank gains what the upper one loses.
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


EMPTY = 1e-3  # [V] below which a tank counts as empty, so that the root keeps a derivative


def tanks(path: str | Path | None = None) -> Declared:
    """The cascaded tanks with two tanks after Bernoulli declared for them.

    Starting values: all rates 0.05 V^(1/2)/s, a time constant of a minute and a half at half height, read off the response.

    Args:
        path: file or folder; the environment variable JAXID_DATA by default.

    Raises:
        InputError: when the file is not there or not the one that was published.
    """
    rate = jnp.array(0.05)
    model = Tanks(inflow=rate, outlet=rate, drain=rate)
    chosen = free(model, "inflow", "outlet", "drain", per_record=("initial_state",))
    return Declared(load(path), model, chosen, OutputError())
