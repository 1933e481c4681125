"""Effects of aircraft: a coefficient that depends on more of the flow than declared, and the ground."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Float
from ..models.acting import Acting, ActingEffect
from ..models.effects import zero
from ..models.polynomial import factors, monomials


def in_coefficient(coefficient: str, moved: Sequence[str]) -> Acting:
    """How a scalar acts in an aerodynamic coefficient.

        d(state)/dt += state_per_C scalar        for each state that the coefficient moves

    Args:
        coefficient: "CX" to "Cn".
        moved: the states that it moves; the model's `signals` say by how much, as `w_per_CZ` and so on.
    """
    return Acting(coefficient, tuple((state, f"{state}_per_{coefficient}") for state in moved))


class CoefficientGradient(ActingEffect):
    """A term of a coefficient that varies with another signal, such as Mach: `C += gain product (signal - centre)`.

    The centre is the signal's mean on the training records, so that the effect is no constant part of the term.

    Args:
        acting: in which coefficient, `in_coefficient("CZ", ("w", "p", "q", "r"))`.
        signal: with what it varies: `mach`, `altitude` [m], `qbar` [Pa].
        product: a product of powers of the model's signals, such as `"alpha"`, or "1".
        gain: rise of the term's coefficient with the signal [per unit of the signal].
    """

    acting: Acting = eqx.field(static=True)
    signal: str = eqx.field(static=True)
    product: str = eqx.field(static=True, default="1")
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    centre: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"{self.product} varying with {self.signal} in {self.acting.name}"

    @property
    def sentence(self):
        what = "the constant" if self.product == "1" else f"what {self.product} does"
        return f"{what} in the aerodynamic coefficient {self.acting.name} varies with {self.signal}"

    @property
    def complexity(self):
        return 1 + sum(power for _, power in factors(self.product))

    @property
    def fixed(self):
        return ("centre",)

    def start(self, signals, measured, step):
        return eqx.tree_at(lambda effect: effect.centre, self, jnp.asarray(np.mean(signals[self.signal])))

    def scalar(self, signals):
        return monomials((self.product,), signals)[0] * (signals[self.signal] - self.centre)


class GroundEffect(ActingEffect):
    """What the ground does to a coefficient near it: `C += gain / (1 + (16 h/b)^2)`, h the height above the ground.

    The gain is the change on the ground itself. The function is one less the factor on induced drag of McCormick,
    Aerodynamics, Aeronautics and Flight Mechanics, Wiley 1979, chapter 7.

    Args:
        acting: in which coefficient.
        ground: altitude of the ground [m].
        b: span [m].
        gain: change of the coefficient on the ground.
    """

    acting: Acting = eqx.field(static=True)
    ground: float = eqx.field(static=True)
    b: float = eqx.field(static=True)
    signal: str = eqx.field(static=True, default="altitude")
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"ground effect in {self.acting.name}"

    @property
    def sentence(self):
        return f"the nearness of the ground changes the aerodynamic coefficient {self.acting.name}"

    def scalar(self, signals):
        return 1.0 / (1.0 + (16.0 * (signals[self.signal] - self.ground) / self.b) ** 2)
