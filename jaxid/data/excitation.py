"""Excitation of a record: the power of a channel by frequency, and collinearity of channels."""

import numpy as np

from .._foundation.types import Float

# Common rule (Belsley, Kuh and Welsch, Regression Diagnostics, 1980): channels are collinear from
# this variance inflation factor on, at a correlation of two channels of 0.95.
INFLATION = 10.0
# Chosen: least share of a channel that the others leave, to which rounding limits the regression.
LEAST_SHARE = 1e-16


def power_shares(
    t: Float[np.ndarray, " time"], values: Float[np.ndarray, " time"]
) -> tuple[Float[np.ndarray, " line"], Float[np.ndarray, " line"]]:
    """Return frequencies [rad/s] and the share of the power at each (Hann window, no mean)."""
    grid = np.linspace(t[0], t[-1], len(t))
    window = np.hanning(len(t) + 2)[1:-1]
    even = np.interp(grid, t, values - values.mean())
    even = (even - window @ even / window.sum()) * window
    power = np.abs(np.fft.rfft(even)) ** 2
    total = power.sum()
    w = 2.0 * np.pi * np.fft.rfftfreq(len(t), grid[1] - grid[0])
    return w, power / total if total > 0 else np.full(len(w), 1.0 / len(w))


def share_above(
    t: Float[np.ndarray, " time"], values: Float[np.ndarray, " time"], w: float
) -> float:
    """Return the share of a channel's power above a frequency [rad/s]."""
    lines, shares = power_shares(t, values)
    return float(np.sum(shares[lines > w]))


def variance_inflation(
    channels: Float[np.ndarray, "time channel"],
) -> Float[np.ndarray, " channel"]:
    """Return `1 / (1 - R^2)` of the regression of each channel on the others and a constant.

    The coefficient of a channel in a regression has this number of times the variance that it would
    have if the channels were uncorrelated.

    Args:
        channels: channels that are not constant.
    """
    centred = channels - channels.mean(axis=0)
    unit = centred / np.linalg.norm(centred, axis=0)
    left = np.ones(unit.shape[1])
    for k in range(unit.shape[1] if unit.shape[1] > 1 else 0):
        others = np.delete(unit, k, axis=1)
        theta, *_ = np.linalg.lstsq(others, unit[:, k], rcond=1e-10)
        left[k] = np.sum((unit[:, k] - others @ theta) ** 2)
    return 1.0 / np.maximum(left, LEAST_SHARE)
