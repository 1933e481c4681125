"""Inputs, noises and the integrator of the independent simulations: NumPy and SciPy alone."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import chirp as sweep
from scipy.signal import lfilter

Vector = np.ndarray
Rate = Callable[[float, Vector, float], Vector]


def integrate(rate: Rate, start: Vector, t: Vector, u: Vector, held: bool = True) -> Vector:
    """Return the states at times `t`, integrated from sample to sample (Runge-Kutta 4(5)).

    Args:
        rate: function `dx/dt = rate(t, x, u)`.
        start: state at the first sample.
        t, u: times and input.
        held: True holds the input between samples; False interpolates it linearly.
    """
    states = [np.asarray(start, float)]
    for k in range(t.size - 1):
        slope = 0.0 if held else (u[k + 1] - u[k]) / (t[k + 1] - t[k])

        def of_time(s, x, k=k, slope=slope):
            return rate(s, x, u[k] + slope * (s - t[k]))

        solved = solve_ivp(of_time, (t[k], t[k + 1]), states[-1], rtol=1e-8, atol=1e-10)
        states.append(solved.y[:, -1])
    return np.array(states)


def doublet(t: Vector, start: float, width: float, size: float) -> Vector:
    """Return a doublet."""
    return pulses(t, start, width, (size, -size))


def square_3211(t: Vector, start: float, width: float, size: float) -> Vector:
    """Return a 3-2-1-1 input of some unit width."""
    return pulses(t, start, width, (size,) * 3 + (-size,) * 2 + (size, -size))


def pulses(t: Vector, start: float, width: float, levels: tuple[float, ...]) -> Vector:
    """Return levels of one width from a time on, zero before and after."""
    at = np.floor((t - start) / width + 1e-9).astype(int)
    inside = (at >= 0) & (at < len(levels))
    return np.where(inside, np.array(levels)[np.clip(at, 0, len(levels) - 1)], 0.0)


def chirp(t: Vector, first: float, last: float, size: float) -> Vector:
    """Return a sweep from one frequency [Hz] to another."""
    return size * sweep(t - t[0], first, t[-1] - t[0], last, phi=-90)


def steps(t: Vector, draw: np.random.Generator, duration: float, size: float) -> Vector:
    """Return random levels between `-size` and `size`, each of some duration."""
    at = np.floor((t - t[0]) / duration + 1e-9).astype(int)
    return draw.uniform(-size, size, at[-1] + 1)[at]


def autoregressive(draw: np.random.Generator, count: int, size: float, memory: float) -> Vector:
    """Return first-order noise of standard deviation `size` with a memory of one sample."""
    white = np.sqrt(1.0 - memory**2) * draw.normal(size=count)
    return size * np.asarray(lfilter([1.0], [1.0, -memory], white))


def quantised(y: Vector, step: float) -> Vector:
    """Return values in steps of a converter or an encoder."""
    return step * np.round(y / step)
