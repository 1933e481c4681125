"""Memory maps used by compiled programs, and their release."""

import sys
from pathlib import Path

import jax


def release_compiled_programs_if_needed() -> None:
    """Clear JAX's compilation cache if more than half of the process's memory maps are in use.

    Each compiled program takes some hundreds of memory maps, and JAX releases none by itself. If
    none is left, the compiler aborts the process; about three hundred successive studies of a
    spring did. Programs that are needed again are compiled again.
    """
    taken, granted = memory_maps()
    if taken > granted / 2:
        jax.clear_caches()


def memory_maps() -> tuple[int, int]:
    """Return the number of memory maps that this process uses, and the system's limit.

    On a system without such a limit the first number is zero and the second unbounded.
    """
    taken, granted = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
    if not granted.exists():
        return 0, sys.maxsize
    return taken.read_text().count("\n"), int(granted.read_text())
