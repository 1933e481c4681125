"""`Columns`: the parameters that a search can estimate, one column for each: the declared free
parameters and those of its effects.
"""

from collections.abc import Sequence

import equinox as eqx
import numpy as np

from .._foundation.host import to_device
from .._foundation.types import Array, Bool
from ..effects.base import Effect
from ..estimation.limits import Limits
from ..models.free import Free, Parameters


class Columns:
    """The columns of a search. The columns of the per-record parameters precede them.

    Attributes:
        names: dotted, the declared parameters first.
        index: the column of each name.
        own: names of the parameters of each effect that are estimated when it is in the model, its
            gain first.
        gains: the column of each effect's gain.
        owners: the effect of each column that belongs to one, by the column's name.
        lower, upper: bounds.

    Args:
        free: free parameters of the declared model.
        effects: the library.
    """

    def __init__(self, free: Free, effects: Sequence[Effect]):
        self.free, self.declared = free, len(free.shared)
        self.own = {effect.name: own_parameters(effect) for effect in effects}
        self.names = free.shared + tuple(name for own in self.own.values() for name in own)
        self.index = {name: column for column, name in enumerate(self.names)}
        self.gains = {name: self.index[own[0]] for name, own in self.own.items()}
        self.owners = {own: effect for effect, names in self.own.items() for own in names}
        self.bound(effects)

    def bound(self, effects: Sequence[Effect]) -> None:
        """Set the bounds; the bounds of an effect may depend on its shape."""
        extra = np.full(len(self.names) - self.declared, np.inf)
        self.lower, self.upper = (
            np.r_[np.asarray(own), sign * extra]
            for own, sign in zip(self.free.bounds("shared"), (-1, 1), strict=True)
        )
        for effect in effects:
            for field, (low, high) in effect.card.bounds.items():
                column = self.index[f"{effect.name}.{field}"]
                self.lower[column], self.upper[column] = low, high

    def chosen(self, effects: Sequence[str]) -> list[int]:
        """Return the columns of the declared parameters and of the parameters of `effects`."""
        return [*range(self.declared), *self.of(effects)]

    def of(self, effects: Sequence[str]) -> list[int]:
        """Return the columns of the parameters of `effects`."""
        return [self.index[own] for effect in effects for own in self.own[effect]]

    def marked(self, columns: Sequence[int]) -> Bool[Array, " column"]:
        """Return a mask that is True at `columns`."""
        marked = np.zeros(len(self.names), bool)
        marked[np.array(columns, int)] = True
        return to_device(marked)

    def same_named(self, first: str, other: str) -> tuple[tuple[int, int], ...]:
        """Return the pairs of columns of the parameters that two effects have under one name."""
        fields = (name.removeprefix(f"{first}.") for name in self.own[first])
        pairs = ((f"{first}.{field}", f"{other}.{field}") for field in fields)
        return tuple(
            (self.index[mine], self.index[theirs]) for mine, theirs in pairs if theirs in self.index
        )

    def limits(self, chosen: Sequence[int], padding: int, n_cases: int) -> Limits:
        """Return bounds, scales and priors of the chosen columns, their padding, and the per-record
        parameters.

        Args:
            chosen: columns.
            padding: number of padding columns, which have no effect.
            n_cases: number of records.
        """
        free = self.free
        own = Limits.of(Free((), free.per_record, free.lower, free.upper), n_cases)
        declared = Limits.of(Free(free.shared, (), {}, {}, free.scale, free.prior), n_cases)

        def wide(vector, fill):
            """Return the chosen entries of a vector over the declared parameters, padded.

            The vector is first extended to all columns by `fill`.
            """
            extended = np.r_[np.asarray(vector), np.full(len(self.names) - len(vector), fill)]
            return to_device(np.r_[extended[[*chosen]], np.full(padding, fill)])

        pad = np.full(padding, np.inf)
        return Limits(
            Parameters(to_device(np.r_[self.lower[[*chosen]], -pad]), own.lower.rows),
            Parameters(to_device(np.r_[self.upper[[*chosen]], pad]), own.upper.rows),
            wide(declared.scale, np.nan),
            wide(declared.prior_mean, 0.0),
            wide(declared.prior_deviation, np.inf),
        )


def own_parameters(effect: Effect) -> tuple[str, ...]:
    """Return the dotted names of the parameters of an effect that are estimated when it is in the
    model, its gain first.
    """
    fields = [
        name for name in effect.__dataclass_fields__ if eqx.is_inexact_array(getattr(effect, name))
    ]
    fields = [
        "gain",
        *(name for name in fields if name != "gain" and name not in effect.card.fixed),
    ]
    return tuple(f"{effect.name}.{field}" for field in fields)
