"""Probes: simple functions of signals, which a force would follow that is not random."""

import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.grid import typical_step
from .._foundation.types import Array, Float

LAGS = (3.0, 15.0)  # typical steps: of signals that a force may follow late
# of a sign: it is full from a twentieth of the signal's range on, and a fixed step can follow it
SHARP = 20.0
PERIODS = 32  # over a state's range, at most; a quarter of many states'
FEW_SIGNALS = 8  # so many still have all their products tried


def probing(
    signals: Float[Array, "case time signal"], t: Float[Array, "case time"]
) -> Float[Array, "case time probe"]:
    """Simple functions of signals, which a force would follow that is not random: powers, sign,
    lags, and products of few.

    Args:
        signals: states, inputs and outputs along the trajectories.
        t: time [s].
    """
    size = jnp.max(jnp.abs(signals - jnp.mean(signals, axis=(0, 1))[None, None]), axis=(0, 1))
    s = (signals - jnp.mean(signals, axis=(0, 1))[None, None]) / jnp.where(size > 0, size, 1.0)[
        None, None
    ]
    typical = typical_step(t)
    lags = [jax.vmap(lambda t, s, lag=lag: _lagged(t, s, lag * typical))(t, s) for lag in LAGS]
    functions = [s, s**2, s**3, jnp.abs(s) * s, jnp.tanh(SHARP * s), *lags]
    if s.shape[-1] <= FEW_SIGNALS:
        first, second = np.triu_indices(s.shape[-1], 1)
        functions.append(s[..., first] * s[..., second])
    return jnp.concatenate(functions, axis=-1)


def waves(states: Float[Array, "case time state"]) -> Float[Array, "case time probe"]:
    """Sines and cosines of each state, of whole periods over its range: together any function of it
    that is as smooth.

    Args:
        states: along the trajectories.
    """
    low, high = jnp.min(states, axis=(0, 1)), jnp.max(states, axis=(0, 1))
    turn = (
        2.0
        * jnp.pi
        * (states - low[None, None])
        / jnp.where(high > low, high - low, 1.0)[None, None]
    )
    count = PERIODS if states.shape[-1] <= FEW_SIGNALS else PERIODS // 4
    angle = jnp.einsum("cts,k->ctsk", turn, jnp.arange(1.0, count + 1.0)).reshape(
        *states.shape[:2], -1
    )
    return jnp.concatenate([jnp.sin(angle), jnp.cos(angle)], axis=-1)


def _lagged(
    t: Float[Array, " time"], s: Float[Array, "time signal"], lag
) -> Float[Array, "time signal"]:
    """Signals behind a first-order lag, at rest at the start."""

    def follow(w, now):
        h, target = now
        w = target + (w - target) * jnp.exp(-h / lag)
        return w, w

    return jnp.concatenate([s[:1], jax.lax.scan(follow, s[0], (jnp.diff(t), s[:-1]))[1]])
