"""General effects of an actuator between the recorded input and the plant: limits, a dead zone, hysteresis."""

import abc
from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Float
from .effects import zero
from .effects_input import InputEffect
from .effects_memory import NO_WIDTH_YET
from .followers import Hysteretic, Slow
from .starts import centre_of, level_in, rates_in, reach_of

NO_LIMIT_YET = 1e6  # high against any input in SI units: nothing is limited until `start` sets the limit


class ActuatorEffect(InputEffect):
    """What an actuator does to its input, beside a gain with one shape parameter; two of them are no parts of one function."""

    @property
    def signals_used(self):
        return ()

    @property
    def complexity(self):
        return 2


class ActuatorShape(ActuatorEffect):
    """An actuator that changes the value of one input: `u -> u + gain (changed - u)`; a gain of one is the whole effect."""

    @property
    def whole(self):
        return True

    @abc.abstractmethod
    def changed(self, u: Float[Array, ""]) -> Float[Array, ""]:
        """What the actuator makes of the value of its input."""

    def input(self, u, extra, inputs):
        index = inputs.index(self.channel)
        return u.at[index].add(self.gain * (self.changed(u[index]) - u[index]))


class InputRateLimit(ActuatorEffect):
    """An actuator that follows its input no faster than a limit: `u -> u + gain (r - u)`; a gain of one is the whole effect.

        |dr/dt| <= limit,    r as near to u as that allows

    It acts on the samples, before all that acts on values: r is exact there for an input of straight lines, and runs as the input
    does in between. The actuator begins at rest, where the record's first input holds it.

    Args:
        channel: name of the input.
        fraction: where the limit starts, as a fraction of the largest rate in the training records.
    """

    channel: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.2)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    limit: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(NO_LIMIT_YET))

    @property
    def name(self):
        return f"{self.family} (from {self.fraction:.0%})"

    @property
    def family(self):
        return f"rate limit of input {self.channel}"

    @property
    def sentence(self):
        return f"the actuator of {self.channel} has a limit of rate"

    @property
    def whole(self):
        return True

    @property
    def bounds(self):
        return super().bounds | {"limit": (0.0, float("inf"))}

    def start(self, signals, measured, step):
        largest = np.max(np.abs(rates_in(signals[self.channel], signals)))
        limit = self.fraction * largest if largest > 0 else NO_LIMIT_YET
        return eqx.tree_at(lambda effect: effect.limit, self, jnp.asarray(limit))

    def input_path(self, path, inputs):
        return path.followed(inputs.index(self.channel), Slow(self.limit), self.gain)


class InputHysteresis(ActuatorEffect):
    """Hysteresis between the recorded input and what acts, as of cables, gears and piezoelectric drives: `u -> u - gain z`.

        width dz/dt = du/dt - (|du/dt| |z| z + du/dt z^2) / 2

    A gain of the width is play: behind a turn nothing moves at first. It acts on the samples, before all that acts on values;
    of an input of straight lines z is exact at the quarters of each, and straight between. It brings no state. z begins at zero.

    Args:
        channel: name of the input.
        fraction: where the width starts, as a fraction of how far the input goes from its centre.
        gain: half the width of the loop, measured along the input; above zero where what acts is behind [unit of the input].
        width: over which it turns [unit of the input].

    Source: Wen, J. Eng. Mech. Div. ASCE 102 (1976), pp. 249-263, in the form of `Hysteresis`.
    """

    channel: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.2)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    width: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(NO_WIDTH_YET))

    @property
    def name(self):
        return f"hysteresis of input {self.channel}"

    @property
    def sentence(self):
        return f"the actuator of {self.channel} has hysteresis"

    @property
    def bounds(self):
        return {"width": (1e-9, float("inf"))}

    def start(self, signals, measured, step):
        width = self.fraction * reach_of(signals[self.channel])
        return eqx.tree_at(lambda effect: effect.width, self, jnp.asarray(width))

    def input_path(self, path, inputs):
        return path.followed(inputs.index(self.channel), Hysteretic(self.width), self.gain)


class InputPositionLimit(ActuatorShape):
    """An actuator that stops at a level.

        changed = min(u, level)      at the upper end, and its mirror image at the lower

    Args:
        channel: name of the input.
        end: which end of the range.
        fraction: where the level starts, as a fraction of the way from the middle of the input's range to its end.
    """

    channel: str = eqx.field(static=True)
    end: Literal["upper", "lower"] = eqx.field(static=True, default="upper")
    fraction: float = eqx.field(static=True, default=0.6)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    level: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"{self.end} limit of input {self.channel}"

    @property
    def sentence(self):
        return f"the actuator of {self.channel} stops at {'an upper' if self.end == 'upper' else 'a lower'} level"

    def start(self, signals, measured, step):
        away = 0.5 * self.fraction if self.end == "upper" else -0.5 * self.fraction
        return eqx.tree_at(lambda effect: effect.level, self, level_in(signals[self.channel], 0.5 + away))

    def changed(self, u):
        return jnp.minimum(u, self.level) if self.end == "upper" else jnp.maximum(u, self.level)


class InputDeadZone(ActuatorShape):
    """An actuator with a dead zone about its centre: small inputs do nothing.

        changed = u - clip(u - centre, -width, width)

    The centre stays: zero where the input moves about zero, else its median.

    Args:
        channel: name of the input.
        fraction: where the width starts, as a fraction of how far the input goes from its centre.
    """

    channel: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.2)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    width: Float[Array, ""] = eqx.field(default_factory=zero)
    centre: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"dead zone of input {self.channel}"

    @property
    def sentence(self):
        return f"the actuator of {self.channel} has a dead zone"

    @property
    def fixed(self):
        return ("centre",)

    @property
    def bounds(self):
        return super().bounds | {"width": (0.0, float("inf"))}

    def start(self, signals, measured, step):
        signal = signals[self.channel]
        shape = jnp.asarray(self.fraction * reach_of(signal)), centre_of(signal)
        return eqx.tree_at(lambda effect: (effect.width, effect.centre), self, shape)

    def changed(self, u):
        return u - jnp.clip(u - self.centre, -self.width, self.width)
