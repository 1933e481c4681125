"""Effects of aircraft: what an aerodynamic coefficient may lack."""

import equinox as eqx

from .._foundation.types import Array, Float
from ..models.effects import Effect, zero
from ..models.polynomial import factors


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
    def terms(self):
        acting = "" if self.product == "1" else f" {self.product}"
        return tuple((state, f"{state}_per_{self.coefficient}{acting}") for state in self.moved)
