"""Channels that run by one rule beside others that run by straight lines: a model's inputs, and forces on it behind them."""

import equinox as eqx
import jax.numpy as jnp

from .inputs import AbstractHold, AbstractPath, Linear, corners_of


class Beside(AbstractPath):
    """Two paths as one: the channels of the first, and behind them those of the second, which nothing delays or follows."""

    first: AbstractPath
    second: AbstractPath

    def __call__(self, t):
        return jnp.concatenate([self.first(t), self.second(t)])

    def stages(self, t, substeps):
        return jnp.concatenate([self.first.stages(t, substeps), self.second.stages(t, substeps)], axis=-1)

    def delayed(self, channel, delay):
        return Beside(self.first.delayed(channel, delay), self.second)

    def towards_band_limited(self, channel, weight):
        return Beside(self.first.towards_band_limited(channel, weight), self.second)

    def followed(self, channel, follower, weight):
        return Beside(self.first.followed(channel, follower, weight), self.second)

    def corners(self):
        return corners_of(self.first, self.second)


class LinearBehind(AbstractHold):
    """Some rule for the first channels, and straight lines for those behind them.

    Args:
        hold: the rule.
        count: of the channels that it is for.
    """

    hold: AbstractHold
    count: int = eqx.field(static=True)

    def path(self, t, u):
        return Beside(self.hold.path(t, u[:, : self.count]), Linear().path(t, u[:, self.count :]))
