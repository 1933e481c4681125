"""Simulated flights of a short period: many records of one manoeuvre, each with its own noise."""

import dataclasses
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.linalg import expm

from benchmarks.coverage.gusts import GustFilter, first_order, scaled
from jaxid import AbstractModel, Augmented, simulate
from jaxid._foundation.types import Array
from jaxid.effects import Effect

SPEED, STEP = 50.0, 0.05  # m/s, s
NOISE = {"alpha": 0.004, "q": 0.004}  # rad, rad/s
GUST, GUST_TIME = 1.0, 0.6  # m/s, s
DERIVATIVES = {"Zw": -1.0, "Mw": -0.1, "Mq": -1.5, "Md": -8.0}
INITIAL = np.array([0.5, 0.02])  # m/s, rad/s


class ShortPeriod(AbstractModel):
    """The short period of an aircraft, in vertical gusts if they are among the inputs.

    dw/dt = Zw (w - gust) + (V + Zq) q + Zd elevator
    dq/dt = Mw (w - gust) + Mq q + Md elevator
    alpha = (w - gust) / V
    """

    Zw: Array
    Mw: Array
    Mq: Array
    Md: Array
    Zq: Array = eqx.field(default_factory=lambda: jnp.zeros(()))
    Zd: Array = eqx.field(default_factory=lambda: jnp.zeros(()))
    speed: float = eqx.field(static=True, default=SPEED)
    gusts: tuple[str, ...] = eqx.field(static=True, default=())
    states, outputs = ("w", "q"), ("alpha", "q")

    @property
    def inputs(self):
        return ("elevator", *self.gusts)

    def rhs(self, t, x, u):
        w, q = self._relative(x, u), x[1]
        return jnp.stack(
            [
                self.Zw * w + (self.speed + self.Zq) * q + self.Zd * u[0],
                self.Mw * w + self.Mq * q + self.Md * u[0],
            ]
        )

    def output(self, t, x, u):
        return jnp.stack([self._relative(x, u) / self.speed, x[1]])

    def with_disturbance_inputs(self):
        return dataclasses.replace(self, gusts=("gust",))

    def _relative(self, x, u):
        return x[0] - u[1] if self.gusts else x[0]


class Airplane(NamedTuple):
    """An aircraft, its manoeuvre and the duration of the gusts that it meets.

    Attributes:
        derivatives: true values of the free derivatives, in the order of `DERIVATIVES`.
        speed: V [m/s].
        known: further derivatives, which are not estimated.
        travel: elevator relative to the small aircraft's.
        gust_time: length scale of the gusts over the speed [s].
    """

    derivatives: Mapping[str, float] = MappingProxyType(DERIVATIVES)
    speed: float = SPEED
    known: Mapping[str, float] = MappingProxyType({})
    travel: float = 1.0
    gust_time: float = GUST_TIME

    def model(self, derivatives: Mapping[str, float]) -> ShortPeriod:
        """Return the short period with values of the free derivatives."""
        values = {name: jnp.asarray(v) for name, v in (derivatives | self.known).items()}
        return ShortPeriod(**values, speed=self.speed)


SMALL = Airplane()
# `f16(xcg=0.30)` of `jaxid.aircraft` with its engine, linearised in level flight at 152.4 m/s and
# 1000 ft, where the length scale of vertical gusts is the altitude (MIL-F-8785C, 3.7.3.2)
F16 = Airplane(
    MappingProxyType({"Zw": -0.9784, "Mw": -0.01642, "Mq": -1.3426, "Md": -10.622}),
    speed=152.4,
    known=MappingProxyType({"Zq": -14.33, "Zd": -20.065}),
    travel=0.4,
    gust_time=2.0,
)


class Flights(NamedTuple):
    """Records of one manoeuvre under different noise.

    Attributes:
        t, u: times and elevator.
        z: measurements, shape (draw, time, output).
        valid: true for a sample that is not missing.
        derivatives: true derivatives of each flight, in the order of `DERIVATIVES`.
        airplane: the aircraft.
    """

    t: np.ndarray
    u: np.ndarray
    z: np.ndarray
    valid: np.ndarray
    derivatives: np.ndarray
    airplane: Airplane = SMALL


def fly(
    draws: int,
    samples: int,
    seed: int,
    *,
    gust: float = 0.0,
    colour: float = 0.0,
    missing: float = 0.0,
    spread: dict[str, float] | None = None,
    airplane: Airplane = SMALL,
    shape: Callable[[float], GustFilter] = first_order,
) -> Flights:
    """Return records of the short period, exact for the elevator's straight lines.

    Args:
        draws: number of records.
        samples: samples of each record.
        seed: seed of the noise.
        gust: standard deviation of the gust [m/s].
        colour: correlation of a sensor's noise from one sample to the next.
        missing: share of missing measurements.
        spread: standard deviations of true derivatives from flight to flight, by name.
        airplane: the aircraft.
        shape: from the duration of the gusts to their filter.
    """
    rng, (t, u) = np.random.default_rng(seed), _manoeuvre(samples, airplane)
    derivatives = _derivatives(draws, airplane, spread or {}, rng)
    gusts = scaled(shape(airplane.gust_time), gust)
    Phi, noise = _transition(derivatives if spread else derivatives[:1], airplane, gusts)
    n = noise.shape[-1]
    x, factor = np.zeros((draws, n)), _root(noise)
    x[:, :2] = INITIAL
    x[:, 2:] = _images(_root(gusts.P), rng.normal(size=(draws, n - 2)))
    z = np.zeros((draws, samples, 2))
    slopes = np.append(np.diff(u) / STEP, 0.0)
    for i in range(samples):
        z[:, i] = np.stack([(x[:, 0] - x[:, 2:] @ gusts.C) / airplane.speed, x[:, 1]], axis=1)
        driven = Phi[:, :n, n] * u[i] + Phi[:, :n, n + 1] * slopes[i]
        random = _images(factor, rng.normal(size=(draws, n)))
        x = _images(Phi[:, :n, :n], x) + driven + random
    z += _coloured(rng.normal(size=z.shape), colour) * np.array(list(NOISE.values()))
    valid = rng.uniform(size=z.shape) >= missing
    return Flights(t, u[:, None], np.where(valid, z, 0.0), valid, derivatives, airplane)


def fly_with(
    effect: Effect, draws: int, samples: int, seed: int, declared: AbstractModel
) -> Flights:
    """Return records of the short period with an effect that the declared model lacks.

    Args:
        effect: the effect, with its true parameters.
        draws, samples, seed: as for `fly`.
        declared: the short period with its true derivatives.
    """
    rng, (t, u) = np.random.default_rng(seed), _manoeuvre(samples, SMALL)
    y = np.asarray(simulate(Augmented(declared, (effect,)), t, u[:, None], INITIAL).y)
    z = y + rng.normal(size=(draws, samples, 2)) * np.array(list(NOISE.values()))
    valid, derivatives = np.ones(z.shape, bool), _derivatives(draws, SMALL, {}, rng)
    return Flights(t, u[:, None], z, valid, derivatives)


def _manoeuvre(samples: int, airplane: Airplane) -> tuple[np.ndarray, np.ndarray]:
    """Return times and elevator."""
    t = STEP * np.arange(samples)
    u = 0.05 * np.sign(np.sin(1.3 * t)) + 0.03 * np.sign(np.sin(3.1 * t + 1.0))
    return t, airplane.travel * u


def _derivatives(draws: int, airplane: Airplane, spread: dict[str, float], rng) -> np.ndarray:
    """Return the true derivatives of each flight."""
    mean = np.array([airplane.derivatives[name] for name in DERIVATIVES])
    deviations = np.array([spread.get(name, 0.0) for name in DERIVATIVES])
    return mean + deviations * rng.normal(size=(draws, 4))


def _transition(
    derivatives: np.ndarray, airplane: Airplane, gusts: GustFilter
) -> tuple[np.ndarray, np.ndarray]:
    """Return transition matrices over one sample, and the covariances of the random increments.

    The states are w, q, the states of the gust, elevator and its slope (Van Loan, IEEE Transactions
    on Automatic Control 23, 1978).
    """
    (Zw, Mw, Mq, Md), known = derivatives.T, airplane.known
    random = 2 + len(gusts.C)
    size = random + 2
    A = np.zeros((len(derivatives), size, size))
    A[:, 0, 0], A[:, 0, 1] = Zw, airplane.speed + known.get("Zq", 0.0)
    A[:, 1, 0], A[:, 1, 1] = Mw, Mq
    A[:, 0, random], A[:, 1, random] = known.get("Zd", 0.0), Md
    A[:, :2, 2:random] = -A[:, :2, :1] * gusts.C
    A[:, 2:random, 2:random], A[:, random, random + 1] = gusts.A, 1.0
    power = np.zeros_like(A)
    power[:, 2:random, 2:random] = np.outer(gusts.B, gusts.B)
    block = np.zeros((len(A), 2 * size, 2 * size))
    block[:, :size, :size], block[:, :size, size:] = -A, power
    block[:, size:, size:] = np.swapaxes(A, 1, 2)
    exponential = expm(block * STEP)
    Phi = np.swapaxes(exponential[:, size:, size:], 1, 2)
    return Phi, (Phi @ exponential[:, :size, size:])[:, :random, :random]


def _root(covariances: np.ndarray) -> np.ndarray:
    """Return matrices whose products with their transposes are the covariances."""
    values, vectors = np.linalg.eigh(covariances)
    return vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]


def _images(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the images of vectors under one matrix each, or all under one."""
    return (matrices @ vectors[..., None])[..., 0]


def _coloured(e: np.ndarray, correlation: float) -> np.ndarray:
    """Return noise of unit variance whose samples depend on the ones before them."""
    noise = e.copy()
    for i in range(1, e.shape[1]):
        noise[:, i] = correlation * noise[:, i - 1] + np.sqrt(1.0 - correlation**2) * e[:, i]
    return noise
