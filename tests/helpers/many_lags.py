"""Short records of a lag that hardens, for batches of many cases.

The records are computed by NumPy, so that every process makes the same ones.
"""

import numpy as np
from reference_estimation import rk4

from jaxid._foundation.types import Array
from jaxid.data import Record, record
from jaxid.models import AbstractModel

STEP = 0.1
NOISE = 0.02


class Hardening(AbstractModel):
    """A lag with a destabilising cubic: it diverges under a large input."""

    p: Array
    b: Array
    states, inputs, outputs = ("x",), ("u",), ("x",)

    def rhs(self, t, x, u):
        return -self.p * x + 0.05 * x**3 + self.b * u

    def output(self, t, x, u):
        return x


def lag_records(count: int, seed: int, samples: int = 60, shorter: int = 50) -> list[Record]:
    """Return records with their own truth each; every third is shorter."""
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(samples)
    u = np.sin(np.outer(rng.uniform(0.5, 2.0, count), t))
    theta = np.stack([rng.uniform(1.0, 2.0, count), rng.uniform(0.5, 1.5, count)])

    def rhs(x, u, theta):
        return -theta[0] * x + 0.05 * x**3 + theta[1] * u

    z = rk4(rhs, t, u.T, np.zeros(count), theta).T + NOISE * rng.normal(size=(count, samples))
    names = {"inputs": ("u",), "outputs": ("x",)}
    records = []
    for i in range(count):
        rows = shorter if i % 3 == 2 else samples
        records.append(record(t[:rows], u[i, :rows], z[i, :rows], name=f"lag {i}", **names))
    return records
