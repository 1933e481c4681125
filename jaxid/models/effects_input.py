"""General effects in the input: offset, scale and delay of its record, its run between the samples, an actuator's lag."""

import equinox as eqx
import jax.numpy as jnp

from .._foundation.checks import require
from .._foundation.grid import is_uniform
from .._foundation.types import Array, Float
from .effects import Effect, zero

BETWEEN = (-1.0, 3.0)  # two from the band-limited run: what asks for more of it is another thing, the input's curvature
NO_LAG_YET = 1e6  # [s] long against any record: the lagging state stands still until `start` sets its time


class InputEffect(Effect):
    """What happens to one input.

    Attributes:
        channel: name of the input.
    """

    channel: eqx.AbstractVar[str]

    @property
    def place(self):
        return f"input {self.channel}"

    @property
    def signals_used(self):
        return (self.channel,)


class InputBias(InputEffect):
    """The input is recorded with a constant offset, in its unit: `u -> u + gain`.

    Args:
        channel: name of the input.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"bias of input {self.channel}"

    @property
    def sentence(self):
        return f"the input {self.channel} is recorded with an offset"

    def input(self, u, extra, inputs):
        return u.at[inputs.index(self.channel)].add(self.gain)


class InputScale(InputEffect):
    """The input is recorded with an error of scale: `u -> (1 + gain) u`.

    Args:
        channel: name of the input.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"scale of input {self.channel}"

    @property
    def sentence(self):
        return f"the input {self.channel} is recorded with an error of scale"

    def input(self, u, extra, inputs):
        return u.at[inputs.index(self.channel)].multiply(1.0 + self.gain)


class InputDelay(InputEffect):
    """The input acts later than it is recorded, or earlier: `u(t) -> u(t - gain)`, with gain in seconds.

    Args:
        channel: name of the input.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"delay of input {self.channel}"

    @property
    def sentence(self):
        return f"the input {self.channel} acts {'earlier' if self.gain < 0 else 'later'} than it is recorded"

    def input_path(self, path, inputs):
        return path.delayed(inputs.index(self.channel), self.gain)


class InputBetweenSamples(InputEffect):
    """The input runs between its samples otherwise than assumed: band-limited at a gain of one.

        u(t) -> (1 - gain) u_assumed(t) + gain u_band-limited(t)

    Args:
        channel: name of the input.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)

    @property
    def name(self):
        return f"{self.channel} between samples"

    @property
    def sentence(self):
        return f"the input {self.channel} runs band-limited between its samples, not as assumed"

    @property
    def whole(self):
        return True

    @property
    def bounds(self):
        return {"gain": BETWEEN}

    def check(self, t):
        require(
            is_uniform(t),
            f"The effect {self.name!r} makes the input band-limited, which needs uniform sampling, and the sample times of a "
            "record are uneven. Leave it out.",
        )

    def input_path(self, path, inputs):
        return path.towards_band_limited(inputs.index(self.channel), self.gain)


class InputLag(InputEffect):
    """A first-order actuator between the recorded input and the plant.

        d(lagged)/dt = (u - lagged) / time,    u -> u + gain (lagged - u)

    A gain of one is the whole lag. The actuator begins at rest, where the record's first input holds it.

    Args:
        channel: name of the input.
    """

    channel: str = eqx.field(static=True)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    time: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(NO_LAG_YET))

    @property
    def name(self):
        return f"lag of input {self.channel}"

    @property
    def sentence(self):
        return f"an actuator lags behind the input {self.channel}"

    @property
    def complexity(self):
        return 2

    @property
    def whole(self):
        return True

    @property
    def bounds(self):
        return super().bounds | {"time": (1e-6, float("inf"))}

    def start(self, signals, measured, step):
        return eqx.tree_at(lambda effect: effect.time, self, 2.0 * jnp.asarray(step))

    @property
    def extra_states(self):
        return (f"lagged {self.channel}",)

    def input(self, u, extra, inputs):
        index = inputs.index(self.channel)
        return u.at[index].add(self.gain * (extra[self.extra_states[0]] - u[index]))

    def initial(self, record):
        return {self.extra_states[0]: record.channel(self.channel)[0]}

    def extra_rates(self, extra, u, signals, rates):
        lagged = self.extra_states[0]
        return {lagged: (u[self.channel] - extra[lagged]) / self.time}
