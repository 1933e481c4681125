"""The host's loop over the cases of a batch: chunks of slots, one on each device.

A chunk advances its active cases by a few steps, finished cases leave it and waiting ones enter.
While one device computes, the host serves the chunks of the others.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from .._foundation.host import to_device
from .cases import Bucket, Case, CaseArrays
from .iteration import CaseResult, Settings, Slots, advance, empty_slots, enter, finish

# Largest number of groups in a chunk, and its largest size in memory [bytes] (both chosen).
MOST_GROUPS = 4
CHUNK_BYTES = 256_000_000

Device = Any  # a jax.Device, which is no class for a type checker


class Finished(NamedTuple):
    """Cases whose iteration has ended.

    Attributes:
        cases: the cases.
        results: their results on the host, in the same order.
    """

    cases: list[Case]
    results: CaseResult


def run(bucket: Bucket, settings: Settings, devices: Sequence[Device | None]) -> Iterator[Finished]:
    """Yield the results of the cases of a bucket as they finish.

    Args:
        bucket: cases of one shape.
        settings: likelihood and options.
        devices: one device for each chunk; None is JAX's default device.
    """
    waiting = deque(bucket.cases)
    one = bucket.batch(bucket.cases[:1], 1)
    groups = _group_count(len(waiting), len(devices), _bytes(one, settings), settings.width)
    count = groups * settings.width
    chunks = [Chunk(bucket, count, settings, device) for device in devices]
    while waiting or any(chunk.is_busy for chunk in chunks):
        for chunk in chunks:
            yield from chunk.collect(bool(waiting))
            chunk.fill(waiting)
            chunk.advance()


class Chunk:
    """Slots for cases on one device.

    Args:
        bucket: cases of one shape.
        count: number of slots, a multiple of `settings.width`.
        settings: likelihood and options.
        device: the device; None is JAX's default device.
    """

    def __init__(
        self, bucket: Bucket, count: int, settings: Settings, device: Device | None
    ) -> None:
        self.bucket, self.settings, self.device = bucket, settings, device
        self.occupants: list[Case | None] = [None] * count
        self.done = np.ones(count, bool)  # as of the last call of `collect`
        arrays = bucket.batch(bucket.cases[:1], count)
        zeros = jax.tree.map(
            lambda leaf: np.zeros(leaf.shape, leaf.dtype), empty_slots(arrays, settings)
        )
        self.slots: Slots = self._put(zeros)

    @property
    def is_busy(self) -> bool:
        """True while a case is in the chunk."""
        return any(case is not None for case in self.occupants)

    def fill(self, waiting: deque[Case]) -> None:
        """Move waiting cases into free slots, if there is a free slot."""
        free = [slot for slot, case in enumerate(self.occupants) if case is None]
        entering = {slot: waiting.popleft() for slot in free[: len(waiting)]}
        if not entering:
            return
        first = next(iter(entering.values()))
        in_order = [entering.get(slot, first) for slot in range(len(self.occupants))]
        is_new = np.array([slot in entering for slot in range(len(self.occupants))])
        arrays = self.bucket.batch(in_order, len(in_order))
        self.slots = enter(self.slots, self._put(arrays), self._put(is_new), self.settings)
        for slot, case in entering.items():
            self.occupants[slot], self.done[slot] = case, False

    def advance(self) -> None:
        """Start some steps of the active cases, which move to the first slots."""
        active = int(np.sum(~self.done))
        if not active:
            return
        order = np.argsort(self.done, kind="stable")
        self.slots = advance(self.slots, self._put(order), self._put(active), self.settings)
        self.occupants = [self.occupants[slot] for slot in order]
        self.done = self.done[order]

    def collect(self, is_waiting: bool) -> Iterator[Finished]:
        """Yield the results of finished cases once they are many, and free their slots.

        Args:
            is_waiting: True if other cases wait for a slot.
        """
        if not self.is_busy:
            return
        occupied = np.array([case is not None for case in self.occupants])
        self.done = np.asarray(self.slots.iterate.done) | ~occupied
        ended = self.done & occupied
        enough = len(ended) // 2 if is_waiting else self.settings.width
        count = int(np.sum(ended))
        if count < enough and not np.all(self.done):
            return
        order = np.argsort(~ended, kind="stable")
        results = finish(self.slots, self._put(order), self._put(count), self.settings)
        cases = [case for case in (self.occupants[slot] for slot in order[:count]) if case]
        for slot in order[:count]:
            self.occupants[slot] = None
        yield Finished(cases, jax.tree.map(lambda leaf: np.asarray(leaf)[:count], results))

    def _put(self, tree):
        """Return arrays of the host on the device of the chunk."""
        tree = jax.tree.map(np.asarray, tree)
        return to_device(tree) if self.device is None else jax.device_put(tree, self.device)


def _bytes(one: CaseArrays, settings: Settings) -> int:
    """Return the memory of one slot [bytes]."""
    leaves = jax.tree.leaves(empty_slots(one, settings))
    return sum(leaf.size * leaf.dtype.itemsize for leaf in leaves)


def _group_count(cases: int, devices: int, slot_bytes: int, width: int) -> int:
    """Return the number of groups in a chunk: 1 or `MOST_GROUPS`, less if memory is short.

    Two sizes only, so that batches of other sizes find their programs compiled.
    """
    if cases <= devices * width:
        return 1
    return int(np.clip(CHUNK_BYTES // max(slot_bytes * width, 1), 1, MOST_GROUPS))
