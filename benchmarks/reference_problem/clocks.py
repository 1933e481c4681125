"""Clocks and repeated timing.

The table's figure is the smallest of the repeats: other work on the machine only adds time. The
programs take turns, so that a slow minute meets all of them.
"""

import resource
import statistics
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

MEGABYTE = 1e6


def cpu_seconds() -> float:
    """Return the processor time of this process and of its ended children [s]."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


# `cpu` suits a machine that others use too, with the process pinned to one core.
CLOCKS: dict[str, Callable[[], float]] = {"wall": time.perf_counter, "cpu": cpu_seconds}


class Timing(NamedTuple):
    """Times of the repeats of one function [s]."""

    smallest: float
    median: float
    repeats: int


def time_in_turns(
    functions: Mapping[str, Callable[[], object]],
    repeats: int,
    budget: float,
    clock: Callable[[], float],
) -> dict[str, Timing]:
    """Return the times of each function, all of which have run once before.

    Args:
        functions: by name.
        repeats: of each function.
        budget: after so many seconds a function is not repeated again [s].
        clock: one of `CLOCKS`.
    """
    times: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(repeats):
        for name, function in functions.items():
            if sum(times[name]) > budget:
                continue
            begin = clock()
            function()
            times[name].append(clock() - begin)
    return {
        name: Timing(min(taken), statistics.median(taken), len(taken))
        for name, taken in times.items()
    }


def peak_megabytes() -> float:
    """Return the most memory that this process has held [MB].

    On Linux from its own memory map: `getrusage` counts that of the parent before the start too.
    """
    status = Path("/proc/self/status")
    if status.exists():
        line = next(row for row in status.read_text().splitlines() if row.startswith("VmHWM"))
        return float(line.split()[1]) * 1024.0 / MEGABYTE
    unit = 1.0 if sys.platform == "darwin" else 1024.0  # macOS counts bytes
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / MEGABYTE
