"""Harder truths of the F-16."""

from benchmarks.missing_effects import f16
from benchmarks.missing_effects.harder import sixdof
from benchmarks.missing_effects.scenarios import System


def system() -> System:
    """The F-16 with its harder truths."""
    return sixdof.system(f16.aircraft(), f16.system())
