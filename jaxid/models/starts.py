"""Where the shape of an effect starts: levels, centres, rates and time scales read off the signals of the training records."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Float

Samples = Float[np.ndarray, " sample"]


def level_in(signal: Samples, fraction: float) -> Float[Array, ""]:
    """The level at a fraction of a signal's range."""
    low, high = np.min(signal), np.max(signal)
    return jnp.asarray(low + fraction * (high - low))


def centre_of(signal: Samples) -> Float[Array, ""]:
    """About what a signal moves: zero where zero lies between its quartiles, else its median."""
    low, middle, high = np.quantile(signal, [0.25, 0.5, 0.75])
    return jnp.asarray(0.0 if low <= 0.0 <= high else middle)


def reach_of(signal: Samples) -> float:
    """How far a signal goes from its centre; one where it does not move."""
    reach = float(np.max(np.abs(signal - np.asarray(centre_of(signal)))))
    return reach if reach > 0 else 1.0


def rates_in(signal: Samples, signals: Mapping[str, Samples]) -> Float[np.ndarray, " _"]:
    """Rates of a signal between neighbouring samples of one record.

    Args:
        signal: every valid sample of all records, one record after the other.
        signals: the time `t` among them [s].
    """
    length = np.diff(signals["t"])
    return np.diff(signal)[length > 0] / length[length > 0]


def time_scale_of(signal: Samples, signals: Mapping[str, Samples], step: float) -> float:
    """How fast a signal moves: its standard deviation over the root mean square of its rate; one step where it stands still.

    Args:
        signal: every valid sample of all records, one record after the other.
        signals: the time `t` among them [s].
        step: typical time between two samples [s].
    """
    rate = np.sqrt(np.mean(rates_in(signal, signals) ** 2))
    return float(np.std(signal) / rate) if rate > 0 else step
