"""Effects of aircraft: separated flow at high angle of attack, static or with a lag.

By Kirchhoff's flow the lift of a partly separated wing is the attached lift times `((1 + sqrt
x)/2)^2`, where x is the separation point (0: at the leading edge, 1: at the trailing edge, attached
flow). Source: M. Goman and A. Khrabrov, State-space representation of aerodynamic
characteristics of an aircraft at high angles of attack, J. Aircraft 31(5), 1994, 1109-1115.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..._foundation.location import Location, LocationKind
from ..._foundation.types import Array, Float
from ...effects.base import Effect, Signals, zero
from ...effects.card import EffectCard
from ...effects.placement import Placement
from ...effects.shape_initialisation import level_in

# All limits are chosen.
# 1/rad; a quarter of the slope of CZ with alpha in attached flow, so that a lag has an influence
INITIAL_GAIN = -1.0
MIN_SEPARATION_POINT = 1e-4  # below it the derivative of the square root is too steep
ALPHA_STAR_BOUNDS = (0.0, 1.0)  # rad, angles at which flow separates
STEEPNESS_BOUNDS = (1.0, 300.0)  # 1/rad
INITIAL_STEEPNESS = (10.0, 60.0)  # 1/rad, range; wings of real aircraft are around 15 to 30
MAX_LAG = 3.0  # s; far longer than the transit time of the air over a wing
# initial steepness times range of alpha: from 10 % to 90 % separated in a quarter of the range
STEEPNESS_TIMES_RANGE = 9.0


def kirchhoff(x: Float[Array, ""]) -> Float[Array, ""]:
    """Return the remaining share of the attached lift, `((1 + sqrt x)/2)^2`.

    Args:
        x: separation point; clipped to its range.
    """
    return (0.5 * (1.0 + jnp.sqrt(jnp.clip(x, MIN_SEPARATION_POINT, 1.0)))) ** 2


class SeparatedFlow(Effect):
    """Base class of the models of separated flow.

        x0(alpha) = (1 - tanh(steepness (alpha - alpha_star)))/2
        dCZ = gain alpha (((1 + sqrt x)/2)^2 - 1)
        CZ += dCZ,    CX += forward dCZ,    Cm += pitching dCZ

    The forces are in body axes, in a model with lift and drag as well.

    Attributes:
        placements: in the coefficients CX, CZ and Cm, those of them that there are.
        fraction: where alpha_star starts, as a fraction of the range of alpha on the training
            records.
        gain: slope of CZ with alpha that separated flow loses, negative as that of the attached
            flow is [1/rad].
        alpha_star: angle at which x is one half [rad].
        steepness: steepness of x about that angle [1/rad].
        forward, pitching: changes of CX and Cm per unit of the change of CZ [1].
    """

    placements: eqx.AbstractVar[tuple[Placement, ...]]
    fraction: eqx.AbstractVar[float]
    alpha_star: eqx.AbstractVar[Float[Array, ""]]
    steepness: eqx.AbstractVar[Float[Array, ""]]
    forward: eqx.AbstractVar[Float[Array, ""]]
    pitching: eqx.AbstractVar[Float[Array, ""]]

    @abc.abstractmethod
    def separation_point(self, signals: Signals) -> Float[Array, ""]:
        """Return the separation point x, not yet clipped to its range."""

    def initialise_shape(self, signals, measured, step):
        alpha = signals["alpha"]
        steepness = np.clip(STEEPNESS_TIMES_RANGE / max(np.ptp(alpha), 1e-6), *INITIAL_STEEPNESS)
        shape = jnp.clip(level_in(alpha, self.fraction), *ALPHA_STAR_BOUNDS), jnp.asarray(steepness)
        return eqx.tree_at(lambda effect: (effect.alpha_star, effect.steepness), self, shape)

    def static(self, alpha: Float[Array, ""]) -> Float[Array, ""]:
        """Return the separation point x0 at a constant angle of attack."""
        return 0.5 * (1.0 - jnp.tanh(self.steepness * (alpha - self.alpha_star)))

    def equations(self, dx, signals):
        loss = self.gain * signals["alpha"] * (kirchhoff(self.separation_point(signals)) - 1.0)
        shares = {"CZ": 1.0, "CX": self.forward, "Cm": self.pitching}
        added: Signals = {}
        for placement in self.placements:
            for state, value in placement.distribute(
                shares[placement.name] * loss, signals
            ).items():
                added[state] = added[state] + value if state in added else value
        return added


class StaticSeparation(SeparatedFlow):
    """Separation at high angle of attack without delay: `x = x0(alpha)`.

    Args:
        placements: in the coefficients CX, CZ and Cm, those of them that there are.
        fraction: where alpha_star starts, as a fraction of the range of alpha.
    """

    placements: tuple[Placement, ...] = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.75)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    alpha_star: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(0.3))
    steepness: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(20.0))
    forward: Float[Array, ""] = eqx.field(default_factory=zero)
    pitching: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def card(self):
        family = "static separation"
        return EffectCard(
            name=f"{family} (from {self.fraction:.0%})",
            description="the flow separates at high angle of attack, and lift is lost: "
            "CZ (body axes)",
            location=Location(LocationKind.COEFFICIENT, "CZ"),
            family=family,
            unit="1/rad",
            complexity=3,
            bounds={"alpha_star": ALPHA_STAR_BOUNDS, "steepness": STEEPNESS_BOUNDS},
        )

    def separation_point(self, signals):
        return self.static(signals["alpha"])


class Separation(SeparatedFlow):
    """Separation and reattachment with a delay at high angle of attack.

        lag dx/dt + x = x0(alpha - late d(alpha)/dt)

    The additional state is `x - x0(alpha)`, which is zero in steady flight, where records begin.
    The effect is a candidate only after `StaticSeparation` has been accepted.

    Args:
        placements: in the coefficients CX, CZ and Cm, those of them that there are.
        fraction: where alpha_star starts, as a fraction of the range of alpha.

    Attributes:
        lag: time constant of the separation point, at least 0.02 s [s].
        late: delay of separation and reattachment in a quasi-steady motion [s].
    """

    placements: tuple[Placement, ...] = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.75)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    alpha_star: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(0.3))
    steepness: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(20.0))
    forward: Float[Array, ""] = eqx.field(default_factory=zero)
    pitching: Float[Array, ""] = eqx.field(default_factory=zero)
    lag: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(0.3))
    late: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(0.1))

    @property
    def card(self):
        family = "separation with hysteresis"
        return EffectCard(
            name=f"{family} (from {self.fraction:.0%})",
            description="the flow separates at high angle of attack late and attaches again late: "
            "a hysteresis of lift: CZ (body axes)",
            location=Location(LocationKind.COEFFICIENT, "CZ"),
            family=family,
            unit="1/rad",
            complexity=5,
            bounds={
                "alpha_star": ALPHA_STAR_BOUNDS,
                "steepness": STEEPNESS_BOUNDS,
                "lag": (0.02, MAX_LAG),
                "late": (0.0, MAX_LAG),
            },
            refines="static separation",
            # At a gain of zero the other parameters have no influence and would drift.
            initial_gain=INITIAL_GAIN,
        )

    @property
    def extra_states(self):
        return (f"x of {self.name}",)

    @property
    def rates_of(self):
        return ("alpha",)

    def separation_point(self, signals):
        return self.static(signals["alpha"]) + signals[self.extra_states[0]]

    def extra_rates(self, extra, u, signals, rates):
        (name,) = self.extra_states
        alpha, alphadot = signals["alpha"], rates["alpha"]
        static = self.static(alpha)
        slope = -2.0 * self.steepness * static * (1.0 - static)  # d x0/d alpha
        target = self.static(alpha - self.late * alphadot)
        return {name: (target - static - extra[name]) / self.lag - slope * alphadot}
