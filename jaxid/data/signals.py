"""Test signals: pure functions of time, for simulated experiments and for the design of real ones.

The first argument of each function is an array of times, so that a signal can be evaluated between
samples and differentiated.
"""

from collections.abc import Sequence

import jax.numpy as jnp

from .._foundation.checks import require
from .._foundation.types import Array, Float

Times = Float[Array, "*time"]
Value = Array | float | int


def step(t: Times, start: Value = 0.0, amplitude: Value = 1.0) -> Times:
    """A step, `u = a` for `t >= start`, else 0.

    Args:
        t: times, of any shape [s].
        start: time of the step [s].
        amplitude: height `a` [any unit].

    Returns:
        The signal at each time [the amplitude's unit].
    """
    return jnp.where(t >= start, amplitude, 0.0)


def pulses(t: Times, edges: Array | Sequence[float], levels: Array | Sequence[float]) -> Times:
    """Constant levels between edges in time, `u = levels[i]` for `edges[i] <= t < edges[i+1]`, else
    0.

    Args:
        t: times, of any shape [s].
        edges: increasing times, shape (level + 1,) [s].
        levels: values between them, shape (level,) [any unit].

    Returns:
        The signal at each time [the levels' unit].

    Raises:
        InputError: when the number of edges is not the number of levels plus one.
    """
    edges, levels = jnp.asarray(edges, float), jnp.asarray(levels, float)
    require(
        edges.shape[0] == levels.shape[0] + 1,
        f"There are {edges.shape[0]} edges and {levels.shape[0]} levels. Give one edge more than "
        "levels.",
    )
    padded = jnp.concatenate([jnp.zeros(1), levels, jnp.zeros(1)])
    return padded[jnp.searchsorted(edges, t, side="right")]


def doublet(t: Times, start: Value = 0.0, width: Value = 1.0, amplitude: Value = 1.0) -> Times:
    """A pulse of one width followed by one of the opposite sign.

    Its energy has its maximum near `0.37 / width` [Hz], and its mean is zero, so that the motion
    returns to trim.

    Args:
        t: times, of any shape [s].
        start: time of the first edge [s].
        width: length of each of the two pulses [s].
        amplitude: height [any unit].

    Returns:
        The signal at each time [the amplitude's unit].
    """
    return pulses(t, start + width * jnp.arange(3.0), amplitude * jnp.array([1.0, -1.0]))


def three_two_one_one(
    t: Times, start: Value = 0.0, width: Value = 1.0, amplitude: Value = 1.0
) -> Times:
    """Four pulses of 3, 2, 1 and 1 widths with alternating sign.

    Its band is broader than the band of the doublet.

    Source: P. Hamel, R. Jategaonkar, Evolution of flight vehicle system identification, J. Aircraft
    33(1), 1996 (the input devised by K. H. Koehler and M. Marchand at DLR).

    Args:
        t: times, of any shape [s].
        start: time of the first edge [s].
        width: length of the shortest pulse [s].
        amplitude: height [any unit].

    Returns:
        The signal at each time [the amplitude's unit]; its mean over the 7 widths is `amplitude /
        7`.
    """
    edges = start + width * jnp.array([0.0, 3.0, 5.0, 6.0, 7.0])
    return pulses(t, edges, amplitude * jnp.array([1.0, -1.0, 1.0, -1.0]))


def ramp(t: Times, start: Value = 0.0, stop: Value = 1.0, amplitude: Value = 1.0) -> Times:
    """A linear rise from 0 to `a`, `u = a (t - start) / (stop - start)` between `start` and `stop`,
    0 before and `a` after.

    Args:
        t: times, of any shape [s].
        start: time at which the rise begins [s].
        stop: time at which the signal reaches the amplitude, after `start` [s].
        amplitude: final height `a` [any unit].

    Returns:
        The signal at each time [the amplitude's unit].
    """
    return amplitude * jnp.clip((t - start) / (stop - start), 0.0, 1.0)


def sine(t: Times, frequency: Value, amplitude: Value = 1.0, phase: Value = 0.0) -> Times:
    """A sine, `u = a sin(2 pi f t + phase)`.

    Args:
        t: times, of any shape [s].
        frequency: `f` [Hz].
        amplitude: `a` [any unit].
        phase: at time zero [rad].

    Returns:
        The signal at each time [the amplitude's unit].
    """
    return amplitude * jnp.sin(2 * jnp.pi * frequency * t + phase)


def half_sine(t: Times, start: Value = 0.0, width: Value = 1.0, amplitude: Value = 1.0) -> Times:
    """A half period of a sine, `u = a sin(pi (t - start) / width)` for `start <= t <= start +
    width`, else 0: a smooth pulse.

    Args:
        t: times, of any shape [s].
        start: time at which the pulse begins [s].
        width: length of the half period [s].
        amplitude: height `a` [any unit].

    Returns:
        The signal at each time [the amplitude's unit].
    """
    return amplitude * jnp.sin(jnp.pi * jnp.clip((t - start) / width, 0.0, 1.0))


def full_sine(t: Times, start: Value = 0.0, period: Value = 1.0, amplitude: Value = 1.0) -> Times:
    """One period of a sine, `u = a sin(2 pi (t - start) / period)`, else 0: a smooth doublet.

    The report's aileron input is one of 7 deg and 2.5 s (section 6.2.1, Fig. 6.2a).

    Args:
        t: times, of any shape [s].
        start: time at which the period begins [s].
        period: length of the period [s].
        amplitude: height `a` [any unit].

    Returns:
        The signal at each time [the amplitude's unit].
    """
    turns = (t - start) / period
    return jnp.where((turns > 0) & (turns < 1), amplitude * jnp.sin(2 * jnp.pi * turns), 0.0)


def linear_sweep(
    t: Times, duration: Value, low: Value, high: Value, amplitude: Value = 1.0
) -> Times:
    """A sine whose frequency rises linearly with time, `f(t) = low + (high - low) t / T`.

    `u = a sin(2 pi (low t + (high - low) t^2 / (2 T)))` for `0 <= t <= T`, else 0.

    Args:
        t: times, of any shape [s].
        duration: length `T` [s].
        low: frequency at time zero [Hz].
        high: frequency at the end [Hz].
        amplitude: `a` [any unit].

    Returns:
        The signal at each time [the amplitude's unit].
    """
    turns = low * t + (high - low) * t**2 / (2 * duration)
    return jnp.where((t >= 0) & (t <= duration), amplitude * jnp.sin(2 * jnp.pi * turns), 0.0)


def log_sweep(t: Times, duration: Value, low: Value, high: Value, amplitude: Value = 1.0) -> Times:
    """A sine whose frequency rises exponentially with time, `f(t) = low (high / low)^(t / T)`.

    `u = a sin(2 pi low T / L (exp(L t / T) - 1))` with `L = log(high / low)` for `0 <= t <= T`,
    else 0.

    Args:
        t: times, of any shape [s].
        duration: length `T` [s].
        low: frequency at time zero, positive [Hz].
        high: frequency at the end, positive and not `low` [Hz].
        amplitude: `a` [any unit].

    Returns:
        The signal at each time [the amplitude's unit].
    """
    octaves = jnp.log(jnp.asarray(high / low))
    turns = low * duration / octaves * jnp.expm1(octaves * jnp.clip(t / duration, 0.0, 1.0))
    return jnp.where((t >= 0) & (t <= duration), amplitude * jnp.sin(2 * jnp.pi * turns), 0.0)
