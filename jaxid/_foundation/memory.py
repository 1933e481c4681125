"""How much of what Linux grants a process the compiled programs have taken, and room for more."""

import sys
from pathlib import Path

import jax


def make_room() -> None:
    """Let go of all that JAX has compiled in this process, where more than half of its memory maps are taken.

    Each program takes some hundreds of them, JAX gives none back by itself, and where none is left the compiler ends the process:
    some three hundred studies of a spring, one after the other, did. What is needed again is compiled again.
    """
    taken, granted = memory_maps()
    if taken > granted / 2:
        jax.clear_caches()


def memory_maps() -> tuple[int, int]:
    """How many memory maps this process has taken, and how many it is granted; a system that does not count them grants all."""
    taken, granted = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
    if not granted.exists():
        return 0, sys.maxsize
    return taken.read_text().count("\n"), int(granted.read_text())
