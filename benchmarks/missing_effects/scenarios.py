"""Scenarios, their planted effects and accepted names, and the interface of a system."""

import dataclasses
import zlib
from collections.abc import Callable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from benchmarks.missing_effects.truth_only import TruthEffect
from jaxid import AbstractModel, Free
from jaxid.data.record import Record
from jaxid.effects import Location
from jaxid.effects.base import Effect

KINDS = ("single", "double", "control", "process")
HARDER = "harder"  # kind of the truths in `harder`, which are counted separately
TRAIN, CHECK, TEST = 3, 2, 2  # records of each kind


class Planted(NamedTuple):
    """One effect of the truth.

    Attributes:
        effect: effect with its true values.
        places: places where a free-form disturbance would represent it.
        also: names or families of effects that these records cannot distinguish from it, with `*`
            for any characters.
    """

    effect: Effect | TruthEffect
    places: tuple[Location, ...]
    also: tuple[str, ...] = ()

    def accepts(self, name: str, family: str) -> bool:
        """Return True if a candidate counts as this effect."""
        if {name, family} & {self.effect.name, self.effect.card.family}:
            return True
        return any(fnmatchcase(one, other) for one in (name, family) for other in self.also)


@dataclasses.dataclass(frozen=True)
class Scenario:
    """A scenario of a system.

    Attributes:
        name: unique name within its system.
        kind: one of `KINDS`, or `HARDER`.
        planted: effects missing in the declared model.
        setting: deviations from the usual conditions; `fly` of each system lists its settings.
        draw: draws the planted effects; None if they are fixed.
    """

    name: str
    kind: str
    planted: tuple[Planted, ...] = ()
    setting: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    draw: Callable[[np.random.Generator], tuple[Planted, ...]] | None = None

    @property
    def effects(self) -> tuple[Effect | TruthEffect, ...]:
        """The planted effects, without their accepted names; a joint effect as its parts."""
        return tuple(
            part for one in self.planted for part in getattr(one.effect, "parts", (one.effect,))
        )

    def drawn(self, seed: int) -> "Scenario":
        """Return the scenario with the planted effects of this seed.

        They have a generator of their own, so that inputs and noise do not depend on the draw.
        """
        if self.draw is None:
            return self
        generator = np.random.default_rng([seed, zlib.crc32(self.name.encode()), 1])
        return dataclasses.replace(self, planted=self.draw(generator), draw=None)

    def generator(self, seed: int) -> np.random.Generator:
        """Return the random generator of this scenario and seed."""
        return np.random.default_rng([seed, zlib.crc32(self.name.encode())])


def planted(
    kind: type[Effect], *names, places: tuple[Location, ...], also: tuple[str, ...] = (), **values
) -> Planted:
    """Return a planted effect from its class, names and numbers.

    Args:
        kind: class of the effect.
        names: values of its fields that are names, in order.
        places, also: as in `Planted`.
        values: values of its fields that are numbers.
    """
    return Planted(
        kind(*names, **{key: jnp.array(value) for key, value in values.items()}), places, also
    )


def scenario(name: str, *effects: Planted, **setting) -> Scenario:
    """Return a scenario with one or two effects."""
    return Scenario(name, "single" if len(effects) == 1 else "double", effects, setting)


class Flown(NamedTuple):
    """Declared model, free parameters and records of a study; and the truth, for the reference.

    Attributes:
        true: true values of the free parameters that all records share, by name.
        noise: standard deviations of the outputs, for truths that the library lacks.
    """

    model: AbstractModel
    free: Free
    train: Sequence[Record]
    check: Sequence[Record]
    test: Sequence[Record]
    true: Mapping[str, float]
    noise: tuple[float, ...] = ()


class System(NamedTuple):
    """A system with its scenarios.

    Attributes:
        name: name of the system.
        cheap: True if a study takes a few seconds, so that the further controls use it.
        tables: True if its truth has table aerodynamics.
        window: samples at the start of check and test records in which the initial state is fitted.
        scenarios: all of them.
        fly: records of a scenario for a seed.
    """

    name: str
    cheap: bool
    tables: bool
    window: int
    scenarios: tuple[Scenario, ...]
    fly: Callable[[Scenario, int], Flown]

    def scenario(self, name: str) -> Scenario:
        """Return the scenario with this name."""
        return next(one for one in self.scenarios if one.name == name)
