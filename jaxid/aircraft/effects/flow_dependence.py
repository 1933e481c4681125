"""Effects of aircraft: dependence of a coefficient on further flow variables, ground effect."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..._foundation.types import Array, Float
from ...effects.base import zero
from ...effects.card import EffectCard
from ...effects.placement import AS_CUBIC, Placement, ScalarEffect
from ...models.polynomial import factors, monomials
from ..vehicle.force_axes import with_axes


def in_coefficient(coefficient: str, affected: Sequence[str]) -> Placement:
    """Return the placement of a scalar effect in an aerodynamic coefficient.

        d(state)/dt += state_per_C scalar        for each state whose rate the coefficient changes

    Args:
        coefficient: "CX" to "Cn".
        affected: states whose rates the coefficient changes; the factors `w_per_CZ` and so on are
            among the model's `signals`.
    """
    return Placement(
        coefficient, tuple((state, f"{state}_per_{coefficient}") for state in affected)
    )


class CoefficientGradient(ScalarEffect):
    """Variation of a term of a coefficient with another signal, such as Mach.

        C += gain product (signal - centre)

    The centre is the mean of the signal on the training records, so that the effect is not
    confounded with the constant part of the term.

    Args:
        placement: in which coefficient, `in_coefficient("CZ", ("w", "p", "q", "r"))`.
        signal: signal with which the term varies: `mach`, `altitude` [m], `qbar` [Pa].
        product: a product of powers of the model's signals, such as `"alpha"`, or "1".
        gain: slope of the term's coefficient with the signal [per unit of the signal].
    """

    placement: Placement = eqx.field(static=True)
    signal: str = eqx.field(static=True)
    product: str = eqx.field(static=True, default="1")
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    centre: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        term = "the constant" if self.product == "1" else f"the term {self.product}"
        return EffectCard(
            name=f"{self.product} varying with {self.signal} in {self.placement.name}",
            description=f"{term} in the aerodynamic coefficient {with_axes(self.placement.name)} "
            f"varies with {self.signal}",
            location=self.placement.location,
            signals=(self.signal,),
            complexity=1 + sum(power for _, power in factors(self.product)),
            fixed=("centre",),
        )

    def initialise_shape(self, signals, measured, step):
        return eqx.tree_at(
            lambda effect: effect.centre, self, jnp.asarray(np.mean(signals[self.signal]))
        )

    def scalar(self, signals):
        return monomials((self.product,), signals)[0] * (signals[self.signal] - self.centre)


class GroundEffect(ScalarEffect):
    """Change of a coefficient near the ground.

        C += gain / (1 + (16 h/b)^2)        h: height above the ground

    The gain is the change at zero height. The function is one minus the factor on induced drag of
    McCormick, Aerodynamics, Aeronautics and Flight Mechanics, Wiley 1979, chapter 7.

    Args:
        placement: in which coefficient.
        ground: altitude of the ground [m].
        b: span [m].
        gain: change of the coefficient at zero height [1].
    """

    placement: Placement = eqx.field(static=True)
    ground: float = eqx.field(static=True)
    b: float = eqx.field(static=True)
    signal: str = eqx.field(static=True, default="altitude")
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        return EffectCard(
            name=f"ground effect in {self.placement.name}",
            description="the nearness of the ground changes the aerodynamic coefficient "
            f"{with_axes(self.placement.name)}",
            location=self.placement.location,
            signals=(self.signal,),
            complexity=AS_CUBIC,
        )

    def scalar(self, signals):
        return 1.0 / (1.0 + (16.0 * (signals[self.signal] - self.ground) / self.b) ** 2)
