"""`Columns`: the parameters that a search can estimate, one column for each: the declared free
parameters and those of its effects.
"""

from collections.abc import Collection, Sequence

import equinox as eqx

from ..effects.base import Effect
from ..models.free import Free


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
