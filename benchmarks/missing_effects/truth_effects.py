"""Effects once more in plain NumPy: of an effect of `jaxid` only its kind, its names and its numbers are read."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

Signals = dict[str, np.ndarray]
FINE = 10  # parts of a step between two samples, for what has a memory on its way to the plant or the record


class Inputs:
    """Inputs in straight lines between uniform samples, with what acts on them on their way.

    Args:
        t: sample times [s].
        u: by name, shape (record, time).
        effects: those that act on inputs are used.
    """

    def __init__(self, t: np.ndarray, u: Signals, effects: Sequence = ()):
        self.t = t
        self.late = {one.channel: float(one.gain) for one in effects if kind(one) == "InputDelay"}
        self.bent = [one for one in effects if kind(one) in ("InputDeadZone", "InputPositionLimit")]
        self.u = {name: (t[1] - t[0], signal) for name, signal in u.items()}
        for one in effects:
            if kind(one) == "InputRateLimit":
                self.u[one.channel] = _rate_limited(t, u[one.channel], float(one.limit))

    def recorded(self, name: str, time: float) -> np.ndarray:
        """A signal at one time, late where it acts late."""
        step, values = self.u[name]
        time = min(max(time - self.late.get(name, 0.0), self.t[0]), self.t[-1])
        at = min(int((time - self.t[0]) / step), values.shape[1] - 2)
        share = (time - self.t[0]) / step - at
        return (1.0 - share) * values[:, at] + share * values[:, at + 1]

    def acting(self, time: float) -> Signals:
        """All inputs, behind dead zones and stops."""
        found = {name: self.recorded(name, time) for name in self.u}
        for one in self.bent:
            value = found[one.channel]
            if kind(one) == "InputDeadZone":
                value = value - np.clip(value, -float(one.width), float(one.width))
            else:
                value = (np.minimum if one.end == "upper" else np.maximum)(value, float(one.level))
            found[one.channel] = value
        return found


def _rate_limited(t: np.ndarray, u: np.ndarray, limit: float) -> tuple[float, np.ndarray]:
    """What follows an input no faster than a limit, on a finer grid."""
    step = (t[1] - t[0]) / FINE
    fine = np.array([np.interp(t[0] + step * np.arange(FINE * (t.size - 1) + 1), t, one) for one in u])
    found = [fine[:, 0]]
    for wanted in fine.T[1:]:
        found.append(found[-1] + np.clip(wanted - found[-1], -limit * step, limit * step))
    return step, np.array(found).T


class Memory(NamedTuple):
    """States that an effect carries, shape (state, record): an actuator's, a lagged signal, a mode's place and speed, or
    Bouc's and Wen's z. The first of them is what acts."""

    effect: object
    start: np.ndarray

    def rate(self, own: np.ndarray, recorded: Signals, signals: Signals, rates: Signals) -> np.ndarray:
        """Of the state, from itself, the recorded inputs, the signals and the plant's rates."""
        one = self.effect
        if kind(one) == "InputLag":
            return (recorded[one.channel] - own) / float(one.time)
        if kind(one) == "LaggedSignal":
            return (signals[one.signal] - own) / float(one.time)
        if kind(one) == "Resonance":
            at, speed = own
            w, damping = float(one.frequency), float(one.damping)
            return np.stack([speed, w**2 * (signals[one.signal] - at) - 2 * damping * w * speed])
        ds = rates[one.signal]
        return (ds - 0.5 * (np.abs(ds) * np.abs(own) * own + ds * own**2)) / float(one.width)


def memories(effects: Sequence, x0: Signals, u: Signals) -> list[Memory]:
    """What effects carry, and where it starts."""
    found = []
    for one in effects:
        if kind(one) == "InputLag":
            found.append(Memory(one, u[one.channel][None, :, 0]))
        elif kind(one) == "LaggedSignal":
            found.append(Memory(one, x0[one.signal][None]))
        elif kind(one) == "Hysteresis":
            found.append(Memory(one, 0.0 * x0[one.signal][None]))
        elif kind(one) == "Resonance":
            found.append(Memory(one, np.zeros((2, next(iter(x0.values())).size))))
    return found


def force(effect, signals: Signals, memory: np.ndarray | None) -> tuple[str, np.ndarray] | None:
    """The equation in which an effect acts, and what it adds there; None where it acts elsewhere."""
    name, gain = kind(effect), float(effect.gain)
    if name == "Term":
        return effect.state, gain * _product(effect.product, signals)
    if name == "DryFriction":
        return effect.state, gain * np.tanh(signals[effect.speed] / float(effect.width))
    if name == "QuadraticDrag":
        return effect.state, gain * np.abs(signals[effect.speed]) * signals[effect.speed]
    if name == "DeadBand":
        signal, width = signals[effect.signal], float(effect.width)
        return effect.acting.name, gain * (signal - np.clip(signal, -width, width))
    if name == "Hinge":
        return effect.acting.name, gain * np.maximum(signals[effect.signal] - float(effect.level), 0.0)
    if name == "LaggedSignal":
        return effect.acting.name, gain * (memory - signals[effect.signal])
    if name in ("Hysteresis", "Resonance"):
        return effect.acting.name, gain * memory
    return None


def _product(product: str, signals: Signals) -> np.ndarray:
    value = np.ones_like(next(iter(signals.values())))
    for factor in () if product == "1" else product.split():
        name, _, power = factor.partition("^")
        value = value * signals[name] ** int(power or 1)
    return value


def read(effects: Sequence, t: np.ndarray, y: np.ndarray, outputs: tuple[str, ...]) -> np.ndarray:
    """What sensors make of the outputs, but for what acts on the noise as well (`recorded`)."""
    clean, y = y, np.array(y)
    for one in effects:
        at = outputs.index(one.channel) if getattr(one, "channel", None) in outputs else 0
        signal, name = y[..., at], kind(one)
        if name == "SensorBias":
            y[..., at] = signal + float(one.gain)
        elif name == "SensorScale":
            y[..., at] = (1.0 + float(one.gain)) * signal
        elif name == "SensorDrift":
            y[..., at] = signal + float(one.gain) * (t - t[0])
        elif name == "SensorCrossTalk":
            y[..., at] = signal + float(one.gain) * clean[..., outputs.index(one.source)]
        elif name == "SensorDelay":
            y[..., at] = CubicSpline(t, signal, axis=1)(np.maximum(t - float(one.gain), t[0]))
        elif name == "SensorLag":
            y[..., at] = _lagging(t, signal, float(one.gain))
    return y


def recorded(effects: Sequence, z: np.ndarray, outputs: tuple[str, ...]) -> np.ndarray:
    """Measured outputs that cannot go beyond a sensor's stop, or are recorded in steps."""
    z = np.array(z)
    for one in effects:
        if kind(one) == "SensorSaturation":
            at = outputs.index(one.channel)
            z[..., at] = (np.minimum if one.end == "upper" else np.maximum)(z[..., at], float(one.level))
        elif kind(one) == "SensorQuantisation":
            at = outputs.index(one.channel)
            z[..., at] = float(one.grid) * np.round(z[..., at] / float(one.grid))
    return z


def _lagging(t: np.ndarray, signal: np.ndarray, lag: float) -> np.ndarray:
    """A first-order lag of a signal, exact for straight lines on a grid finer than the samples."""
    fine = np.linspace(t[0], t[-1], FINE * (t.size - 1) + 1)
    values, step = CubicSpline(t, signal, axis=1)(fine), fine[1] - fine[0]
    keep, error, found = np.exp(-step / lag), np.zeros(len(signal)), [signal[:, 0]]
    for now, then in zip(values.T[:-1], values.T[1:], strict=True):
        error = keep * error + lag * (then - now) / step * (1.0 - keep)
        found.append(then - error)
    return np.array(found[::FINE]).T


def kind(effect) -> str:
    """The name of an effect's class."""
    return type(effect).__name__
