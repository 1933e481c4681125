"""`Columns`: the parameters that a search can estimate, one column for each: the declared free
parameters and those of its effects; `Padding`: further columns without effect.
"""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import equinox as eqx
import numpy as np

from .._foundation.host import to_device
from .._foundation.types import Array
from ..effects.base import Effect
from ..models.free import Free

# Chosen: parameters of effects are padded to multiples of this, so that few widths are compiled.
# More padding costs arithmetic, less costs compilations.
COLUMN_BLOCK = 8
# The same for the initial values of states that effects add (chosen).
ROW_BLOCK = 2


class Columns:
    """The columns of a search. The columns of the per-record parameters precede them.

    Attributes:
        declared: number of the declared parameters.
        names: dotted, the declared parameters first.
        index: the column of each name.
        of_effect: names of the estimated parameters of each effect, its gain first
            (`own_parameters`).
        owners: the effect of each column that belongs to one, by the column's name.

    Args:
        free: free parameters of the declared model.
        effects: the library.
    """

    def __init__(self, free: Free, effects: Sequence[Effect]):
        self.declared = len(free.shared)
        self.of_effect = {effect.name: own_parameters(effect) for effect in effects}
        self.owners = {own: name for name, names in self.of_effect.items() for own in names}
        self.names = (*free.shared, *self.owners)
        self.index = {name: column for column, name in enumerate(self.names)}

    def chosen(self, effects: Collection[str]) -> list[int]:
        """Return the columns of the declared parameters and of the parameters of `effects`."""
        own = [self.index[name] for effect in effects for name in self.of_effect[effect]]
        return [*range(self.declared), *own]


def own_parameters(effect: Effect) -> tuple[str, ...]:
    """Return the dotted names of the parameters of an effect that are estimated when it is in the
    model, its gain first.
    """
    known = {"gain", *effect.card.fixed, *effect.card.by_record}
    shape = [name for name in effect.__dataclass_fields__ if name not in known]
    shape = [name for name in shape if eqx.is_inexact_array(getattr(effect, name))]
    return tuple(f"{effect.name}.{field}" for field in ("gain", *shape))


class Padding(NamedTuple):
    """Numbers of parameters of a problem, and of its program, in which the padding stands last, so
    that hypotheses of similar size share a program.

    Attributes:
        own: number of per-record parameters.
        own_width: the same with padding.
        shared: number of shared parameters.
        shared_width: the same with padding.
    """

    own: int
    own_width: int
    shared: int
    shared_width: int

    def padded_own(self, values, fill: int | float = 0) -> Array:
        """Return values of the per-record parameters, along the last axis, with padding."""
        return to_device(_filled(values, self.own_width - self.own, fill))

    def padded_shared(self, values, fill: int | float = 0) -> Array:
        """Return values of the shared parameters, along the last axis, with padding."""
        return to_device(_filled(values, self.shared_width - self.shared, fill))

    def padded_columns(self, columns) -> Array:
        """Return columns of all parameters, the per-record ones first, with columns of zeros."""
        own, shared = np.split(np.asarray(columns), [self.own], axis=-1)
        own = _filled(own, self.own_width - self.own, 0)
        shared = _filled(shared, self.shared_width - self.shared, 0)
        return to_device(np.concatenate([own, shared], axis=-1))


def padded_number(number: int, block: int, least: int = 1) -> int:
    """Return a number rounded up to a multiple of a block, at least `least` blocks."""
    return block * max(least, -(-number // block))


def _filled(values, number: int, fill: int | float) -> np.ndarray:
    """Return values with a number of others behind the last."""
    values = np.asarray(values)
    widths = [(0, 0)] * (values.ndim - 1) + [(0, number)]
    return np.pad(values, widths, constant_values=fill)
