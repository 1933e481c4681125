"""Candidate effects of an identification model: those that change its motion or its outputs."""

from collections.abc import Collection, Mapping

from ...effects.base import Effect
from ...models.base import AbstractModel, canonical
from ...models.names import parameter_names
from ..effects.coefficient_term import absent_terms
from ..effects.library import default_effects
from ..instruments.channels import RATES
from .channels import Channels

STATES_OF: Mapping[
    str, tuple[str, ...]
] = {  # states that determine a factor of a term, in either frame
    "alpha": ("w", "alpha"),
    "beta": ("v", "beta"),
    **{f"{rate}hat": (rate,) for rate in RATES},
}
LATERAL_PARAMETERS = ("Ix", "Iz", "Ixz", "reference.y")  # they act in roll and yaw only
LATERAL_ENGINE_PARAMETERS = ("position.y", "momentum")


def effects_of(
    model: AbstractModel, channels: Channels, terms: Mapping[str, tuple[str, ...]]
) -> tuple[Effect, ...]:
    """Return candidate terms of the propagated coefficients, and an aircraft's default effects.

    The terms are in the axes of the model, the default effects of forces in body axes. Terms of
    signals that are held constant, and effects on parameters that no output depends on, are left
    out.

    Args:
        model: model whose parameters and signals the effects act on.
        channels: channels of the model.
        terms: terms of the model by coefficient.
    """
    affected = {name: channels.affected(name) for name in channels.responses}
    absent = absent_terms(terms, affected)
    in_body_axes = channels._replace(axes="body")
    affected = {name: in_body_axes.affected(name) for name in in_body_axes.responses}
    names = tuple(
        name for name in parameter_names(canonical(model)) if _has_influence(name, channels)
    )
    every = (*absent, *default_effects(canonical(model), affected, names))
    return tuple(one for one in every if not _is_constant(one.card.signals, channels.held))


def _is_constant(factors: tuple[str, ...], held: Collection[str]) -> bool:
    """Return True if a factor of a term is constant."""
    return any(name in held for factor in factors for name in STATES_OF.get(factor, (factor,)))


def _has_influence(name: str, channels: Channels) -> bool:
    """Return True if the motion or an output depends on a parameter."""
    part, _, entry = name.partition(".")
    if part == "instruments":
        return entry.split(".")[1] in channels.outputs
    lateral = name in LATERAL_PARAMETERS or (
        part == "engines" and name.endswith(LATERAL_ENGINE_PARAMETERS)
    )
    return not (lateral and {"p", "r"} <= set(channels.held))
