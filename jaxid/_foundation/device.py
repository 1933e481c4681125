"""JAX's default device and its memory."""

from typing import Any

import jax
import numpy as np

# Of a GPU whose memory JAX does not know [bytes]; chosen.
UNKNOWN_MEMORY = 4_000_000_000


def default_device() -> Any:
    """Return the device on which JAX computes unless another one is named."""
    with jax.ensure_compile_time_eval():
        return next(iter(jax.device_put(np.zeros(())).devices()))


def memory_of(device: Any) -> int:
    """Return the memory of a GPU [bytes]."""
    return (device.memory_stats() or {}).get("bytes_limit", UNKNOWN_MEMORY)
