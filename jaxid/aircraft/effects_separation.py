"""Effects of aircraft: flow that separates at high angle of attack, at once or with a lag.

The lift of a partly separated wing is that of Kirchhoff's flow, a factor `((1 + sqrt x)/2)^2` on the attached one, where x is the
place of separation from the trailing edge (0: at the leading edge, 1: none). Source: M. Goman and A. Khrabrov, State-space
representation of aerodynamic characteristics of an aircraft at high angles of attack, J. Aircraft 31(5), 1994, 1109-1115.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Float
from ..models.acting import Acting
from ..models.effects import Effect, Signals, zero
from ..models.starts import level_in

SMALL = -1.0  # gain at which a lag is felt: a quarter of the slope of CZ with alpha of attached flow [1/rad]
SEPARATED = 1e-4  # the least x: the root of less has too steep a derivative
ANGLES = (0.0, 1.0)  # rad, within which flow separates
SHAPES = (1.0, 300.0)  # 1/rad, of the steepness
STEEPNESS = (10.0, 60.0)  # range of the start [1/rad]; wings of real aircraft lie around 15 to 30
SLOWEST = 3.0  # s, of a lag: by far longer than the air takes over a wing
SPREAD = 9.0  # steepness times range of alpha: from 10 % to 90 % separated within a quarter of the range


def kirchhoff(x: Float[Array, ""]) -> Float[Array, ""]:
    """The share of the attached flow's lift that is left, `((1 + sqrt x)/2)^2`, with x kept between its ends."""
    return (0.5 * (1.0 + jnp.sqrt(jnp.clip(x, SEPARATED, 1.0)))) ** 2


class SeparatedFlow(Effect):
    """What all models of separated flow share: the static place of separation, and what its loss of lift does.

        x0(alpha) = (1 - tanh(steepness (alpha - alpha_star)))/2
        CZ += gain alpha (((1 + sqrt x)/2)^2 - 1),    CX += forward (the same),    Cm += pitching (the same)

    Attributes:
        acting: in the coefficients CX, CZ and Cm, those of them that there are.
        fraction: where alpha_star starts, as a fraction of the range of alpha on the training records.
        gain: slope of CZ with alpha that separated flow loses, negative as that of the attached flow is [1/rad].
        alpha_star: angle at which x is one half [rad].
        steepness: of x about that angle [1/rad].
        forward, pitching: what the loss of CZ does to CX and Cm, per unit of CZ.
    """

    acting: eqx.AbstractVar[tuple[Acting, ...]]
    fraction: eqx.AbstractVar[float]
    alpha_star: eqx.AbstractVar[Float[Array, ""]]
    steepness: eqx.AbstractVar[Float[Array, ""]]
    forward: eqx.AbstractVar[Float[Array, ""]]
    pitching: eqx.AbstractVar[Float[Array, ""]]

    @abc.abstractmethod
    def place_of_separation(self, signals: Signals) -> Float[Array, ""]:
        """x, before it is kept between its ends."""

    @property
    def name(self):
        return f"{self.family} (from {self.fraction:.0%})"

    @property
    def place(self):
        return "coefficient CZ"

    @property
    def unit(self):
        return "1/rad"

    def start(self, signals, measured, step):
        alpha = signals["alpha"]
        steepness = np.clip(SPREAD / max(np.ptp(alpha), 1e-6), *STEEPNESS)
        shape = jnp.clip(level_in(alpha, self.fraction), *ANGLES), jnp.asarray(steepness)
        return eqx.tree_at(lambda effect: (effect.alpha_star, effect.steepness), self, shape)

    def static(self, alpha: Float[Array, ""]) -> Float[Array, ""]:
        """x0, where the flow separates at an angle of attack that stays."""
        return 0.5 * (1.0 - jnp.tanh(self.steepness * (alpha - self.alpha_star)))

    def equations(self, dx, signals):
        loss = self.gain * signals["alpha"] * (kirchhoff(self.place_of_separation(signals)) - 1.0)
        shares = {"CZ": 1.0, "CX": self.forward, "Cm": self.pitching}
        added: Signals = {}
        for acting in self.acting:
            for state, value in acting.spread(shares[acting.name] * loss, signals).items():
                added[state] = added[state] + value if state in added else value
        return added


class StaticSeparation(SeparatedFlow):
    """Flow that separates at high angle of attack without delay: `x = x0(alpha)`.

    Args:
        acting: in the coefficients CX, CZ and Cm, those of them that there are.
        fraction: where alpha_star starts, as a fraction of the range of alpha.
    """

    acting: tuple[Acting, ...] = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.75)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    alpha_star: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(0.3))
    steepness: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(20.0))
    forward: Float[Array, ""] = eqx.field(default_factory=zero)
    pitching: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def family(self):
        return "static separation"

    @property
    def sentence(self):
        return "the flow separates at high angle of attack, and lift is lost"

    @property
    def complexity(self):
        return 3

    @property
    def bounds(self):
        return {"alpha_star": ANGLES, "steepness": SHAPES}

    def place_of_separation(self, signals):
        return self.static(signals["alpha"])


class Separation(SeparatedFlow):
    """Flow that separates at high angle of attack late, and attaches again late:

        lag dx/dt + x = x0(alpha - late d(alpha)/dt)

    The state that is carried is `x - x0(alpha)`, which is zero in steady flight, where records begin. It is tried once
    `StaticSeparation` is in: first that the flow separates, then that it does so late.

    Args:
        acting: in the coefficients CX, CZ and Cm, those of them that there are.
        fraction: where alpha_star starts, as a fraction of the range of alpha.

    Attributes:
        lag: of the place of separation behind its static value, at least 0.02 s [s].
        late: by how much separation and attachment are put off in a quasi-steady motion [s].
    """

    acting: tuple[Acting, ...] = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.75)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    alpha_star: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(0.3))
    steepness: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(20.0))
    forward: Float[Array, ""] = eqx.field(default_factory=zero)
    pitching: Float[Array, ""] = eqx.field(default_factory=zero)
    lag: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(0.3))
    late: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(0.1))

    @property
    def family(self):
        return "separation with hysteresis"

    @property
    def refines(self):
        return "static separation"

    @property
    def sentence(self):
        return "the flow separates at high angle of attack late and attaches again late: a hysteresis of lift"

    @property
    def complexity(self):
        return 5

    @property
    def begin(self):
        return SMALL  # at a gain of zero nothing is felt of the other parameters, and the search for them would wander

    @property
    def bounds(self):
        return {"alpha_star": ANGLES, "steepness": SHAPES, "lag": (0.02, SLOWEST), "late": (0.0, SLOWEST)}

    @property
    def extra_states(self):
        return (f"x of {self.name}",)

    @property
    def rates_of(self):
        return ("alpha",)

    def place_of_separation(self, signals):
        return self.static(signals["alpha"]) + signals[self.extra_states[0]]

    def extra_rates(self, extra, u, signals, rates):
        (own,) = self.extra_states
        alpha, alphadot = signals["alpha"], rates["alpha"]
        static = self.static(alpha)
        slope = -2.0 * self.steepness * static * (1.0 - static)  # d x0/d alpha
        aim = self.static(alpha - self.late * alphadot)
        return {own: (aim - static - extra[own]) / self.lag - slope * alphadot}
