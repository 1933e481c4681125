"""`check_candidates`: refuse candidate effects that do not fit a model."""

from collections.abc import Sequence

from .._foundation.checks import InputError, require, require_known
from .._foundation.location import LocationKind
from ..models.base import AbstractModel, equations_of
from ..models.equation_shapes import check_equations
from .augmented import Augmented, split_effects
from .base import Effect
from .input import CommonInputEffect

EXAMPLE = "such as `jaxid.effects.DryFriction('v', 'v')`"


def check_candidates(model: AbstractModel, effects: Sequence[Effect]) -> None:
    """Refuse objects that are no effects, and effects of channels or signals that the model lacks.

    The equations are evaluated in the abstract: nothing is compiled.

    Args:
        model: the declared model.
        effects: candidates for its missing effects.

    Raises:
        InputError: it names the effect and the channel, and lists the model's channels.
    """
    channels = {
        LocationKind.EQUATION: equations_of(model),
        LocationKind.INPUT: model.inputs,
        LocationKind.SENSOR: model.outputs,
    }
    for effect in effects:
        require(
            isinstance(effect, Effect),
            f"The candidate {effect!r} is not an effect. Give an object, {EXAMPLE}; "
            "`jaxid.effects.general_effects(model)` is the default.",
        )
    check_absent(effects, model)
    for effect in effects:
        location = effect.card.location
        if location.kind in channels:
            kind = f"{location.kind.label} of the model, named by the candidate {effect.name!r},"
            require_known(kind, [location.name], channels[location.kind])
        delay, fields = effect.card.delay, effect.__dataclass_fields__
        delayed = location.kind in (LocationKind.INPUT, LocationKind.SENSOR) and delay in fields
        require(
            not delay or delayed,
            f"The candidate {effect.name!r} has {delay!r} as `delay` of its card. Give the name of "
            "one of its parameters, of an effect at an input or a sensor, or leave `delay` out.",
        )
        if isinstance(effect, CommonInputEffect):
            kind = f"input of the model, named by the candidate {effect.name!r},"
            require_known(kind, effect.channels, model.inputs)
    _check_equations_with(model, effects)


def _check_equations_with(model: AbstractModel, effects: Sequence[Effect]) -> None:
    """Refuse an effect with which the equations cannot be evaluated.

    All effects together first, as each evaluation takes a tenth of a second on an aircraft; one by
    one only to name the effect that fails.
    """
    try:
        check_equations(Augmented(model, tuple(effects)))
        return
    except InputError:
        pass
    for effect in effects:
        try:
            check_equations(Augmented(model, (effect,)))
        except InputError as error:
            raise InputError(f"The candidate {effect.name!r}: {error}") from error


def check_absent(library: Sequence[Effect], model: AbstractModel) -> None:
    """Refuse candidates that the declared model already holds, or whose gain is not zero."""
    known = {effect.name for effect in split_effects(model)[1]}
    for effect in library:
        require(
            effect.name not in known,
            f"The declared model holds {effect.name!r} already. Leave this candidate out.",
        )
        gain = float(effect.gain)
        require(
            gain == 0.0,
            f"The candidate {effect.name!r} has a gain of {gain:g}; a candidate starts absent. "
            "Leave its gain out. An effect known to be present belongs in the model: "
            "Augmented(model, (effect,)).",
        )
