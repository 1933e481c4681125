"""Number of cases that one `vmap` advances, by device and by the memory of a case."""

import dataclasses

import jax
from jax.sharding import Mesh

from .._foundation.device import default_device, memory_of
from .cases import Bucket
from .iteration import Settings, slot_shapes

# On a CPU, a few vectors wide (chosen).
WIDTH_OF_CPU = 16
# On a GPU, where a step of time takes as long for many cases as for one: two widths, so that few
# programs are compiled. The narrow one serves a few cases, whose copies fill the slots (chosen).
NARROW, WIDEST = 256, 8192
# Bytes of a program over those of one group of slots: temporary arrays, measured on a CPU (7 for a
# spring with two parameters, 3 for the aircraft of `benchmarks/reference_problem` with 30), and up
# to four groups of slots before and after; the rest is reserve.
WORKING_SHARE = 24


def with_width(settings: Settings, bucket: Bucket, mesh: Mesh | None) -> Settings:
    """Return the settings with the number of cases of a group.

    Args:
        settings: the settings.
        bucket: the cases.
        mesh: the devices; None for JAX's default device.
    """
    device = default_device() if mesh is None else mesh.devices.flat[0]
    count = len(bucket.cases) if mesh is None else -(-len(bucket.cases) // mesh.size)
    width = WIDTH_OF_CPU
    if device.platform != "cpu":
        shapes = slot_shapes(bucket.batch(bucket.cases[:1]), settings)
        slot_bytes = sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(shapes))
        width = accelerator_width(count, slot_bytes, memory_of(device))
    return dataclasses.replace(settings, width=width)


def accelerator_width(count: int, slot_bytes: int, memory: int) -> int:
    """Return the number of cases of a group on a GPU, a power of two.

    Args:
        count: number of cases of a device.
        slot_bytes: of one case [bytes].
        memory: of the device [bytes].
    """
    fitting = max(memory // (WORKING_SHARE * slot_bytes), 1)
    widest = min(1 << (fitting.bit_length() - 1), WIDEST)
    return min(widest, NARROW) if count <= NARROW else widest
