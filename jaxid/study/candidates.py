"""Default library of candidate effects of a study."""
# Pyright counts equinox's abstract fields as arguments of the constructor.
# pyright: reportCallIssue=false

from collections.abc import Sequence

import numpy as np

from .._foundation.grid import is_uniform_by_record
from .._foundation.notebook import Table
from ..data.record import Record
from ..effects.augmented import absent_effects
from ..effects.base import Effect
from ..effects.library import general_effects, uncertain_equations
from ..effects.parameter import ParameterDrift, not_free
from ..models.base import AbstractModel, canonical
from ..models.free import Free


def candidate_table(effects: Sequence[Effect]) -> Table:
    """Return candidates with their families, places and descriptions in words.

    Args:
        effects: the candidates.
    """
    cards = [effect.card for effect in effects]
    rows = [(card.name, card.family, str(card.location), card.description) for card in cards]
    family, place = (max((len(row[column]) for row in rows), default=0) + 1 for column in (1, 2))
    return Table(("candidate", "family", "place", "description"), (9, family, place), tuple(rows))


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
    uniform = all(is_uniform_by_record(np.asarray(stacked.t)) for stacked in records)
    chosen = free.shared + free.per_record
    general = general_effects(model, equations, free=chosen, uniform=uniform)
    own = absent_effects(model, (*general, *model.effects()))
    known, units = {effect.card.family for effect in own}, model.units()
    drifts = (ParameterDrift(name, unit=units.get(name, "")) for name in free.shared)
    others = absent_effects(model, (drift for drift in drifts if drift.card.family not in known))
    return not_free((*own, *others), chosen)
