"""Effects of aircraft: missing terms of the aerodynamic coefficients."""

import dataclasses
from collections.abc import Mapping

import equinox as eqx

from ..._foundation.location import Location, LocationKind
from ..._foundation.types import Array, Float
from ...effects.base import Effect, zero
from ...effects.card import EffectCard
from ...models.polynomial import factors, next_powers
from ..vehicle.force_axes import with_axes

SYMMETRIC_PRODUCTS = (
    *(
        "1",
        "alpha",
        "qhat",
        "stabilator",
        "alpha^2",
        "alpha qhat",
        "alpha stabilator",
        "beta^2",
        "alpha^3",
        "alpha beta^2",
    ),
    *("phat^2", "rhat^2", "stabilator^2"),
)
LATERAL_PRODUCTS = (
    *(
        "1",
        "beta",
        "phat",
        "rhat",
        "aileron",
        "rudder",
        "alpha beta",
        "alpha phat",
        "alpha rhat",
        "alpha aileron",
    ),
    *("alpha rudder", "alpha^2 beta", "beta^3", "beta qhat", "aileron^3", "rudder^3"),
)
# chosen after Table 6.1: even in the lateral signals for the symmetric coefficients, odd for the
# others
CANDIDATE_PRODUCTS = {
    **dict.fromkeys(("CX", "CZ", "Cm", "CD", "CL"), SYMMETRIC_PRODUCTS),
    **dict.fromkeys(("CY", "Cl", "Cn", "CC"), LATERAL_PRODUCTS),
}


class CoefficientTerm(Effect):
    """A monomial in an aerodynamic coefficient: `coefficient += gain * product`.

        d(state)/dt += state_per_C gain product    for each state whose rate the coefficient changes

    The factors `state_per_C`, such as `w_per_CZ`, are among the model's `signals`: `qbar S/m` in a
    force equation, a row of `qbar S I^-1 diag(b, cbar, b)` in a moment equation.

    Args:
        coefficient: "CX" to "Cn" in body axes; "CD", "CC", "CL" in a model with these forces.
        product: a product of powers of the model's signals, such as `"alpha^2 qhat"`.
        affected_states: the states whose rates the coefficient changes.
        gain: the coefficient of the term [per radian, for each angle or reduced rate in it].
    """

    coefficient: str = eqx.field(static=True)
    product: str = eqx.field(static=True)
    affected_states: tuple[str, ...] = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        term = "a constant" if self.product == "1" else self.product
        return EffectCard(
            name=f"{self.product} in {self.coefficient}",
            description=f"{term} in the aerodynamic coefficient {with_axes(self.coefficient)}",
            location=Location(LocationKind.COEFFICIENT, self.coefficient),
            signals=tuple(sorted({signal for signal, _ in factors(self.product)})),
            complexity=max(1, sum(power for _, power in factors(self.product))),
        )

    @property
    def terms(self):
        suffix = "" if self.product == "1" else f" {self.product}"
        return tuple(
            (state, f"{state}_per_{self.coefficient}{suffix}") for state in self.affected_states
        )

    def neighbouring_shapes(self):
        return tuple(
            dataclasses.replace(self, product=product, gain=zero())
            for product in next_powers(self.product)
        )


def absent_terms(
    declared: Mapping[str, tuple[str, ...]], affected: Mapping[str, tuple[str, ...]]
) -> tuple[CoefficientTerm, ...]:
    """Return candidate terms that the coefficients do not have yet, `beta^2 in Cm` and so on.

    Args:
        declared: terms of the model by coefficient.
        affected: states whose rates each coefficient changes; a coefficient that is not named gets
            no candidates.
    """
    return tuple(
        CoefficientTerm(
            coefficient=coefficient, product=product, affected_states=affected[coefficient]
        )
        for coefficient, products in CANDIDATE_PRODUCTS.items()
        for product in products
        if coefficient in affected and product not in declared.get(coefficient, ())
    )
