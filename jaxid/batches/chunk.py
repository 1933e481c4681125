"""The host's loop over the cases of a batch: slots in which cases advance by a few steps.

Finished cases leave their slots and waiting ones enter. Each device has slots of its own.
"""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from .cases import Bucket, Case
from .iteration import CaseResult, Settings, Slots, advance, enter, finish, slot_shapes

# Smallest number of groups on a device, so that cases enter while a slow one goes on; the largest
# number, and the largest size of its slots in memory [bytes] (both chosen).
LEAST_GROUPS = 2
MOST_GROUPS = 4
SLOT_BYTES = 256_000_000


class Finished(NamedTuple):
    """Cases whose iteration has ended.

    Attributes:
        cases: the cases.
        results: their results on the host, in the same order.
    """

    cases: list[Case]
    results: CaseResult


def run(bucket: Bucket, settings: Settings, mesh: Mesh | None) -> Iterator[Finished]:
    """Yield the results of the cases of a bucket as they finish.

    Args:
        bucket: cases of one shape.
        settings: likelihood and options.
        mesh: devices over which the cases are distributed; None for JAX's default device.
    """
    waiting, chunk = deque(bucket.cases), Chunk(bucket, settings, mesh)
    while waiting or chunk.is_busy:
        chunk.fill(waiting)
        chunk.advance()
        yield from chunk.collect()


class Chunk:
    """The slots of all devices, with the cases in them.

    Args:
        bucket: cases of one shape.
        settings: likelihood and options.
        mesh: the devices; None for JAX's default device.
    """

    def __init__(self, bucket: Bucket, settings: Settings, mesh: Mesh | None) -> None:
        self.bucket, self.settings, self.mesh = bucket, settings, mesh
        shapes = slot_shapes(bucket.batch(bucket.cases[:1]), settings)
        self.devices = 1 if mesh is None else mesh.size
        count = self.devices * settings.width * _group_count(shapes, settings.width)
        self.slots: Slots = self._put(
            jax.tree.map(lambda leaf: np.zeros((count, *leaf.shape[1:]), leaf.dtype), shapes)
        )
        self.occupants: list[Case | None] = [None] * count
        self.done = np.ones(count, bool)  # as of the last call of `collect`

    @property
    def is_busy(self) -> bool:
        """True while a case is in a slot."""
        return any(case is not None for case in self.occupants)

    def fill(self, waiting: deque[Case]) -> None:
        """Move waiting cases into free slots, if there is a free slot.

        The devices take turns, so that few cases are spread over all of them.
        """
        by_device = np.arange(len(self.occupants)).reshape(self.devices, -1)
        free = [slot for slot in by_device.T.ravel().tolist() if self.occupants[slot] is None]
        entering = {slot: waiting.popleft() for slot in free[: len(waiting)]}
        if not entering:
            return
        first = next(iter(entering.values()))
        in_order = [entering.get(slot, first) for slot in range(len(self.occupants))]
        is_new = np.array([slot in entering for slot in range(len(self.occupants))])
        arrays = self._put(self.bucket.batch(in_order))
        self.slots = enter(self.slots, arrays, self._put(is_new), self.settings, self.mesh)
        for slot, case in entering.items():
            self.occupants[slot], self.done[slot] = case, False

    def advance(self) -> None:
        """Advance the active cases by some steps, and move them to the first slots."""
        order, active = self._first(~self.done)
        self.slots = advance(
            self.slots, self._put(order), self._put(active), self.settings, self.mesh
        )
        moved = self._absolute(order)
        self.occupants = [self.occupants[slot] for slot in moved]

    def collect(self) -> Iterator[Finished]:
        """Yield the results of finished cases, once they fill a group of each device, and free
        their slots.
        """
        is_occupied = np.array([case is not None for case in self.occupants])
        self.done = np.array(self.slots.iterate.done) | ~is_occupied
        ended = self.done & is_occupied
        if np.sum(ended) < self.devices * self.settings.width and not np.all(self.done):
            return
        order, count = self._first(ended)
        results = finish(self.slots, self._put(order), self._put(count), self.settings, self.mesh)
        moved = self._absolute(order)
        kept = np.flatnonzero(ended[moved])
        cases = [case for case in (self.occupants[moved[slot]] for slot in kept) if case]
        for slot in moved[kept]:
            self.occupants[slot] = None
        yield Finished(cases, jax.tree.map(lambda leaf: np.asarray(leaf)[kept], results))

    def _first(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return an order of each device's slots with chosen ones first, and their numbers."""
        by_device = chosen.reshape(self.devices, -1)
        order = np.argsort(~by_device, axis=1, kind="stable")
        return order.ravel(), np.sum(by_device, axis=1)

    def _absolute(self, order: np.ndarray) -> np.ndarray:
        """Return an order of the slots of all devices from those of each device's slots."""
        by_device = order.reshape(self.devices, -1)
        return (by_device + np.arange(self.devices)[:, None] * by_device.shape[1]).ravel()

    def _put(self, tree):
        """Return arrays of the host on the devices; a program moves them to a single one."""
        if self.mesh is None:
            return tree
        return jax.device_put(tree, NamedSharding(self.mesh, PartitionSpec(self.mesh.axis_names)))


def _group_count(shapes: Slots, width: int) -> int:
    """Return the number of groups on a device: `MOST_GROUPS`, or `LEAST_GROUPS` if memory is short.

    It does not depend on the number of cases, so that all batches share their programs.
    """
    slot_bytes = sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(shapes))
    return int(np.clip(SLOT_BYTES // max(slot_bytes * width, 1), LEAST_GROUPS, MOST_GROUPS))
