"""Coefficients as polynomials in named signals."""

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.checks import require_known
from ..._foundation.types import Array, Float
from ...models.polynomial import Polynomial
from .aerodynamics import COEFFICIENTS, AbstractAerodynamics


class PolynomialAerodynamics(AbstractAerodynamics):
    """Six polynomials, one for each coefficient, with terms of Table 3.1 or any others (Eq. 3.9).

    The name of a parameter is coefficient and term: `Cm.alpha^2`, `Cn.beta alpha`.

    Args:
        polynomials: by coefficient, as polynomials or as values by term; a coefficient that is
            absent is zero.
        limits: range of each signal for which the polynomials are valid [SI]; empty if unknown.

    Raises:
        InputError: when a coefficient is not one of the six.
    """

    CX: Polynomial
    CY: Polynomial
    CZ: Polynomial
    Cl: Polynomial
    Cm: Polynomial
    Cn: Polynomial
    ranges: tuple[tuple[str, tuple[float, float]], ...] = eqx.field(static=True)

    def __init__(
        self,
        polynomials: Mapping[str, Polynomial | Mapping[str, float]],
        limits: Mapping[str, tuple[float, float]] | None = None,
    ):
        require_known("aerodynamic coefficient", polynomials, COEFFICIENTS)
        for name in COEFFICIENTS:
            given = polynomials.get(name, {})
            setattr(self, name, given if isinstance(given, Polynomial) else Polynomial(given))
        self.ranges = tuple((limits or {}).items())

    def coefficients(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " coefficient"]:
        return jnp.stack([getattr(self, name)(signals) for name in COEFFICIENTS])

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        return dict(self.ranges)

    @property
    def terms(self) -> dict[str, tuple[str, ...]]:
        return {name: getattr(self, name).terms for name in COEFFICIENTS}
