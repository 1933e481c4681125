"""Effects in plain NumPy: only class, names and numbers of an effect of `jaxid` are read."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

Signals = dict[str, np.ndarray]
# Substeps between two samples, for rate limits and lags; chosen.
FINE = 10


class Inputs:
    """Inputs, linear between uniform samples, with the effects that act on them.

    Args:
        t: sample times [s].
        u: inputs by name, shape (record, time).
        effects: effects; those that act on inputs are used.
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
        """Return a signal at one time, after its delay."""
        step, values = self.u[name]
        time = min(max(time - self.late.get(name, 0.0), self.t[0]), self.t[-1])
        at = min(int((time - self.t[0]) / step), values.shape[1] - 2)
        share = (time - self.t[0]) / step - at
        return (1.0 - share) * values[:, at] + share * values[:, at + 1]

    def plant_input(self, time: float) -> Signals:
        """Return all inputs after dead zones and position limits."""
        values = {name: self.recorded(name, time) for name in self.u}
        for one in self.bent:
            value = values[one.channel]
            if kind(one) == "InputDeadZone":
                value = value - np.clip(value, -float(one.width), float(one.width))
            else:
                value = (np.minimum if one.end == "upper" else np.maximum)(value, float(one.level))
            values[one.channel] = value
        return values


def _rate_limited(t: np.ndarray, u: np.ndarray, limit: float) -> tuple[float, np.ndarray]:
    """Return the step and values of a rate-limited input on a finer grid."""
    step = (t[1] - t[0]) / FINE
    fine = np.array(
        [np.interp(t[0] + step * np.arange(FINE * (t.size - 1) + 1), t, one) for one in u]
    )
    limited = [fine[:, 0]]
    for wanted in fine.T[1:]:
        limited.append(limited[-1] + np.clip(wanted - limited[-1], -limit * step, limit * step))
    return step, np.array(limited).T


class Memory(NamedTuple):
    """States of an effect, shape (state, record); the first of them acts.

    They are the state of an actuator, a lagged signal, position and velocity of a mode, or z of
    the Bouc-Wen model.
    """

    effect: object
    start: np.ndarray

    def rate(
        self, own: np.ndarray, recorded: Signals, signals: Signals, rates: Signals
    ) -> np.ndarray:
        """Return the rate of the states `own` from recorded inputs, signals and plant rates."""
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
    """Return the states of the effects with their initial values."""
    carried = []
    for one in effects:
        if kind(one) == "InputLag":
            carried.append(Memory(one, u[one.channel][None, :, 0]))
        elif kind(one) == "LaggedSignal":
            carried.append(Memory(one, x0[one.signal][None]))
        elif kind(one) == "Hysteresis":
            carried.append(Memory(one, 0.0 * x0[one.signal][None]))
        elif kind(one) == "Resonance":
            carried.append(Memory(one, np.zeros((2, next(iter(x0.values())).size))))
    return carried


def force(effect, signals: Signals, memory: np.ndarray | None) -> tuple[str, np.ndarray] | None:
    """Return the equation in which an effect acts and its force; None if it adds no force."""
    name, gain = kind(effect), float(effect.gain)
    if name == "Term":
        return effect.state, gain * _product(effect.product, signals)
    if name == "DryFriction":
        return effect.state, gain * np.tanh(signals[effect.speed] / float(effect.width))
    if name == "QuadraticDrag":
        return effect.state, gain * np.abs(signals[effect.speed]) * signals[effect.speed]
    if name == "DeadBand":
        signal, width = signals[effect.signal], float(effect.width)
        return effect.placement.name, gain * (signal - np.clip(signal, -width, width))
    if name == "Hinge":
        return effect.placement.name, gain * np.maximum(
            signals[effect.signal] - float(effect.level), 0.0
        )
    if name == "LaggedSignal":
        return effect.placement.name, gain * (memory - signals[effect.signal])
    if name in ("Hysteresis", "Resonance"):
        return effect.placement.name, gain * memory
    return None


def after_mass_steps(effects: Sequence, time: float, rates: Signals) -> Signals:
    """Return the rates of the plant with the masses of this time."""
    for one in effects:
        if kind(one) == "MassStep" and time > one.time:
            rates = rates | {one.state: rates[one.state] / (1.0 + one.gain)}
    return rates


def _product(product: str, signals: Signals) -> np.ndarray:
    value = np.ones_like(next(iter(signals.values())))
    for factor in () if product == "1" else product.split():
        name, _, power = factor.partition("^")
        value = value * signals[name] ** int(power or 1)
    return value


def read(effects: Sequence, t: np.ndarray, y: np.ndarray, outputs: tuple[str, ...]) -> np.ndarray:
    """Return the sensor readings of the outputs, without the effects that `recorded` applies."""
    clean, y = y, np.array(y)
    for one in effects:
        at = outputs.index(one.channel) if getattr(one, "channel", None) in outputs else 0
        signal, name = y[..., at], kind(one)
        if name == "SensorBias":
            y[..., at] = signal + float(one.gain)
        elif name == "SensorScale":
            y[..., at] = (1.0 + float(one.gain)) * signal
        elif name == "SensorSquare":
            y[..., at] = signal + float(one.gain) * signal**2
        elif name == "SensorAbsolute":
            y[..., at] = signal + float(one.gain) * np.abs(signal)
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
    """Return measured outputs after sensor saturation and quantisation."""
    z = np.array(z)
    for one in effects:
        if kind(one) == "SensorSaturation":
            at = outputs.index(one.channel)
            z[..., at] = (np.minimum if one.end == "upper" else np.maximum)(
                z[..., at], float(one.level)
            )
        elif kind(one) == "SensorQuantisation":
            at = outputs.index(one.channel)
            z[..., at] = float(one.grid) * np.round(z[..., at] / float(one.grid))
    return z


def _lagging(t: np.ndarray, signal: np.ndarray, lag: float) -> np.ndarray:
    """Return a signal after a first-order lag, exact for straight lines on a finer grid."""
    fine = np.linspace(t[0], t[-1], FINE * (t.size - 1) + 1)
    values, step = CubicSpline(t, signal, axis=1)(fine), fine[1] - fine[0]
    keep, error, lagged = np.exp(-step / lag), np.zeros(len(signal)), [signal[:, 0]]
    for now, then in zip(values.T[:-1], values.T[1:], strict=True):
        error = keep * error + lag * (then - now) / step * (1.0 - keep)
        lagged.append(then - error)
    return np.array(lagged[::FINE]).T


def kind(effect) -> str:
    """Return the name of an effect's class."""
    return type(effect).__name__
