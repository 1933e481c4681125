"""Effects of aircraft: what an aerodynamic coefficient may lack."""

import dataclasses
from collections.abc import Mapping

import equinox as eqx

from .._foundation.types import Array, Float
from ..models.effects import Effect, zero
from ..models.polynomial import factors, next_powers

SYMMETRIC = (
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
LATERAL = (
    *("1", "beta", "phat", "rhat", "aileron", "rudder", "alpha beta", "alpha phat", "alpha rhat", "alpha aileron"),
    *("alpha rudder", "alpha^2 beta", "beta^3", "beta qhat", "aileron^3", "rudder^3"),
)
LACKING = {  # terms in the spirit of Table 6.1: even in the lateral signals for symmetric coefficients, odd for the others
    **dict.fromkeys(("CX", "CZ", "Cm"), SYMMETRIC),
    **dict.fromkeys(("CY", "Cl", "Cn"), LATERAL),
}


class CoefficientTerm(Effect):
    """A monomial in one aerodynamic coefficient: `C += gain * product`.

        d(state)/dt += state_per_C gain product        for each state that the coefficient moves

    The model's `signals` give what stands before the gain, as `w_per_CZ` and so on: `qbar S/m` in a force equation, a row of
    `qbar S I^-1 diag(b, cbar, b)` in a moment equation.

    Args:
        coefficient: "CX" to "Cn".
        product: a product of powers of the model's signals, such as `"alpha^2 qhat"`.
        moved: the states that the coefficient moves.
        gain: the coefficient of the term [per radian, for each angle or reduced rate in it].
    """

    coefficient: str = eqx.field(static=True)
    product: str = eqx.field(static=True)
    moved: tuple[str, ...] = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"{self.product} in {self.coefficient}"

    @property
    def place(self):
        return f"coefficient {self.coefficient}"

    @property
    def sentence(self):
        what = "a constant" if self.product == "1" else self.product
        return f"{what} in the aerodynamic coefficient {self.coefficient}"

    @property
    def complexity(self):
        return max(1, sum(power for _, power in factors(self.product)))

    @property
    def signals_used(self):
        return tuple(sorted({signal for signal, _ in factors(self.product)}))

    @property
    def terms(self):
        acting = "" if self.product == "1" else f" {self.product}"
        return tuple((state, f"{state}_per_{self.coefficient}{acting}") for state in self.moved)

    def kin(self):
        return tuple(dataclasses.replace(self, product=one, gain=zero()) for one in next_powers(self.product))


def lacking_terms(
    own: Mapping[str, tuple[str, ...]], moved: Mapping[str, tuple[str, ...]]
) -> tuple[CoefficientTerm, ...]:
    """Terms that the coefficients may lack beside those they have: `beta^2 in Cm` and so on.

    Args:
        own: the terms that each coefficient has.
        moved: the states that each coefficient moves; one that is not named gets no candidates.
    """
    return tuple(
        CoefficientTerm(coefficient=coefficient, product=product, moved=moved[coefficient])
        for coefficient, products in LACKING.items()
        for product in products
        if coefficient in moved and product not in own.get(coefficient, ())
    )
