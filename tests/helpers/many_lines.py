"""Short records of a static line, for batches whose programs compile quickly."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from jaxid._foundation.types import Array
from jaxid.data import Record, record
from jaxid.models import AbstractModel, Free, free


class Line(AbstractModel):
    """`y = a u`."""

    a: Array
    states, inputs, outputs = (), ("u",), ("y",)

    def rhs(self, t, x, u):
        return jnp.zeros(0)

    def output(self, t, x, u):
        return self.a * u

    def initial_state(self, record):
        return jnp.zeros(0)


def model() -> Line:
    """Return the model at its start."""
    return Line(a=0.5)


def chosen() -> Free:
    """Return the free parameter."""
    return free(model(), "a")


def line_records(count: int, failing: Sequence[int] = ()) -> list[Record]:
    """Return records of 12 samples with their own truth each; failing ones lack the input `u`."""
    rng, t = np.random.default_rng(5), np.arange(12.0)
    records = []
    for number in range(count):
        u = rng.normal(size=(12, 1))
        z = rng.uniform(1.0, 2.0) * u + 0.1 * rng.normal(size=u.shape)
        inputs = ("other",) if number in failing else ("u",)
        records.append(record(t, u, z, inputs=inputs, outputs=("y",), name=f"line {number}"))
    return records
