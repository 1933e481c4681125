"""`Fitted`: a fit of the declared parameters and of some effects."""

import equinox as eqx
import numpy as np

from .._foundation.types import Float
from ..estimation.estimate import Fit


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

    @property
    def information(self) -> Float[np.ndarray, "row parameter"]:
        """Factor of the information on the free parameters, without the padding columns."""
        factor = np.asarray(self.fit.information.factor)[:, : len(self.columns)]
        return np.linalg.qr(factor, mode="r")
