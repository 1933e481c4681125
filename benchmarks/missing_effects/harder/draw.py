"""Draws of planted effects: sizes, instances, and pairs."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from benchmarks.missing_effects.scenarios import HARDER, Planted, Scenario

Choice = TypeVar("Choice")
Maker = Callable[[np.random.Generator], Planted]
# Factor on each planted size, on a logarithmic scale; chosen: from half to twice.
LOWEST, HIGHEST = 0.5, 2.0
# Shares of a record between which a step occurs; chosen.
EARLIEST, LATEST = 0.3, 0.7
PAIRS = ("first", "second", "third")  # pairs of motion and sensor, each with draws of its own


def sized(generator: np.random.Generator, size: float) -> float:
    """Return a size times a random factor between `LOWEST` and `HIGHEST`; its sign is kept."""
    return float(size * np.exp(generator.uniform(np.log(LOWEST), np.log(HIGHEST))))


def one_of(generator: np.random.Generator, choices: Sequence[Choice]) -> Choice:
    """Return one of the choices at random."""
    return choices[int(generator.integers(len(choices)))]


def two_of(generator: np.random.Generator, choices: Sequence[Choice]) -> tuple[Choice, Choice]:
    """Return two different choices at random."""
    first, second = generator.choice(len(choices), 2, replace=False)
    return choices[int(first)], choices[int(second)]


def two_delays(generator: np.random.Generator, delay: float) -> tuple[float, float]:
    """Return a random delay about `delay` and one between 30 and 60 % of it [s]."""
    long = sized(generator, delay)
    return long, long * float(generator.uniform(0.3, 0.6))


def moment(generator: np.random.Generator, duration: float) -> float:
    """Return a random time in the middle of a record [s]."""
    return duration * float(generator.uniform(EARLIEST, LATEST))


def harder(
    name: str, draw: Callable[[np.random.Generator], tuple[Planted, ...]], **setting
) -> Scenario:
    """Return a scenario of kind `HARDER`, whose effects each seed draws."""
    return Scenario(name, HARDER, (), setting, draw)


def pairs(motion: Sequence[Maker], sensors: Sequence[Maker]) -> tuple[Scenario, ...]:
    """Return scenarios with a random effect in the motion and a random one in a sensor."""

    def draw(generator):
        return one_of(generator, motion)(generator), one_of(generator, sensors)(generator)

    return tuple(harder(f"motion and sensor, {number}", draw) for number in PAIRS)
