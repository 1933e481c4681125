"""Harder truths of the F-4-like aircraft."""

from benchmarks.missing_effects import f4
from benchmarks.missing_effects.harder import sixdof
from benchmarks.missing_effects.scenarios import System


def system() -> System:
    """The F-4-like aircraft with its harder truths."""
    return sixdof.system(f4.aircraft(), f4.system())
