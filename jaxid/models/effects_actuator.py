"""General effects of an actuator between the recorded input and the plant: limits of rate and position, a dead zone."""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Float
from .effects import Effect, zero
from .starts import centre_of, level_in, rates_in, reach_of

NO_LIMIT_YET = 1e6  # high against any input in SI units: nothing is limited until `start` sets the limit


class InputEffect(Effect):
    """An actuator that changes the value of one input: `u -> u + gain (changed - u)`; a gain of one is the whole effect.

    Attributes:
        channel: name of the input.
    """

    channel: eqx.AbstractVar[str]

    @property
    def place(self):
        return f"input {self.channel}"

    @property
    def complexity(self):
        return 2

    def changed(self, u: Float[Array, ""], extra: dict[str, Float[Array, ""]]) -> Float[Array, ""]:
        """What the actuator makes of the input."""
        raise NotImplementedError(f"{type(self).__name__} changes nothing: give it a method `changed(u, extra)`.")

    def input(self, u, extra, inputs):
        index = inputs.index(self.channel)
        return u.at[index].add(self.gain * (self.changed(u[index], extra) - u[index]))


class InputRateLimit(InputEffect):
    """An actuator that follows its input no faster than a limit.

        d(r)/dt = step / time,    changed = r + step,    step = clip(u - r, -limit time, limit time)

    As long as the input is slower than the limit, `changed` is the input itself, without a lag; where it is faster, `changed`
    runs at the limit, until it meets the input again. `time` is that between two samples and decides only how sharply the
    limit sets in: `changed` is never more than `limit time` away from what an ideal limiter makes. The actuator begins at rest,
    where the record's first input holds it.

    Args:
        channel: name of the input.
        fraction: where the limit starts, as a fraction of the largest rate in the training records.
    """

    channel: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.4)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    limit: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(NO_LIMIT_YET))
    time: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.ones(()))

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
    def fixed(self):
        return ("time",)

    @property
    def bounds(self):
        return {"limit": (0.0, float("inf"))}

    def start(self, signals, measured, step):
        largest = np.max(np.abs(rates_in(signals[self.channel], signals)))
        shape = jnp.asarray(self.fraction * largest if largest > 0 else NO_LIMIT_YET), jnp.asarray(step)
        return eqx.tree_at(lambda effect: (effect.limit, effect.time), self, shape)

    @property
    def extra_states(self):
        return (f"rate-limited {self.channel} (from {self.fraction:.0%})",)

    def initial(self, record):
        return {self.extra_states[0]: record.channel(self.channel)[0]}

    def changed(self, u, extra):
        return extra[self.extra_states[0]] + self._step(u, extra)

    def extra_rates(self, extra, u, signals, rates):
        return {self.extra_states[0]: self._step(u[self.channel], extra) / self.time}

    def _step(self, u, extra):
        largest = self.limit * self.time
        return jnp.clip(u - extra[self.extra_states[0]], -largest, largest)


class InputPositionLimit(InputEffect):
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

    def changed(self, u, extra):
        return jnp.minimum(u, self.level) if self.end == "upper" else jnp.maximum(u, self.level)


class InputDeadZone(InputEffect):
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
        return {"width": (0.0, float("inf"))}

    def start(self, signals, measured, step):
        signal = signals[self.channel]
        shape = jnp.asarray(self.fraction * reach_of(signal)), centre_of(signal)
        return eqx.tree_at(lambda effect: (effect.width, effect.centre), self, shape)

    def changed(self, u, extra):
        return u - jnp.clip(u - self.centre, -self.width, self.width)
