"""One hold for a model's inputs and straight lines for the disturbances appended to them."""

import equinox as eqx
import jax.numpy as jnp

from .hold import AbstractHold, Linear
from .input_signal import AbstractInputSignal, discontinuities_of


class ConcatenatedSignal(AbstractInputSignal):
    """The channels of a first signal, followed by the channels of a second.

    Delays, blends and memory operators act on the first signal only.
    """

    first: AbstractInputSignal
    second: AbstractInputSignal

    def __call__(self, t):
        return jnp.concatenate([self.first(t), self.second(t)])

    def stages(self, t, substeps):
        return jnp.concatenate(
            [self.first.stages(t, substeps), self.second.stages(t, substeps)], axis=-1
        )

    def delayed(self, channel, delay):
        return ConcatenatedSignal(self.first.delayed(channel, delay), self.second)

    def blend_band_limited(self, channel, weight):
        return ConcatenatedSignal(self.first.blend_band_limited(channel, weight), self.second)

    def followed(self, channel, follower, weight):
        return ConcatenatedSignal(self.first.followed(channel, follower, weight), self.second)

    def corners(self):
        return discontinuities_of(self.first, self.second)


class MixedHold(AbstractHold):
    """A hold for the first channels, and straight lines for the channels after them.

    Args:
        hold: hold of the first channels.
        count: number of the first channels.
    """

    hold: AbstractHold
    count: int = eqx.field(static=True)

    def path(self, t, u):
        return ConcatenatedSignal(
            self.hold.path(t, u[:, : self.count]), Linear().path(t, u[:, self.count :])
        )
