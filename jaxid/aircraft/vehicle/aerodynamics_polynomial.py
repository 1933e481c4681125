"""Coefficients as polynomials in named signals."""

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.checks import require, require_known
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
        InputError: when a coefficient is not one of the six, or has no values by term.
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
            setattr(self, name, coefficient_polynomial(name, polynomials.get(name, {})))
        self.ranges = tuple((limits or {}).items())

    def coefficients(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " coefficient"]:
        return jnp.stack([getattr(self, name)(signals) for name in COEFFICIENTS])

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        return dict(self.ranges)

    @property
    def terms(self) -> dict[str, tuple[str, ...]]:
        return {name: getattr(self, name).terms for name in COEFFICIENTS}


def coefficient_polynomial(name: str, given: Polynomial | Mapping[str, float]) -> Polynomial:
    """Return a coefficient as a polynomial.

    Args:
        name: name of the coefficient.
        given: the polynomial, or values by term.

    Raises:
        InputError: when it is neither.
    """
    if isinstance(given, Polynomial):
        return given
    require(
        isinstance(given, Mapping),
        f"The coefficient {name} is {given!r}; give values by term, such as {{'1': 0.03}}.",
    )
    return Polynomial(given)
