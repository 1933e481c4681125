"""The systems: declared models, and records of truths that have more than these."""
# Pyright counts equinox's abstract fields as arguments of the constructor.
# pyright: reportCallIssue=false, reportArgumentType=false

import enum
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxid import AbstractModel, Record, record
from jaxid._foundation.types import Array

from .signals import (
    autoregressive,
    chirp,
    doublet,
    integrate,
    quantised,
    square_3211,
    steps,
)

RECORDS = 5  # three to fit, one to decide, one to report


class Answer(enum.Enum):
    """The right answer to a study.

    Attributes:
        NAMED: the effect is in the library, and the records determine it.
        PROXIES: no cause may be named, as the effect is outside the library, or another one does
            the same to these records.
        NOTHING: nothing is missing that the records show.
        FORCES: random forces.
    """

    NAMED = enum.auto()
    PROXIES = enum.auto()
    NOTHING = enum.auto()
    FORCES = enum.auto()


class System(NamedTuple):
    """A system with its truth.

    Attributes:
        name: the name.
        truth: the effect that the declared model lacks, in words.
        model: the declared model.
        free: free parameters.
        measure: function from the number of a record to the record.
        answer: the right answer.
        families: families of the effects that are missing, where the answer is `NAMED`.
        held: True if the input is held between samples.
    """

    name: str
    truth: str
    model: AbstractModel
    free: tuple[str, ...]
    measure: Callable[[int], Record]
    answer: Answer
    families: frozenset[str] = frozenset()
    held: bool = True


class Motor(AbstractModel):
    """`dw/dt = b volt - a w`."""

    a: Array
    b: Array
    states, inputs, outputs = ("w",), ("volt",), ("w",)

    def rhs(self, t, x, u):
        return jnp.stack([self.b * u[0] - self.a * x[0]])


class Spring(AbstractModel):
    """`dv/dt = b force - k x - c v`, with one sensor."""

    k: Array
    c: Array
    b: Array
    states, inputs, outputs = ("x", "v"), ("force",), ("x",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], self.b * u[0] - self.k * x[0] - self.c * x[1]])


class ShortPeriod(AbstractModel):
    """Short period of a light jet, from the position of the elevator."""

    Za: Array
    Zd: Array
    Ma: Array
    Mq: Array
    Md: Array
    states, inputs, outputs = ("alpha", "q"), ("de",), ("alpha", "q")

    def rhs(self, t, x, u):
        dalpha = self.Za * x[0] + x[1] + self.Zd * u[0]
        return jnp.stack([dalpha, self.Ma * x[0] + self.Mq * x[1] + self.Md * u[0]])


class Rotor(AbstractModel):
    """Pitch axis of a quadrotor, from the command."""

    b: Array
    d: Array
    states, inputs, outputs = ("theta", "q"), ("cmd",), ("theta", "q")

    def rhs(self, t, x, u):
        return jnp.stack([x[1], self.b * u[0] - self.d * x[1]])

    def actuated(self):
        return ("cmd",)


class Ship(AbstractModel):
    """Yaw after Nomoto, `T dr/dt = K delta - r`."""

    K: Array
    T: Array
    states, inputs, outputs = ("r", "psi"), ("delta",), ("r", "psi")

    def rhs(self, t, x, u):
        return jnp.stack([(self.K * u[0] - x[0]) / self.T, x[0]])


class Tank(AbstractModel):
    """`dh/dt = k pump - c sqrt(h)`."""

    k: Array
    c: Array
    states, inputs, outputs = ("h",), ("pump",), ("h",)

    def rhs(self, t, x, u):
        return jnp.stack([self.k * u[0] - self.c * jnp.sqrt(jnp.maximum(x[0], 1e-6))])


class Oven(AbstractModel):
    """`dT/dt = g power - h (T - 293 K)`."""

    h: Array
    g: Array
    states, inputs, outputs = ("T",), ("power",), ("T",)

    def rhs(self, t, x, u):
        return jnp.stack([self.g * u[0] - self.h * (x[0] - 293.0)])


class Roll(AbstractModel):
    """Roll of a boat with a fin."""

    w2: Array
    d: Array
    b: Array
    states, inputs, outputs = ("p", "phi"), ("fin",), ("p", "phi")

    def rhs(self, t, x, u):
        return jnp.stack([self.b * u[0] - self.w2 * x[1] - self.d * x[0], x[0]])


def recorded(model: AbstractModel, t, u, z) -> Record:
    """Return the record of a system."""
    return record(t, np.reshape(u, (-1, 1)), z, inputs=model.inputs, outputs=model.outputs)


def motor_load(number: int) -> Record:
    """A constant torque."""
    draw, t = np.random.default_rng(2300 + number), 0.02 * np.arange(400)
    u = chirp(t, 0.2, 1.5, 5.0) if number % 2 else steps(t, draw, 0.4, 6.0)
    w = integrate(lambda _, x, v: 30.0 * v - 3.0 * x - 3.0, np.zeros(1), t, u)
    return recorded(MOTOR, t, u, w + 0.3 * draw.normal(size=w.shape))


def motor_gain(number: int) -> Record:
    """A supply that sags twice in each record, at random times."""
    draw, t = np.random.default_rng(1300 + number), 0.02 * np.arange(500)
    u = chirp(t, 0.2, 1.5, 5.0) if number % 2 else steps(t, draw, 0.5, 6.0)
    early, late = draw.uniform(1.5, 4.0), draw.uniform(6.0, 8.5)

    def gain(s):
        return 30.0 * (
            1.0
            - 0.35 * np.exp(-(((s - early) / 0.6) ** 2))
            - 0.25 * np.exp(-(((s - late) / 0.9) ** 2))
        )

    w = integrate(lambda s, x, v: gain(s) * v - 3.0 * x, np.zeros(1), t, u)
    return recorded(MOTOR, t, u, w + 0.4 * draw.normal(size=w.shape))


def spring_lag(number: int) -> Record:
    """A lag of the input; in a linear system of one input and one output a lag of the sensor is the
    same.
    """
    draw, t = np.random.default_rng(2200 + number), 0.02 * np.arange(500)
    u = np.where(t < 0.4, 0.0, chirp(t, 0.2, 1.5, 3.0) if number % 2 else steps(t, draw, 0.9, 4.0))

    def rate(_, x, force):
        return np.array([x[1], x[2] - 20.0 * x[0] - 1.2 * x[1], (force - x[2]) / 0.12])

    x = integrate(rate, np.zeros(3), t, u, held=False)[:, :1]
    return recorded(SPRING, t, u, x + 0.002 * draw.normal(size=x.shape))


def cut(number: int, size: float, rate, states: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, inputs and states of the last 10 s of a run of 18 s under a multisine."""
    draw, t = np.random.default_rng(2400 + number), 0.02 * np.arange(900)
    frequencies, phases = np.array([0.2, 0.45, 0.7, 1.1, 1.6, 2.3]), draw.uniform(0, 2 * np.pi, 6)
    u = size * np.sum(np.sin(2 * np.pi * frequencies * t[:, None] + phases), axis=1)
    x = integrate(rate, np.zeros(states), t, u)
    return t[:500], u[400:], x[400:]


def spring_in_motion(number: int) -> Record:
    """The same lag of the input, in records that begin in motion."""

    def rate(_, x, force):
        return np.array([x[1], x[2] - 20.0 * x[0] - 1.2 * x[1], (force - x[2]) / 0.25])

    t, u, x = cut(number, 4.0, rate, 3)
    noise = 0.004 * np.random.default_rng(2500 + number).normal(size=(t.size, 1))
    return recorded(SPRING, t, u, x[:, :1] + noise)


def rotor_in_motion(number: int) -> Record:
    """Rotors that lag behind their command by 150 ms, in records that begin in motion."""

    def rate(_, x, command):
        return np.array([x[1], 12.0 * x[2] - 0.8 * x[1], (command - x[2]) / 0.15])

    t, u, x = cut(number, 0.5, rate, 3)
    noise = np.random.default_rng(2600 + number).normal(size=(t.size, 2)) * [0.003, 0.02]
    return recorded(ROTOR, t, u, x[:, :2] + noise)


def spring_fatigue(number: int) -> Record:
    """A stiffness that falls with the square of the position, with a memory of 4 s."""
    draw, t = np.random.default_rng(1500 + number), 0.05 * np.arange(600)
    u = chirp(t, 0.1, 0.5, 0.8) if number % 2 else steps(t, draw, 1.5, 1.3)

    def rate(_, x, force):
        stiffness = 2.0 * (1.0 - 0.6 * np.tanh(x[2]))
        return np.array(
            [x[1], force - stiffness * x[0] - 0.3 * x[1], (1.5 * x[0] ** 2 - x[2]) / 4.0]
        )

    x = integrate(rate, np.zeros(3), t, u, held=False)[:, :1]
    return recorded(SPRING, t, u, x + 0.005 * draw.normal(size=x.shape))


def elevator(t, number: int, size: float):
    """Return the elevator of a flight [rad]."""
    size = np.radians(size)
    return (
        square_3211(t, 0.5, 0.4, size),
        doublet(t, 0.5, 0.8, size) - doublet(t, 5.0, 0.4, size),
        chirp(t, 0.2, 1.6, 0.7 * size),
        square_3211(t, 0.5, 0.55, -size) + doublet(t, 6.0, 0.5, size),
        doublet(t, 0.5, 0.5, -size) + doublet(t, 3.5, 1.0, size),
    )[number]


def short_period(x, de):
    """Return the rates of the true short period."""
    dalpha = x[1] - 1.1 * x[0] - 0.12 * de
    return np.array([dalpha, -7.0 * x[0] - 1.5 * x[1] - 11.0 * de])


def stall(number: int) -> Record:
    """Above 10 deg the lift curve loses 60 % of its slope, and the nose drops."""
    draw, t = np.random.default_rng(800 + number), 0.02 * np.arange(500)
    u = elevator(t, number, 9.0) - np.radians(3.0)
    start = np.linalg.solve([[1.1, -1.0], [7.0, 1.5]], [-0.12 * u[0], -11.0 * u[0]])

    def rate(_, x, de):
        beyond = max(x[0] - np.radians(10.0), 0.0)
        return short_period(x, de) + np.array([0.66, -4.0]) * beyond

    x = integrate(rate, start, t, u, held=False)
    return recorded(AIRCRAFT, t, u, x + np.radians([0.1, 0.15]) * draw.normal(size=x.shape))


def late_vane(number: int) -> Record:
    """The vane is 80 ms late, and its noise coloured."""
    draw, t = np.random.default_rng(700 + number), 0.02 * np.arange(-4, 500)
    u = np.where(t < 0, 0.0, elevator(t, number, 4.0))
    x = integrate(lambda _, x, de: short_period(x, de), np.zeros(2), t, u, held=False)
    alpha = x[:-4, 0] + autoregressive(draw, 500, np.radians(0.08), 0.7)
    q = x[4:, 1] + np.radians(0.15) * draw.normal(size=500)
    return recorded(AIRCRAFT, t[4:], u[4:], np.stack([alpha, q], axis=1))


def alpha_dot(number: int) -> Record:
    """A derivative with respect to alpha-dot, which Ma, Mq and Md take up in full."""
    draw, t = np.random.default_rng(900 + number), 0.02 * np.arange(500)
    u = elevator(t, number, 4.0)

    def rate(_, x, de):
        dalpha, dq = short_period(x, de)
        return np.array([dalpha, dq - 0.8 * dalpha])

    x = integrate(rate, np.zeros(2), t, u, held=False)
    noisy = x + np.radians([0.1, 0.15]) * draw.normal(size=x.shape)
    return recorded(AIRCRAFT, t, u, quantised(noisy, np.radians(0.1)))


def rotor(number: int) -> Record:
    """Rotors that lag behind their command by 50 ms, in closed loop from rest."""
    draw, t = np.random.default_rng(600 + number), 0.01 * np.arange(600)
    target = square_3211(t, 0.5, 0.5, 0.3) if number % 2 else steps(t, draw, 0.8, 0.35)
    target, x, commands, measured = np.where(t < 0.1, 0.0, target), np.zeros(3), [], []
    for wanted in target:
        z = x[:2] + np.array([0.003, 0.01]) * draw.normal(size=2)
        command = 0.0 if not commands else np.clip(3.0 * (wanted - z[0]) - 0.5 * z[1], -1.0, 1.0)
        commands.append(command)
        measured.append(z)

        def rate(_, x, u):
            return np.array([x[1], 20.0 * x[2] - 0.4 * x[1], (u - x[2]) / 0.05])

        x = integrate(rate, x, np.array([0.0, 0.01]), np.full(2, command))[-1]
    return recorded(ROTOR, t, np.array(commands), np.array(measured))


def ship(number: int) -> Record:
    """Zigzags with a cubic resistance (Norrbin), in waves, with a compass in steps of 0.1 deg."""
    draw, t = np.random.default_rng(300 + number), np.arange(500.0)
    angle = np.radians([10.0, 20.0, 15.0, 20.0, 12.0][number])
    x, rudder, side, states, rudders = np.zeros(2), 0.0, 1.0, [], []

    def rate(_, x, delta):
        return np.array([(0.18 * delta - x[0] - 4000.0 * x[0] ** 3) / 25.0, x[0]])

    for _ in t:
        side = -side if side * x[1] > angle else side
        rudder += np.clip(side * angle - rudder, -np.radians(3.0), np.radians(3.0))
        states.append(x)
        rudders.append(rudder)
        x = integrate(rate, x, np.array([0.0, 1.0]), np.full(2, rudder))[-1]
    r, psi = np.array(states).T
    r = r + autoregressive(draw, 500, 2e-4, 0.8)
    psi = quantised(psi + autoregressive(draw, 500, 2e-3, 0.8), np.radians(0.1))
    return recorded(SHIP, t, np.array(rudders), np.stack([r, psi], axis=1))


def hidden_tank(number: int) -> Record:
    """A second tank behind a narrow pipe, which nobody has declared."""
    draw, t = np.random.default_rng(1200 + number), 4.0 * np.arange(500)
    u = np.clip(2.2 + steps(t, draw, 180.0, 1.2), 0.0, None)

    def rate(_, x, pump):
        flow = 0.008 * (x[1] - x[0])
        return np.array([0.0025 * pump - 0.01 * np.sqrt(max(x[0], 0.0)) + flow, -0.7 * flow])

    h = integrate(rate, np.full(2, 0.3), t, u)[:, :1]
    return recorded(TANK, t, u, quantised(h + 0.001 * draw.normal(size=h.shape), 0.0005))


def oven(number: int) -> Record:
    """Radiation, a fourth power of the temperature, which the library lacks."""
    draw, t = np.random.default_rng(500 + number), 5.0 * np.arange(500)
    u = np.clip(500.0 + steps(t, draw, 300.0, 500.0), 0.0, None)

    def rate(_, x, power):
        return 0.004 * power - 0.002 * (x - 293.0) - 4e-12 * (x**4 - 293.0**4)

    T = integrate(rate, np.array([293.0 + 20.0 * number]), t, u)
    return recorded(OVEN, t, u, quantised(T + 0.3 * draw.normal(size=T.shape), 0.25))


def waves(number: int) -> Record:
    """Waves, a random force with a memory of 0.8 s, and a fin that damps the measured rate."""
    draw, t, fine = np.random.default_rng(1600 + number), 0.1 * np.arange(600), 10
    probe = chirp(t, 0.05, 0.4, 0.2) if number % 2 else steps(t, draw, 4.0, 0.25)
    x, force, fins, measured, h = np.zeros(2), 0.0, [], [], 0.1 / fine
    memory = np.exp(-h / 0.8)
    for wanted in probe:
        z = x + np.array([0.003, 0.004]) * draw.normal(size=2)
        fin = float(np.clip(wanted - 0.3 * z[0], -0.35, 0.35))
        fins.append(fin)
        measured.append(z)
        for _ in range(fine):
            force = memory * force + 0.06 * np.sqrt(1.0 - memory**2) * draw.normal()
            middle = x + 0.5 * h * np.array([fin - 0.8 * x[1] - 0.15 * x[0] + force, x[0]])
            x = x + h * np.array([fin - 0.8 * middle[1] - 0.15 * middle[0] + force, middle[0]])
    return recorded(BOAT, t, np.array(fins), np.array(measured))


MOTOR, SPRING = Motor(2.0, 20.0), Spring(15.0, 0.8, 0.8)
AIRCRAFT, ROTOR = ShortPeriod(-0.8, -0.1, -5.0, -1.0, -8.0), Rotor(15.0, 0.2)
SHIP, TANK, OVEN, BOAT = (
    Ship(0.1, 20.0),
    Tank(0.002, 0.008),
    Oven(0.003, 0.004),
    Roll(0.6, 0.1, 0.8),
)
SOFT = Spring(1.5, 0.2, 1.0)
DERIVATIVES = ("Za", "Zd", "Ma", "Mq", "Md")
SYSTEMS = (
    System(
        "motor with load",
        "constant torque, or bias of the sensor",
        MOTOR,
        ("a", "b"),
        motor_load,
        Answer.PROXIES,
    ),
    System(
        "motor, supply sags", "gain of the input", MOTOR, ("a", "b"), motor_gain, Answer.PROXIES
    ),
    System(
        "spring, late",
        "lag of the input, or of the sensor",
        SPRING,
        ("k", "c", "b"),
        spring_lag,
        Answer.PROXIES,
        held=False,
    ),
    System(
        "spring, late, in motion",
        "lag of the input, or of the sensor",
        SPRING,
        ("k", "c", "b"),
        spring_in_motion,
        Answer.PROXIES,
    ),
    System(
        "spring, fatigue",
        "stiffness with a memory",
        SOFT,
        ("k", "c"),
        spring_fatigue,
        Answer.PROXIES,
        held=False,
    ),
    System(
        "stall",
        "hinges of alpha in both equations",
        AIRCRAFT,
        DERIVATIVES,
        stall,
        Answer.NAMED,
        frozenset({"hinge of alpha in alpha", "hinge of alpha in q"}),
        held=False,
    ),
    System(
        "late vane",
        "delay of alpha",
        AIRCRAFT,
        DERIVATIVES,
        late_vane,
        Answer.NAMED,
        frozenset({"delay of alpha"}),
        held=False,
    ),
    System(
        "alpha-dot",
        "nothing that the records show",
        AIRCRAFT,
        DERIVATIVES,
        alpha_dot,
        Answer.NOTHING,
        held=False,
    ),
    System(
        "rotor",
        "lag of the command",
        ROTOR,
        ("b", "d"),
        rotor,
        Answer.NAMED,
        frozenset({"lag of input cmd"}),
    ),
    System(
        "rotor, in motion",
        "lag of the command",
        ROTOR,
        ("b", "d"),
        rotor_in_motion,
        Answer.NAMED,
        frozenset({"lag of input cmd"}),
    ),
    System(
        "ship", "cubic resistance", SHIP, ("K", "T"), ship, Answer.NAMED, frozenset({"r^3 in r"})
    ),
    System(
        "hidden tank",
        "lagged level",
        TANK,
        ("k", "c"),
        hidden_tank,
        Answer.NAMED,
        frozenset({"lagged h in h"}),
    ),
    System("oven", "fourth power of the temperature", OVEN, ("h", "g"), oven, Answer.PROXIES),
    System("boat in waves", "random forces", BOAT, ("w2", "d", "b"), waves, Answer.FORCES),
)
