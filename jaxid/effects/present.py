"""Groups of effects that a program skips, when it runs, if none of them is in the model."""

import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from .._foundation.types import Array, Bool
from .base import Effect

# Chosen: with small groups a program branches often; with large ones it evaluates many absent
# effects together with one that is present.
GROUP_SIZE = 16


class Group(NamedTuple):
    """Effects that are evaluated together, or skipped together.

    Attributes:
        effects: the effects.
        present: True if one of them is in the model; None if they are always evaluated.
    """

    effects: tuple[Effect, ...]
    present: Bool[Array, ""] | None

    def apply(self, function: Callable[..., Any], otherwise: Callable[..., Any], *operands: Any):
        """Return the value of `function`, or of `otherwise` if no effect is in the model.

        Args:
            function, otherwise: functions of the operands whose values have the same shapes.
            operands: arguments of both.
        """
        if self.present is None:
            return function(*operands)
        return jax.lax.cond(self.present, function, otherwise, *operands)


def groups_of(
    effects: Sequence[Effect],
    present: Bool[Array, " effect"] | None,
    chosen: Callable[[Effect], bool],
    key: Callable[[Effect], Any] | None = None,
) -> list[Group]:
    """Return some effects in groups of neighbours, in their order.

    Args:
        effects: the effects of a model.
        present: True for those in the model; None if all are.
        chosen: which effects to return.
        key: property that the members of a group share; by default they need not share any.
    """
    positions = [k for k, effect in enumerate(effects) if chosen(effect)]
    if key is None:
        size = max(1, len(positions)) if present is None else GROUP_SIZE
        groups = [positions[k : k + size] for k in range(0, len(positions), size)]
    else:
        groups = [list(own) for _, own in itertools.groupby(positions, lambda k: key(effects[k]))]
    return [_group(effects, present, group) for group in groups]


def _group(effects: Sequence[Effect], present, positions: list[int]) -> Group:
    members = tuple(effects[k] for k in positions)
    return Group(members, None if present is None else jnp.any(present[jnp.array(positions)]))


def acts_in(*slots: str) -> Callable[[Effect], bool]:
    """Return the condition that an effect implements one of some slots of `Effect`."""

    def implements(effect: Effect) -> bool:
        return any(getattr(type(effect), slot) is not getattr(Effect, slot) for slot in slots)

    return implements
