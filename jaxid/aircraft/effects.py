"""Effects of aircraft: what an aerodynamic coefficient may lack."""

import equinox as eqx

from .._foundation.types import Array, Float
from ..models.effects import Effect, zero
from ..models.polynomial import factors

ACTS_ON = {
    "CX": ("u", "force_per_coefficient"),
    "CZ": ("w", "force_per_coefficient"),
    "Cm": ("q", "moment_per_coefficient"),
}


class CoefficientTerm(Effect):
    """A monomial in one aerodynamic coefficient: `C += gain * product`.

        udot += qbar S/m gain product            in CX
        wdot += qbar S/m gain product            in CZ
        qdot += qbar S cbar/Iy gain product      in Cm

    The model's `signals` give what stands before the gain, as `force_per_coefficient` and `moment_per_coefficient`.

    Args:
        coefficient: "CX", "CZ" or "Cm".
        product: a product of powers of the model's signals, such as `"alpha^2 qhat"`.
        gain: the coefficient of the term [per radian, for each angle or reduced rate in it].
    """

    coefficient: str = eqx.field(static=True)
    product: str = eqx.field(static=True)
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
    def term(self):
        state, scale = ACTS_ON[self.coefficient]
        return state, scale if self.product == "1" else f"{scale} {self.product}"
