"""Default library of candidate effects of a study, and its checks."""
# Pyright counts equinox's abstract fields as arguments of the constructor.
# pyright: reportCallIssue=false

from collections.abc import Sequence

import numpy as np

from .._foundation.checks import require
from .._foundation.grid import is_uniform
from ..data.record import Record
from ..effects.augmented import absent_effects, split_effects
from ..effects.base import Effect
from ..effects.library import general_effects, uncertain_equations
from ..effects.parameter import ParameterDrift, not_free
from ..models.base import AbstractModel, canonical
from ..models.free import Free


def candidates(model: AbstractModel, free: Free, *records: Record) -> tuple[Effect, ...]:
    """Return the default library: general effects, those of the model, and parameter drifts.

    Args:
        model: the declared model.
        free: its free parameters, each with a drift among the candidates.
        records: all records that are fitted or predicted; if one of them is sampled unevenly, no
            input can be band-limited.
    """
    equations = model.equations_with_terms()
    if equations is None:
        equations = uncertain_equations(canonical(model), np.asarray(free.positions(model).shared))
    general = general_effects(
        model, equations, uniform=all(is_uniform(np.asarray(stacked.t)) for stacked in records)
    )
    own = absent_effects(model, (*general, *model.effects()))
    known, units = {effect.name for effect in own}, model.units()
    drifts = (ParameterDrift(name, unit=units.get(name, "")) for name in free.shared)
    others = absent_effects(model, (drift for drift in drifts if drift.name not in known))
    return not_free((*own, *others), free.shared + free.per_record)


def require_absent(library: Sequence[Effect], model: AbstractModel) -> None:
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
            "Leave "
            "its gain out. An effect known to be present belongs in the model: "
            "Augmented(model, (effect,)).",
        )
