"""Baseline coefficients, such as tables, with polynomial increments."""

from collections.abc import Mapping
from typing import ClassVar

from ..._foundation.types import Array, Float
from ...models.table_set import common_ranges
from .aerodynamics import AbstractAerodynamics
from .aerodynamics_polynomial import PolynomialAerodynamics


class AerodynamicsWithIncrements(AbstractAerodynamics):
    """Baseline coefficients, such as wind-tunnel data, with increments estimated from flight.

        C = C_baseline + C_increments

    Parameters of the increments are named as in a polynomial, `Cm.alpha`; parameters of the
    baseline keep their names. `identify` starts at the baseline: its regression selects terms of
    the increments, and their a-priori values are zero (`IdentifyOptions(prior=...)`).

    Args:
        baseline: known coefficients, such as the tables of an airframe.
        increments: polynomials in the signals.
    """

    baseline: AbstractAerodynamics
    increments: PolynomialAerodynamics

    transparent: ClassVar[tuple[str, ...]] = ("baseline", "increments")

    def coefficients(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " coefficient"]:
        return self.baseline.coefficients(signals) + self.increments.coefficients(signals)

    def known(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " coefficient"]:
        return self.baseline.coefficients(signals)

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        return common_ranges([self.baseline.limits, self.increments.limits])

    @property
    def hard_limits(self) -> dict[str, tuple[float, float]]:
        return self.baseline.hard_limits

    @property
    def terms(self) -> dict[str, tuple[str, ...]]:
        return self.increments.terms
