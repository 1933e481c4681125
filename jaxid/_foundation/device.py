"""JAX's devices: the default one and its memory, and the threads of those of a CPU."""

import os
from collections.abc import Iterable
from typing import Any

import jax
import numpy as np

from .checks import require

# Environment variable that sets the number of threads in XLA's pool on a CPU, which all CPU devices
# of a process share; by default as many as processors.
POOL = "NPROC"
# Threads of the pool for each of several devices (chosen). JAX decomposes a batch of matrices on
# several threads of the pool while the calling one, of the same pool, waits (QR, jaxlib 0.10.2):
# when as many threads wait as there are, none is left to work, and the programs stand still. Two
# devices on two threads did.
THREADS_EACH = 4

# Of a GPU whose memory JAX does not know [bytes]; chosen.
UNKNOWN_MEMORY = 4_000_000_000


def default_device() -> Any:
    """Return the device on which JAX computes unless another one is named."""
    with jax.ensure_compile_time_eval():
        return next(iter(jax.device_put(np.zeros(())).devices()))


def memory_of(device: Any) -> int:
    """Return the memory of a GPU [bytes]."""
    return (device.memory_stats() or {}).get("bytes_limit", UNKNOWN_MEMORY)


def pool_threads() -> int:
    """Return the number of threads in XLA's pool on a CPU, as the environment sets it."""
    given = os.environ.get(POOL, "")
    return int(given) if given.isdecimal() else processors()


def require_threads(devices: Iterable[Any]) -> None:
    """Refuse several CPU devices whose programs could wait for each other for ever.

    Args:
        devices: devices that compute at the same time.

    Raises:
        InputError: if the pool has too few threads for them.
    """
    count = sum(device.platform == "cpu" for device in devices)
    needed, threads = THREADS_EACH * count, pool_threads()
    require(
        count < 2 or threads >= needed,
        f"The {count} CPU devices share {threads} threads, and could wait for each other for ever. "
        f"Call `jaxid.configure()` before the first array, or set the environment variable {POOL} "
        f"to {needed} or more before Python starts.",
    )


def processors() -> int:
    """Return the number of processors of this process."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
