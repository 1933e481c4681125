"""Coefficients that are known from somewhere, and polynomials that correct them."""

from collections.abc import Mapping
from typing import ClassVar

from .._foundation.types import Array, Float
from .aerodynamics import AbstractAerodynamics
from .aerodynamics_polynomial import PolynomialAerodynamics


class CorrectedAerodynamics(AbstractAerodynamics):
    """What a wind tunnel says, and what a flight says otherwise: `C = C_known + C_correction`.

    A number of the correction is called as in a polynomial, `Cm.alpha`; those of what is known keep their names.

    Args:
        known: such as the tables of an airframe.
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
