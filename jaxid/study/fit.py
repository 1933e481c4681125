"""`Fitted`: a fit of the declared parameters and of some effects; the rule for continuing a fit."""

import equinox as eqx
import numpy as np

from .._foundation.types import Float
from ..estimation.estimate import Fit
from .thresholds import MAX_CONTINUATIONS, MIN_COST_FALL


class Fitted(eqx.Module):
    """A fit of the declared parameters and of some effects.

    Attributes:
        effects: names of the effects in the model.
        values: values of all columns; zero gains and starting shapes for absent effects.
        fit: result of the solver, in the order of `columns`, padded.
        columns: the columns that were free.
    """

    effects: tuple[str, ...] = eqx.field(static=True)
    values: Float[np.ndarray, " column"]
    fit: Fit
    columns: tuple[int, ...] = eqx.field(static=True)

    @property
    def cost(self) -> float:
        """Negative log-likelihood."""
        return float(self.fit.cost)


def worth_continuing(costs: list[float], creeping: float) -> bool:
    """Return True if a fit that its iteration limit stopped should be continued.

    Args:
        costs: cost after the first run and after each continuation so far.
        creeping: share of the fall of all continuations; a continuation that brings less is the
            last.
    """
    if len(costs) > MAX_CONTINUATIONS:
        return False
    if len(costs) < 2:
        return True  # no fall is known yet
    fall, total = costs[-2] - costs[-1], costs[0] - costs[-1]
    return fall > max(MIN_COST_FALL, creeping * total)
