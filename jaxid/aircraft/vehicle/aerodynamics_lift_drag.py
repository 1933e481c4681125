"""Coefficients of lift, drag, side force and moments as polynomials in named signals."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.checks import require, require_known
from ..._foundation.types import Array, Float
from ...models.polynomial import Polynomial
from .aerodynamics import AbstractAerodynamics
from .aerodynamics_polynomial import PolynomialAerodynamics, coefficient_polynomial
from .force_axes import FORCE_AXES


class LiftDragAerodynamics(AbstractAerodynamics):
    """Six polynomials: lift, drag and side force in stability or wind axes, and the moments.

        CX = -CD cos(alpha) + CL sin(alpha),    CZ = -CD sin(alpha) - CL cos(alpha)

    in stability axes; in wind axes drag and crosswind force CC are also turned by the sideslip.
    The name of a parameter is coefficient and term: `CL.alpha`, `Cm.qhat`.

    Args:
        polynomials: by coefficient (CD, CY or CC, CL, Cl, Cm, Cn), as polynomials or as values by
            term; a coefficient that is absent is zero.
        axes: "stability" or "wind".
        limits: range of each signal for which the polynomials are valid [SI]; empty if unknown.

    Raises:
        InputError: for other axes, a coefficient that they do not have, or one without values by
            term.

    Source: report section 2.3.2.2; V. Klein, E. A. Morelli, Aircraft System Identification, AIAA
    2006, chapter 3.
    """

    polynomials: dict[str, Polynomial]
    axes: str = eqx.field(static=True)
    ranges: tuple[tuple[str, tuple[float, float]], ...] = eqx.field(static=True)

    transparent: ClassVar[tuple[str, ...]] = ("polynomials",)

    def __init__(
        self,
        polynomials: Mapping[str, Polynomial | Mapping[str, float]],
        axes: str = "stability",
        limits: Mapping[str, tuple[float, float]] | None = None,
    ):
        require_known("axes of the force", [axes], FORCE_AXES)
        require(
            axes != "body",
            "The axes of the force are body axes. Give `PolynomialAerodynamics` with CX, CY, CZ.",
        )
        names = FORCE_AXES[axes].coefficients
        require_known(f"aerodynamic coefficient in {axes} axes", polynomials, names)
        self.polynomials = {
            name: coefficient_polynomial(name, polynomials.get(name, {})) for name in names
        }
        self.axes, self.ranges = axes, tuple((limits or {}).items())

    def coefficients(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " coefficient"]:
        axes = FORCE_AXES[self.axes]
        values = jnp.stack([self.polynomials[name](signals) for name in axes.coefficients])
        force = axes.matrix(signals["alpha"], signals["beta"]) @ values[:3]
        return jnp.concatenate([force, values[3:]])

    @property
    def force_axes(self) -> str:
        return self.axes

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        return dict(self.ranges)

    @property
    def terms(self) -> dict[str, tuple[str, ...]]:
        return {name: polynomial.terms for name, polynomial in self.polynomials.items()}


def without_terms(axes: str) -> AbstractAerodynamics:
    """Return six polynomials without terms.

    Args:
        axes: axes of the force, "body", "stability" or "wind".
    """
    return PolynomialAerodynamics({}) if axes == "body" else LiftDragAerodynamics({}, axes)
