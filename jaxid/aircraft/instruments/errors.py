"""Errors of instruments on a sampled signal: lag, delay, saturation, noise, quantisation and
dropout.
"""

import jax
import jax.numpy as jnp

from ..._foundation.types import Array, Bool, Float
from ...effects.sensor import delayed_signal, lagged_signal
from .channels import CHANNELS, PerChannel

Table = Float[Array, "time output"]


def lagged(t: Float[Array, " time"], y: Table, lag: PerChannel, outputs: tuple[str, ...]) -> Table:
    """Return the channels after a first-order lag, `lag dw/dt = y - w`, at rest at the first
    sample.

    Args:
        t: time [s].
        y: the signals [their units].
        lag: time constants [s].
        outputs: names of the columns of y.
    """
    if not lag.channels:
        return y
    at = lag.columns(outputs)
    return y.at[:, at].set(
        jax.vmap(lagged_signal, in_axes=(None, 1, 0), out_axes=1)(t, y[:, at], lag.values)
    )


def delayed(
    t: Float[Array, " time"], y: Table, delay: PerChannel, outputs: tuple[str, ...]
) -> Table:
    """Return the delayed channels, `y(t - delay)`.

    Args:
        t: time [s].
        y: the signals [their units].
        delay: delay by channel [s].
        outputs: names of the columns of y.
    """
    if not delay.channels:
        return y
    at = delay.columns(outputs)
    return y.at[:, at].set(
        jax.vmap(delayed_signal, in_axes=(None, 1, 0), out_axes=1)(t, y[:, at], delay.values)
    )


def saturated(y: Table, lower: PerChannel, upper: PerChannel, outputs: tuple[str, ...]) -> Table:
    """Return the channels clipped to their range.

    Args:
        y: the signals [their units].
        lower, upper: ends of the range, each for the channels that have one [their units].
        outputs: names of the columns of y.
    """
    if lower.channels:
        at = lower.columns(outputs)
        y = y.at[:, at].set(jnp.maximum(y[:, at], lower.values[None]))
    if upper.channels:
        at = upper.columns(outputs)
        y = y.at[:, at].set(jnp.minimum(y[:, at], upper.values[None]))
    return y


def white(key: Array, samples: int, sigma: PerChannel) -> Float[Array, "time channel"]:
    """Draw white Gaussian noise of standard deviation sigma.

    Args:
        key: random key. The noise of a channel depends on the key and the channel, not on the other
            channels.
        samples: number of samples.
        sigma: standard deviations [the channels' units].
    """
    return _normal(key, samples, sigma.channels) * sigma.values[None]


def band_limited(
    key: Array, t: Float[Array, " time"], sigma: PerChannel, bandwidth: PerChannel
) -> Float[Array, "time channel"]:
    """Draw samples of a stationary first-order Gauss-Markov process, exact for any steps.

        dn/dt = -b n + sqrt(2 b) sigma w,    E n(t) n(t + s) = sigma^2 exp(-b |s|)
        n_(i+1) = exp(-b h) n_i + sigma sqrt(1 - exp(-2 b h)) e_i

    Source: Gelb (ed.), Applied Optimal Estimation, MIT Press 1974, section 3.6.

    Args:
        key: random key.
        t: time [s].
        sigma: standard deviations [the channels' units].
        bandwidth: b, the half-power frequency [rad/s].
    """
    e = _normal(key, t.shape[0], sigma.channels)
    decay = jnp.outer(jnp.diff(t), bandwidth.values)

    def follow(n, now):
        e, decay = now
        n = jnp.exp(-decay) * n + jnp.sqrt(-jnp.expm1(-2.0 * decay)) * e
        return n, n

    _, later = jax.lax.scan(follow, e[0], (e[1:], decay))
    return jnp.concatenate([e[:1], later]) * sigma.values[None]


def quantised(z: Table, quantum: PerChannel, outputs: tuple[str, ...]) -> Table:
    """Return the channels rounded to multiples of their quantum; a quantum of zero has no effect.

    Args:
        z: the signals [their units].
        quantum: smallest recorded difference [their units].
        outputs: names of the columns of z.
    """
    if not quantum.channels:
        return z
    at, step = quantum.columns(outputs), quantum.values[None]
    safe = jnp.where(step > 0, step, 1.0)
    return z.at[:, at].set(jnp.where(step > 0, safe * jnp.round(z[:, at] / safe), z[:, at]))


def recorded_mask(
    key: Array, samples: int, dropout: PerChannel, outputs: tuple[str, ...]
) -> Bool[Array, "time output"]:
    """Draw the mask of recorded samples: each is lost independently with the channel's probability.

    Args:
        key: random key.
        samples: number of samples.
        dropout: probability that a sample is lost.
        outputs: names of the columns.
    """
    mask = jnp.ones((samples, len(outputs)), bool)
    if not dropout.channels:
        return mask
    draws = jax.vmap(lambda k: jax.random.uniform(k, (samples,)), out_axes=1)(
        _keys(key, dropout.channels)
    )
    return mask.at[:, dropout.columns(outputs)].set(draws >= dropout.values[None])


def _normal(key, samples, channels) -> Float[Array, "time channel"]:
    """Draw standard normal numbers for each channel."""
    return jax.vmap(lambda k: jax.random.normal(k, (samples,)), out_axes=1)(_keys(key, channels))


def _keys(key, channels):
    """Return one key for each channel, independent of the other channels."""
    return jax.vmap(lambda index: jax.random.fold_in(key, index))(
        jnp.array([CHANNELS.index(n) for n in channels])
    )
