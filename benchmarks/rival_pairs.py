"""Ten pairs of effects that a first flight cannot tell apart, on a spring and a small aircraft."""

import math
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from jaxid import AbstractModel, FixedNoise, OutputError
from jaxid._foundation.types import Array
from jaxid.design import InputSignal, Limits, alternating_pulses, combine, sample_times
from jaxid.effects import (
    DeadBand,
    DryFriction,
    Effect,
    InputDelay,
    InputHysteresis,
    InputLag,
    InputRateLimit,
    QuadraticDrag,
    SensorDelay,
    SensorLag,
    Term,
)
from jaxid.effects.placement import Placement

DEG = math.pi / 180.0
IN_V = Placement.equation("v")


class Spring(AbstractModel):
    """`dv/dt = force - k x - c v`, position measured."""

    k: Array
    c: Array
    states, inputs, outputs = ("x", "v"), ("force",), ("position",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1]])

    def output(self, t, x, u):
        return x[:1]


class ShortPeriod(AbstractModel):
    """Angle of attack and pitch rate about a trim, with a lift curve that flattens.

        d(alpha)/dt = q - lift,    lift = L alpha - bend alpha^3 + Ld elevator
        dq/dt = Ma alpha + Mq q + Md elevator

    The signal `load` is the normal force, trim included, in units of `lift`.
    """

    L: Array
    Ld: Array
    bend: Array
    trim_lift: Array
    Ma: Array
    Mq: Array
    Md: Array
    states, inputs, outputs = ("alpha", "q"), ("elevator",), ("alpha_vane", "q_gyro")

    def rhs(self, t, x, u):
        alpha, q = x
        moment = self.Ma * alpha + self.Mq * q + self.Md * u[0]
        return jnp.stack([q - self._lift(alpha, u[0]), moment])

    def output(self, t, x, u):
        return x

    def signals(self, t, x, u):
        alpha, q = x
        lift = self._lift(alpha, u[0])
        return {
            "alpha": alpha,
            "q": q,
            "elevator": u[0],
            "alphadot": q - lift,
            "load": self.trim_lift + lift,
        }

    def _lift(self, alpha, elevator):
        return self.L * alpha - self.bend * alpha**3 + self.Ld * elevator


class Pair(NamedTuple):
    """Two effects, either of which may be the truth, and the flights that are possible.

    Attributes:
        words: the pair in words.
        model: the declared model, with its true values.
        declared: names of its free parameters.
        effects: both effects with their true values.
        estimated: fields of each that are estimated.
        first: input of the first flight.
        likelihood: with the noise of the sensors.
        limits: of the next flight.
        frequency: of the mode [Hz].
    """

    words: str
    model: AbstractModel
    declared: tuple[str, ...]
    effects: tuple[Effect, Effect]
    estimated: tuple[tuple[str, ...], tuple[str, ...]]
    first: InputSignal
    likelihood: OutputError
    limits: Limits
    frequency: float


def spring_pair(
    words: str,
    effects: tuple[Effect, Effect],
    estimated: tuple[tuple[str, ...], tuple[str, ...]] = (("gain",), ("gain",)),
    *,
    first: Callable[[Array], Array],
    force: float,
    reach: float,
    sigma: float = 0.02,
    declared: tuple[str, ...] = ("k", "c"),
) -> Pair:
    """Return a pair on the spring.

    Args:
        words, effects, estimated, declared: as in `Pair`.
        first: force of the first record as a function of time [N].
        force, reach: largest force [N] and distance [m] of the next record, about three
            and two times those of the first.
        sigma: standard deviation of the noise [m].
    """
    t = sample_times(14.0, 0.1)
    return Pair(
        words,
        Spring(jnp.array(1.5), jnp.array(0.3)),
        declared,
        effects,
        estimated,
        combine(t, {"force": first(t)}, ("force",), name="first"),
        OutputError(FixedNoise(jnp.array([sigma**2]))).compact(),
        Limits({"force": force}, rate={"force": 10.0 * force}, envelope={"x": (-reach, reach)}),
        math.sqrt(1.5) / (2.0 * math.pi),
    )


def aircraft_pair(
    words: str,
    effects: tuple[Effect, Effect],
    estimated: tuple[tuple[str, ...], tuple[str, ...]] = (("gain",), ("gain",)),
    *,
    first: Callable[[Array], Array],
    elevator: float,
    alpha: float,
    declared: tuple[str, ...] = ("L", "Ma", "Mq", "Md"),
) -> Pair:
    """Return a pair on the short period.

    Args:
        words, effects, estimated, declared: as in `Pair`.
        first: elevator of the first flight as a function of time [deg].
        elevator, alpha: largest deflection and angle of attack of the next flight, from trim [deg].
    """
    t = sample_times(10.0, 0.05)
    model = ShortPeriod(*map(jnp.array, (1.0, 0.1, 8.0, 0.3, -5.0, -1.2, -8.0)))
    return Pair(
        words,
        model,
        declared,
        effects,
        estimated,
        combine(t, {"elevator": DEG * first(t)}, ("elevator",), name="first"),
        OutputError(FixedNoise(jnp.array([0.1, 0.15]) ** 2 * DEG**2)).compact(),
        Limits(
            {"elevator": elevator * DEG},
            rate={"elevator": 10.0 * elevator * DEG},
            envelope={"alpha": (-alpha * DEG, alpha * DEG)},
        ),
        0.39,
    )


def doublet(peak: float, width: float) -> Callable[[Array], Array]:
    """Return a doublet as a function of time; with two widths a step is one pulse."""
    return lambda t: peak * alternating_pulses(t, (width, width), 0.5)


def step(peak: float) -> Callable[[Array], Array]:
    """Return a step as a function of time."""
    return lambda t: jnp.where(t >= 0.5, peak, 0.0)


def sine(peak: float, frequency: float) -> Callable[[Array], Array]:
    """Return a sine as a function of time."""
    return lambda t: peak * jnp.sin(2.0 * jnp.pi * frequency * t)


def _with(effect: Effect, **values: float) -> Effect:
    """Return an effect with values in some of its array fields."""
    for name, value in values.items():
        effect = eqx.tree_at(lambda e, name=name: getattr(e, name), effect, jnp.asarray(value))
    return effect


def pairs() -> list[Pair]:
    """Return the ten pairs."""
    return [
        spring_pair(
            "dry friction; dead band of the damper",
            (
                _with(DryFriction("v", "v"), gain=-0.022, width=0.01),
                _with(DeadBand(IN_V, "v"), gain=-0.4, width=0.1, centre=0.0),
            ),
            first=doublet(0.3, 2.2),
            force=0.9,
            reach=0.9,
            declared=("k", "c"),
        ),
        spring_pair(
            "lag of the force; delay of the force",
            (_with(InputLag("force"), gain=1.0, time=0.2), _with(InputDelay("force"), gain=0.2)),
            (("time",), ("gain",)),
            first=doublet(0.17, 2.2),
            force=0.55,
            reach=0.7,
        ),
        spring_pair(
            "x^2 in the spring; steady force",
            (_with(Term("v", "x^2"), gain=-0.7), _with(Term("v", "1"), gain=-0.022)),
            first=step(0.3),
            force=0.9,
            reach=0.6,
        ),
        spring_pair(
            "quadratic drag; damping that grows with x^2",
            (_with(QuadraticDrag("v", "v"), gain=-0.4), _with(Term("v", "x^2 v"), gain=-8.0)),
            first=sine(0.1, 0.195),
            force=0.3,
            reach=0.4,
            declared=("k",),
        ),
        spring_pair(
            "lag of the sensor; delay of the sensor",
            (_with(SensorLag("position"), gain=0.15), _with(SensorDelay("position"), gain=0.15)),
            first=doublet(0.2, 2.2),
            force=0.55,
            reach=0.7,
        ),
        aircraft_pair(
            "Cm of q; Cm of alpha-dot",
            (_with(Term("q", "q"), gain=-1.5), _with(Term("q", "alphadot"), gain=-1.5)),
            first=doublet(1.0, 1.0),
            elevator=6.0,
            alpha=12.0,
            declared=("L", "Ma", "Md"),
        ),
        aircraft_pair(
            "centre of gravity; moment bias",
            (_with(Term("q", "load"), gain=0.1), _with(Term("q", "1"), gain=0.03)),
            first=doublet(0.3, 1.0),
            elevator=1.0,
            alpha=2.0,
            declared=("L", "Mq", "Md"),
        ),
        aircraft_pair(
            "rate limit of the elevator; lag of the elevator",
            (
                _with(InputRateLimit("elevator"), gain=1.0, limit=3.0 * DEG),
                _with(InputLag("elevator"), gain=1.0, time=0.1),
            ),
            (("limit",), ("time",)),
            first=doublet(0.3, 1.0),
            elevator=1.2,
            alpha=1.6,
        ),
        aircraft_pair(
            "alpha^3 in Cm; alpha^5 in Cm",
            (_with(Term("q", "alpha^3"), gain=-150.0), _with(Term("q", "alpha^5"), gain=-15000.0)),
            first=doublet(2.1, 1.0),
            elevator=6.0,
            alpha=7.0,
        ),
        aircraft_pair(
            "hysteresis of the elevator; lag of the elevator",
            (
                _with(InputHysteresis("elevator"), gain=0.07 * DEG, width=0.07 * DEG),
                _with(InputLag("elevator"), gain=1.0, time=0.1),
            ),
            (("gain",), ("time",)),
            first=sine(0.35, 0.4),
            elevator=1.4,
            alpha=1.6,
        ),
    ]
