"""General effects that are static, piecewise linear functions: dead band, saturation, hinge."""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are
# none.
# pyright: reportCallIssue=false

import equinox as eqx
import jax.numpy as jnp

from .._foundation.types import Array, Float
from ..models.polynomial import factor_of
from .base import zero
from .card import EffectCard
from .equation import QuadraticDrag, Term
from .placement import AS_CUBIC, Placement, ScalarEffect
from .shape_initialisation import bend_range, centre_of, level_in, max_deviation


class DeadBand(ScalarEffect):
    """Dead band: zero within `width` of the centre, linear beyond.

        scalar += gain (d - clip(d, -width, width)),    d = signal - centre

    A typical cause is play in a joint. If the equation has a free linear term in the signal, a
    saturation with a gain of the opposite sign is equivalent. The centre is not estimated: zero if
    zero lies between the signal's quartiles, else its median.

    Args:
        placement: equations in which the scalar acts.
        signal: argument of the function.
        fraction: initial width, as a fraction of the signal's largest deviation from its centre.
        gain: slope beyond the band [unit of the scalar/unit of the signal].
        width: half the width of the band [unit of the signal].
        centre: middle of the band [unit of the signal].
    """

    placement: Placement = eqx.field(static=True)
    signal: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.4)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    width: Float[Array, ""] = eqx.field(default_factory=zero)
    centre: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        return EffectCard(
            name=f"dead band of {self.signal} in {self.placement.name}",
            description=(
                f"{self.signal} has a dead band or a saturation {self.placement.words}: "
                "its slope about the centre differs"
            ),
            location=self.placement.location,
            signals=(self.signal,),
            complexity=AS_CUBIC,
            bounds={"width": (0.0, float("inf"))},
            fixed=("centre",),
        )

    def initialise_shape(self, signals, measured, step):
        shape = (
            jnp.asarray(self.fraction * max_deviation(signals[self.signal])),
            centre_of(signals[self.signal]),
        )
        return eqx.tree_at(lambda effect: (effect.width, effect.centre), self, shape)

    def scalar(self, signals):
        deviation = signals[self.signal] - self.centre
        return deviation - jnp.clip(deviation, -self.width, self.width)

    def neighbouring_shapes(self):
        """Return smooth functions of a similar shape if the scalar acts in one equation."""
        state = self.placement.name
        if self.placement != Placement.equation(state):
            return ()
        cube = Term(state=state, product=f"{factor_of(self.signal)}^3")
        return (cube, QuadraticDrag(state=state, speed=state)) if self.signal == state else (cube,)


class Saturation(ScalarEffect):
    """Saturation at a level on either side of the centre.

        scalar += gain clip(d, -level, level),    d = signal - centre

    If the equation has a free linear term in the signal, a dead band with a gain of the opposite
    sign is equivalent.

    Args:
        placement: equations in which the scalar acts.
        signal: argument of the function.
        fraction: initial level, as a fraction of the signal's largest deviation from its centre.
        gain: slope below the level [unit of the scalar/unit of the signal].
        level: deviation from the centre at which the function saturates [unit of the signal].
        centre: middle of the linear range [unit of the signal].
    """

    placement: Placement = eqx.field(static=True)
    signal: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.4)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    level: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.ones(()))
    centre: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        return EffectCard(
            name=f"saturation of {self.signal} in {self.placement.name}",
            description=f"{self.signal} acts {self.placement.words} up to a level and no further",
            location=self.placement.location,
            signals=(self.signal,),
            complexity=AS_CUBIC,
            bounds={"level": (0.0, float("inf"))},
            fixed=("centre",),
        )

    def initialise_shape(self, signals, measured, step):
        shape = (
            jnp.asarray(self.fraction * max_deviation(signals[self.signal])),
            centre_of(signals[self.signal]),
        )
        return eqx.tree_at(lambda effect: (effect.level, effect.centre), self, shape)

    def scalar(self, signals):
        return jnp.clip(signals[self.signal] - self.centre, -self.level, self.level)


class Hinge(ScalarEffect):
    """Hinge, one knot of a linear spline: zero up to a level, linear beyond.

        scalar += gain max(signal - level, 0)

    The level is bounded to values with training samples on either side; elsewhere a hinge is a
    straight line or zero. Typical causes are a mechanical stop, a spring that is slack on one side,
    and flow separation.

    Args:
        placement: equations in which the scalar acts.
        signal: argument of the function.
        fraction: initial level, as a fraction of the signal's range in the training records.
        gain: change of slope at the level [unit of the scalar/unit of the signal].
        level: the knot [unit of the signal].
        lowest, highest: bounds of the level [unit of the signal].
    """

    placement: Placement = eqx.field(static=True)
    signal: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.5)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    level: Float[Array, ""] = eqx.field(default_factory=zero)
    lowest: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(-jnp.inf))
    highest: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(jnp.inf))

    @property
    def card(self):
        family = f"hinge of {self.signal} in {self.placement.name}"
        return EffectCard(
            name=f"{family} (from {self.fraction:.0%})",
            description=f"the slope of {self.signal} {self.placement.words} changes at a level",
            location=self.placement.location,
            family=family,
            signals=(self.signal,),
            complexity=AS_CUBIC,
            bounds={"level": (self.lowest, self.highest)},
            fixed=("lowest", "highest"),
            degenerate_at_bounds=("level",),
        )

    def initialise_shape(self, signals, measured, step):
        lowest, highest = map(jnp.asarray, bend_range(signals[self.signal]))
        level = jnp.clip(level_in(signals[self.signal], self.fraction), lowest, highest)
        return eqx.tree_at(
            lambda effect: (effect.level, effect.lowest, effect.highest),
            self,
            (level, lowest, highest),
        )

    def scalar(self, signals):
        return jnp.maximum(signals[self.signal] - self.level, 0.0)
