"""Simulated flights of a short period: many records of one manoeuvre, each with its own noise."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.linalg import expm

from jaxid import AbstractModel, Augmented, simulate
from jaxid._foundation.types import Array
from jaxid.effects import Effect

SPEED, STEP = 50.0, 0.05  # m/s, s
NOISE = {"alpha": 0.004, "q": 0.004}  # rad, rad/s
GUST, GUST_TIME = 1.0, 0.6  # m/s, s
DERIVATIVES = {"Zw": -1.0, "Mw": -0.1, "Mq": -1.5, "Md": -8.0}
INITIAL = np.array([0.5, 0.02])  # m/s, rad/s


class ShortPeriod(AbstractModel):
    """The short period of a small aircraft, in vertical gusts if they are among the inputs.

    dw/dt = Zw (w - gust) + V q,    dq/dt = Mw (w - gust) + Mq q + Md elevator
    alpha = (w - gust) / V
    """

    Zw: Array
    Mw: Array
    Mq: Array
    Md: Array
    gusts: tuple[str, ...] = eqx.field(static=True, default=())
    states, outputs = ("w", "q"), ("alpha", "q")

    @property
    def inputs(self):
        return ("elevator", *self.gusts)

    def rhs(self, t, x, u):
        w = self._relative(x, u)
        return jnp.stack(
            [self.Zw * w + SPEED * x[1], self.Mw * w + self.Mq * x[1] + self.Md * u[0]]
        )

    def output(self, t, x, u):
        return jnp.stack([self._relative(x, u) / SPEED, x[1]])

    def with_disturbance_inputs(self):
        return ShortPeriod(self.Zw, self.Mw, self.Mq, self.Md, gusts=("gust",))

    def _relative(self, x, u):
        return x[0] - u[1] if self.gusts else x[0]


class Flights(NamedTuple):
    """Records of one manoeuvre under different noise.

    Attributes:
        t, u: times and elevator.
        z: measurements, shape (draw, time, output).
        valid: true for a sample that is not missing.
        derivatives: true derivatives of each flight, in the order of `DERIVATIVES`.
    """

    t: np.ndarray
    u: np.ndarray
    z: np.ndarray
    valid: np.ndarray
    derivatives: np.ndarray


def fly(
    draws: int,
    samples: int,
    seed: int,
    *,
    gust: float = 0.0,
    colour: float = 0.0,
    missing: float = 0.0,
    spread: dict[str, float] | None = None,
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
    """
    rng, (t, u) = np.random.default_rng(seed), _manoeuvre(samples)
    derivatives = _derivatives(draws, spread or {}, rng)
    Phi, noise = _transition(derivatives if spread else derivatives[:1], gust)
    values, vectors = np.linalg.eigh(noise)
    factor = vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
    x = np.zeros((draws, 3))
    x[:, :2], x[:, 2] = INITIAL, gust * rng.normal(size=draws)
    z = np.zeros((draws, samples, 2))
    slopes = np.append(np.diff(u) / STEP, 0.0)
    for i in range(samples):
        z[:, i] = np.stack([(x[:, 0] - x[:, 2]) / SPEED, x[:, 1]], axis=1)
        driven = Phi[:, :3, 3] * u[i] + Phi[:, :3, 4] * slopes[i]
        random = _images(factor, rng.normal(size=(draws, 3)))
        x = _images(Phi[:, :3, :3], x) + driven + random
    z += _coloured(rng.normal(size=z.shape), colour) * np.array(list(NOISE.values()))
    valid = rng.uniform(size=z.shape) >= missing
    return Flights(t, u[:, None], np.where(valid, z, 0.0), valid, derivatives)


def fly_with(
    effect: Effect, draws: int, samples: int, seed: int, declared: AbstractModel
) -> Flights:
    """Return records of the short period with an effect that the declared model lacks.

    Args:
        effect: the effect, with its true parameters.
        draws, samples, seed: as for `fly`.
        declared: the short period with its true derivatives.
    """
    rng, (t, u) = np.random.default_rng(seed), _manoeuvre(samples)
    y = np.asarray(simulate(Augmented(declared, (effect,)), t, u[:, None], INITIAL).y)
    z = y + rng.normal(size=(draws, samples, 2)) * np.array(list(NOISE.values()))
    valid, derivatives = np.ones(z.shape, bool), _derivatives(draws, {}, rng)
    return Flights(t, u[:, None], z, valid, derivatives)


def _manoeuvre(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times and elevator."""
    t = STEP * np.arange(samples)
    return t, 0.05 * np.sign(np.sin(1.3 * t)) + 0.03 * np.sign(np.sin(3.1 * t + 1.0))


def _derivatives(draws: int, spread: dict[str, float], rng) -> np.ndarray:
    """Return the true derivatives of each flight."""
    deviations = np.array([spread.get(name, 0.0) for name in DERIVATIVES])
    return np.array(list(DERIVATIVES.values())) + deviations * rng.normal(size=(draws, 4))


def _transition(derivatives: np.ndarray, gust: float) -> tuple[np.ndarray, np.ndarray]:
    """Return transition matrices over one sample, and the covariances of the random increments.

    The states are w, q, gust, elevator and its slope (Van Loan, IEEE Transactions on Automatic
    Control 23, 1978).
    """
    Zw, Mw, Mq, Md = derivatives.T
    A = np.zeros((len(derivatives), 5, 5))
    A[:, 0, 0], A[:, 0, 1], A[:, 0, 2] = Zw, SPEED, -Zw
    A[:, 1, 0], A[:, 1, 1], A[:, 1, 2], A[:, 1, 3] = Mw, Mq, -Mw, Md
    A[:, 2, 2], A[:, 3, 4] = -1.0 / GUST_TIME, 1.0
    power = np.zeros_like(A)
    power[:, 2, 2] = 2.0 / GUST_TIME * gust**2
    block = np.zeros((len(A), 10, 10))
    block[:, :5, :5], block[:, :5, 5:], block[:, 5:, 5:] = -A, power, np.swapaxes(A, 1, 2)
    exponential = expm(block * STEP)
    Phi = np.swapaxes(exponential[:, 5:, 5:], 1, 2)
    return Phi, (Phi @ exponential[:, :5, 5:])[:, :3, :3]


def _images(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the images of vectors under one matrix each, or all under one."""
    return (matrices @ vectors[..., None])[..., 0]


def _coloured(e: np.ndarray, correlation: float) -> np.ndarray:
    """Return noise of unit variance whose samples depend on the ones before them."""
    noise = e.copy()
    for i in range(1, e.shape[1]):
        noise[:, i] = correlation * noise[:, i - 1] + np.sqrt(1.0 - correlation**2) * e[:, i]
    return noise
