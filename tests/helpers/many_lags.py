"""Short records of a lag that hardens, for batches of many cases.

The records are computed by NumPy, so that every process makes the same ones.
"""

from collections.abc import Sequence

import numpy as np
from reference_estimation import rk4

from jaxid._foundation.types import Array
from jaxid.data import Record, record
from jaxid.models import AbstractModel, Free, free

STEP = 0.1
NOISE = 0.02
CUBIC = 0.05


class Hardening(AbstractModel):
    """A lag with a destabilising cubic: it diverges under a large input."""

    p: Array
    b: Array
    cubic: Array
    states, inputs, outputs = ("x",), ("u",), ("x",)

    def rhs(self, t, x, u):
        return -self.p * x + self.cubic * x**3 + self.b * u

    def output(self, t, x, u):
        return x


def model() -> Hardening:
    """Return the model at its start."""
    return Hardening(p=1.0, b=0.7, cubic=CUBIC)


def chosen() -> Free:
    """Return the free parameters, the same in all tests, which then share compiled programs."""
    return free(model(), "p", "b", per_record=("initial_state",), bounds={"p": (0.1, 10.0)})


def lag_records(count: int, seed: int, silent: Sequence[int] = ()) -> list[Record]:
    """Return records of 60 samples with their own truth each; every third has 50.

    Args:
        count: number of records.
        seed: of the random numbers.
        silent: records without input, of the decay from one.
    """
    samples, shorter = 60, 50
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(samples)
    u = np.sin(np.outer(rng.uniform(0.5, 2.0, count), t))
    silent = list(silent)
    u[silent] = 0.0
    x0 = np.zeros(count)
    x0[silent] = 1.0
    theta = np.stack([rng.uniform(1.0, 2.0, count), rng.uniform(0.5, 1.5, count)])

    def rhs(x, u, theta):
        return -theta[0] * x + CUBIC * x**3 + theta[1] * u

    z = rk4(rhs, t, u.T, x0, theta).T + NOISE * rng.normal(size=(count, samples))
    names = {"inputs": ("u",), "outputs": ("x",)}
    records = []
    for i in range(count):
        rows = shorter if i % 3 == 2 else samples
        records.append(record(t[:rows], u[i, :rows], z[i, :rows], name=f"lag {i}", **names))
    return records


def lag_pairs(count: int) -> list[tuple[Record, Record]]:
    """Return cases of two records, each record with its own truth."""
    records = lag_records(2 * count, seed=11)
    return list(zip(records[::2], records[1::2], strict=True))
