"""What is planted, what counts as finding it, and what a system hands over."""

import dataclasses
import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxid import AbstractModel, Free
from jaxid.data.record import Record
from jaxid.models.effects import Effect

KINDS = ("single", "double", "control", "process")
TRAIN, CHECK, TEST = 3, 2, 2  # records of each kind
Place = tuple[str, str]  # kind and name, as in `jaxid.diagnosis.Where`


class Planted(NamedTuple):
    """One effect of the truth.

    Attributes:
        effect: with its true values.
        places: where a free-form disturbance would stand for it.
        also: names or families of effects that are the same to these records.
    """

    effect: Effect
    places: tuple[Place, ...]
    also: tuple[str, ...] = ()

    def accepts(self, name: str, family: str) -> bool:
        """Whether a candidate counts as this effect."""
        return bool({name, family} & {self.effect.name, self.effect.family, *self.also})


@dataclasses.dataclass(frozen=True)
class Scenario:
    """One situation.

    Attributes:
        name: unique within its system.
        kind: one of `KINDS`.
        planted: what is missing in the declared model.
        setting: how it is flown otherwise than usually; each system says what it knows.
    """

    name: str
    kind: str
    planted: tuple[Planted, ...] = ()
    setting: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """What is planted, without what counts as finding it."""
        return tuple(one.effect for one in self.planted)

    def generator(self, seed: int) -> np.random.Generator:
        """Random numbers of their own for each scenario and seed."""
        return np.random.default_rng([seed, zlib.crc32(self.name.encode())])


def planted(kind: type[Effect], *names, places: tuple[Place, ...], also: tuple[str, ...] = (), **values) -> Planted:
    """An effect from its class, its names and its numbers.

    Args:
        kind: of effect.
        names: its fields that are names, in order.
        places, also: as in `Planted`.
        values: its fields that are numbers.
    """
    return Planted(kind(*names, **{key: jnp.array(value) for key, value in values.items()}), places, also)


def scenario(name: str, *effects: Planted, **setting) -> Scenario:
    """A scenario with one effect, or with two."""
    return Scenario(name, "single" if len(effects) == 1 else "double", effects, setting)


class Flown(NamedTuple):
    """What a study is given: declared model, free parameters and records; and the truth, for the reference.

    Attributes:
        true: true values of the free parameters that all records share, by name.
    """

    model: AbstractModel
    free: Free
    train: Sequence[Record]
    check: Sequence[Record]
    test: Sequence[Record]
    true: Mapping[str, float]


class System(NamedTuple):
    """A system with its scenarios.

    Attributes:
        name: of the system.
        cheap: whether a study takes a few seconds, so that the many controls are drawn over it.
        tables: whether its truth has table aerodynamics.
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
        """A scenario by its name."""
        return next(one for one in self.scenarios if one.name == name)
