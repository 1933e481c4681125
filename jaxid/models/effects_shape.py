"""General effects of a shape that no polynomial has: a dead band, a saturation, a hinge."""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are none.
# pyright: reportCallIssue=false

import equinox as eqx
import jax.numpy as jnp

from .._foundation.types import Array, Float
from .acting import Acting, ActingEffect
from .effects import zero
from .effects_equation import QuadraticDrag, Term
from .polynomial import factor_of
from .starts import centre_of, inside_of, level_in, reach_of


class DeadBand(ActingEffect):
    """What acts only beyond a dead band: nothing within `width` of the centre, a straight line on either side.

        scalar += gain (d - clip(d, -width, width)),    d = signal - centre

    Play in a joint is the pattern. Where the equation has a free linear term in the signal, a saturation is the same with a gain
    of the opposite sign. The centre stays: zero where the signal moves about zero, else its median.

    Args:
        acting: where it acts.
        signal: of which it is made.
        fraction: where the width starts, as a fraction of how far the signal goes from its centre.
        gain: slope beyond the band [unit of the scalar over that of the signal].
    """

    acting: Acting = eqx.field(static=True)
    signal: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.4)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    width: Float[Array, ""] = eqx.field(default_factory=zero)
    centre: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"dead band of {self.signal} in {self.acting.name}"

    @property
    def sentence(self):
        return f"{self.signal} has a dead band or a saturation {self.acting.words}: its slope there is another about the centre"

    @property
    def fixed(self):
        return ("centre",)

    @property
    def bounds(self):
        return {"width": (0.0, float("inf"))}

    def start(self, signals, measured, step):
        shape = jnp.asarray(self.fraction * reach_of(signals[self.signal])), centre_of(signals[self.signal])
        return eqx.tree_at(lambda effect: (effect.width, effect.centre), self, shape)

    def scalar(self, signals):
        away = signals[self.signal] - self.centre
        return away - jnp.clip(away, -self.width, self.width)

    def kin(self):
        """The smooth shapes of the same kind, where it stands in an equation."""
        state = self.acting.name
        if self.acting != Acting.equation(state):
            return ()
        cube = Term(state=state, product=f"{factor_of(self.signal)}^3")
        return (cube, QuadraticDrag(state=state, speed=state)) if self.signal == state else (cube,)


class Saturating(ActingEffect):
    """What acts up to a level on either side of its centre and no further.

        scalar += gain clip(d, -level, level),    d = signal - centre

    Where the equation has a free linear term in the signal, a dead band with a gain of the opposite sign is the same.

    Args:
        acting: where it acts.
        signal: of which it is made.
        fraction: where the level starts, as a fraction of how far the signal goes from its centre.
        gain: slope below the level [unit of the scalar over that of the signal].
    """

    acting: Acting = eqx.field(static=True)
    signal: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.4)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    level: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.ones(()))
    centre: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"saturation of {self.signal} in {self.acting.name}"

    @property
    def sentence(self):
        return f"{self.signal} acts {self.acting.words} up to a level and no further"

    @property
    def fixed(self):
        return ("centre",)

    @property
    def bounds(self):
        return {"level": (0.0, float("inf"))}

    def start(self, signals, measured, step):
        shape = jnp.asarray(self.fraction * reach_of(signals[self.signal])), centre_of(signals[self.signal])
        return eqx.tree_at(lambda effect: (effect.level, effect.centre), self, shape)

    def scalar(self, signals):
        return jnp.clip(signals[self.signal] - self.centre, -self.level, self.level)


class Hinge(ActingEffect):
    """One knot of a linear spline: nothing up to a level, a straight line beyond.

        scalar += gain max(signal - level, 0)

    The level stays where the training records have samples on either side of it: elsewhere a hinge is no bend.

    A stop that is met, a spring that is slack on one side and a flow that separates all bend in this way.

    Args:
        acting: where it acts.
        signal: of which it is made.
        fraction: where the level starts, as a fraction of the signal's range on the training records.
        lowest, highest: between which it stays.
        gain: change of slope at the level [unit of the scalar over that of the signal].
    """

    acting: Acting = eqx.field(static=True)
    signal: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.5)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    level: Float[Array, ""] = eqx.field(default_factory=zero)
    lowest: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(-jnp.inf))
    highest: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(jnp.inf))

    @property
    def name(self):
        return f"{self.family} (from {self.fraction:.0%})"

    @property
    def family(self):
        return f"hinge of {self.signal} in {self.acting.name}"

    @property
    def sentence(self):
        return f"the slope of {self.signal} {self.acting.words} changes at a level"

    @property
    def fixed(self):
        return ("lowest", "highest")

    @property
    def void_on_bounds(self):
        return ("level",)

    @property
    def bounds(self):
        return {"level": (float(self.lowest), float(self.highest))}

    def start(self, signals, measured, step):
        lowest, highest = map(jnp.asarray, inside_of(signals[self.signal]))
        level = jnp.clip(level_in(signals[self.signal], self.fraction), lowest, highest)
        return eqx.tree_at(lambda one: (one.level, one.lowest, one.highest), self, (level, lowest, highest))

    def scalar(self, signals):
        return jnp.maximum(signals[self.signal] - self.level, 0.0)
