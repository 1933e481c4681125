"""Known coefficients with additive polynomial corrections."""

from collections.abc import Mapping
from typing import ClassVar

from ..._foundation.types import Array, Float
from .aerodynamics import AbstractAerodynamics
from .aerodynamics_polynomial import PolynomialAerodynamics


class TablesWithPolynomials(AbstractAerodynamics):
    """Known coefficients, such as wind-tunnel data, with corrections estimated from flight: `C =
    C_known + C_correction`.

    Parameters of the correction are named as in a polynomial, `Cm.alpha`; parameters of the known
    coefficients keep their names.

    Args:
        known: known coefficients, such as the tables of an airframe.
        correction: polynomials in the signals.
    """

    known: AbstractAerodynamics
    correction: PolynomialAerodynamics

    transparent: ClassVar[tuple[str, ...]] = ("known", "correction")

    def coefficients(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " coefficient"]:
        return self.known.coefficients(signals) + self.correction.coefficients(signals)

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        return self.known.limits

    @property
    def refuses(self) -> dict[str, tuple[float, float]]:
        return self.known.refuses

    @property
    def terms(self) -> dict[str, tuple[str, ...]]:
        return self.correction.terms
