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

# Heights in spans: of half of the ground effect (McCormick), and of a thousandth (chosen).
SPANS_AT_HALF, MOST_SPANS = 1.0 / 16.0, 2.0
# m; Daocheng Yading Airport, the highest civil airport in the world (opened in 2013)
HIGHEST_AIRFIELD = 4411.0


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

        C += gain / (1 + (16 h/b)^2)        h = altitude - ground < 2 b, and no change above

    The gain is the change at zero height. The function is one minus the factor on induced drag of
    McCormick, Aerodynamics, Aeronautics and Flight Mechanics, Wiley 1979, chapter 7; at a height of
    two spans it is a thousandth. A ground whose altitude is not known is a shape parameter: at most
    one span under the lowest altitude of the training records, and no higher than an airfield.

    Args:
        placement: in which coefficient.
        b: span [m].
        known: whether the altitude of the ground is known.
        gain: change of the coefficient at zero height [1].
        ground: altitude of the ground [m].
        lowest, highest: bounds of the altitude of a ground that is not known [m].
    """

    placement: Placement = eqx.field(static=True)
    b: float = eqx.field(static=True)
    known: bool = eqx.field(static=True, default=False)
    signal: str = eqx.field(static=True, default="altitude")
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    ground: Float[Array, ""] = eqx.field(default_factory=zero)
    lowest: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(-jnp.inf))
    highest: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(jnp.inf))

    @property
    def card(self):
        bounds = ("lowest", "highest")
        return EffectCard(
            name=f"ground effect in {self.placement.name}",
            description="the nearness of the ground changes the aerodynamic coefficient "
            f"{with_axes(self.placement.name)}",
            location=self.placement.location,
            signals=(self.signal,),
            complexity=AS_CUBIC,
            bounds={} if self.known else {"ground": (self.lowest, self.highest)},
            fixed=("ground", *bounds) if self.known else bounds,
        )

    def initialise_shape(self, signals, measured, step):
        if self.known:
            return self
        highest = min(float(np.min(signals[self.signal])), HIGHEST_AIRFIELD)
        ground = (highest - SPANS_AT_HALF * self.b, highest - self.b, highest)
        return eqx.tree_at(
            lambda effect: (effect.ground, effect.lowest, effect.highest),
            self,
            tuple(map(jnp.asarray, ground)),
        )

    def scalar(self, signals):
        height = (signals[self.signal] - self.ground) / self.b
        return jnp.where(height < MOST_SPANS, 1.0 / (1.0 + (height / SPANS_AT_HALF) ** 2), 0.0)
