"""Parametrised inputs for direct optimisation: splines, multisines and square waves.

A shape maps one vector of numbers of order one per axis to samples between about -1 and 1.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy

from .._foundation.checks import require
from .._foundation.types import Array, Float
from .signals import harmonics_within

# Coefficients of the default spline, where the signal has four times as many samples (chosen).
DEFAULT_KNOTS = 20
START_PULSES = 6  # pulses of the random square wave with which a spline begins (chosen)


class AbstractShape(eqx.Module):
    """Samples of one axis as a function of a vector of parameters."""

    @property
    @abc.abstractmethod
    def count(self) -> int:
        """Number of parameters of one axis."""

    @abc.abstractmethod
    def samples(self, p: Float[Array, " parameter"]) -> Float[Array, " time"]:
        """Return the samples of one axis."""

    @abc.abstractmethod
    def starts(self, rng: np.random.Generator, number: int) -> Float[np.ndarray, "start parameter"]:
        """Return random parameters from which an optimisation begins."""

    def nearest(
        self, samples: Float[np.ndarray, " time"]
    ) -> Float[np.ndarray, " parameter"] | None:
        """Return the parameters of the signal nearest to given samples, None if not defined."""
        return None

    @abc.abstractmethod
    def scaled(
        self, p: Float[Array, "*axis parameter"], factor: Float[Array, ""]
    ) -> Float[Array, "*axis parameter"]:
        """Return the parameters of the signal times a factor."""


class AbstractLinearShape(AbstractShape):
    """A shape whose samples are linear in its parameters, `basis @ p`."""

    basis: eqx.AbstractVar[Float[Array, "time parameter"]]

    @property
    def count(self):
        return self.basis.shape[1]

    def samples(self, p):
        return self.basis @ p

    def nearest(self, samples):
        return np.linalg.lstsq(np.asarray(self.basis), samples, rcond=None)[0]

    def scaled(self, p, factor):
        return p * factor


class Spline(AbstractLinearShape):
    """Cubic spline with uniform knots, at rest at both ends.

    Args:
        basis: values of the B-splines at the samples; `spline` computes them.
    """

    basis: Float[Array, "time parameter"]

    def starts(self, rng, number):
        # Random square waves have the spectrum of multisteps.
        place = np.linspace(0.0, 1.0, self.count)
        edges = np.sort(rng.uniform(size=(number, START_PULSES)), axis=1)
        sign = (-1.0) ** np.sum(place[None, :, None] > edges[:, None], axis=2)
        return sign * rng.choice([-1.0, 1.0], size=(number, 1))


class Multisine(AbstractLinearShape):
    """Sum of harmonics with free amplitudes and phases, smoothly faded in and out.

    Args:
        basis: cosines and sines at the samples; `multisine` computes them.
    """

    basis: Float[Array, "time parameter"]

    def starts(self, rng, number):
        return rng.normal(size=(number, self.count)) / np.sqrt(self.count)


class Stages(AbstractLinearShape):
    """Constant levels, one per stage, with a ramp at the beginning of each; the first sample is at
    trim.

    Args:
        basis: shares of the levels in the samples; `stages` computes them.
    """

    basis: Float[Array, "time parameter"]

    def starts(self, rng, number):
        return rng.choice([-1.0, 0.0, 1.0], size=(number, self.count))


class SquareWave(AbstractShape):
    """Pulses of one height and alternating sign, with free widths, then rest.

    The widths are shares of the duration, `softmax` of the first parameters. The last parameter is
    the height. Each sample is the mean of the wave over one sample time, so that it changes
    continuously with the edges.

    Args:
        t: sample times [s].
        pulses: number of pulses.
    """

    t: Float[Array, " time"]
    pulses: int = eqx.field(static=True)

    @property
    def count(self):
        return self.pulses + 2

    def samples(self, p):
        step = self.t[1] - self.t[0]
        widths = jax.nn.softmax(p[:-1]) * (self.t[-1] - self.t[0])
        edges = self.t[0] + jnp.concatenate([jnp.zeros(1), jnp.cumsum(widths[:-1])])
        # share of the time before each edge in the sample interval around each sample
        after = jnp.clip((self.t[:, None] - edges[None]) / step + 0.5, 0.0, 1.0)
        signs = (-1.0) ** jnp.arange(self.pulses)
        return p[-1] * jnp.sum((after[:, :-1] - after[:, 1:]) * signs[None], axis=1)

    def starts(self, rng, number):
        return np.column_stack(
            [rng.normal(size=(number, self.pulses + 1)), rng.choice([-1.0, 1.0], size=number)]
        )

    def scaled(self, p, factor):
        return p.at[..., -1].multiply(factor)


def spline(t: Float[Array, " time"], knots: int) -> Spline:
    """Return a cubic spline with a number of free coefficients.

    Args:
        t: sample times [s].
        knots: number of coefficients per axis.

    Raises:
        InputError: for fewer than two coefficients, or more than samples.
    """
    return Spline(jnp.asarray(b_splines(np.asarray(t), knots)[:, 1:-1]))


def b_splines(
    times: Float[np.ndarray, " time"], knots: int
) -> Float[np.ndarray, "time coefficient"]:
    """Return the cubic B-splines of uniform knots at sample times, two more than knots.

    Only the first is not zero at the first time, only the last at the last time. Their sum is one,
    so that a curve does not leave the range of its coefficients.

    Raises:
        InputError: for fewer than two knots, or as many as samples.
    """
    require(
        2 <= knots < times.size,
        f"{knots} knots for {times.size} samples: give at least 2, and fewer than samples.",
    )
    inner = np.linspace(times[0], times[-1], knots)
    full = np.concatenate([[times[0]] * 3, inner, [times[-1]] * 3])
    return scipy.interpolate.BSpline.design_matrix(times, full, 3).toarray()


def default_shape(t: Float[Array, " time"]) -> Spline:
    """Return a cubic spline with up to `DEFAULT_KNOTS` coefficients."""
    return spline(t, default_knots(t.size, DEFAULT_KNOTS))


def default_knots(samples: int, most: int) -> int:
    """Return a number of knots, each with at least four samples where there are enough."""
    return min(most, max(samples // 4, 2))


def multisine(
    t: Float[Array, " time"], low: float, high: float, *, fade: float = 0.05
) -> Multisine:
    """Return all harmonics of the duration in a band.

    Args:
        t: sample times [s].
        low, high: the band [Hz].
        fade: share of the duration in which the signal rises from zero, and falls to it, up to
            0.5; with 0 it begins and ends at full size.

    Raises:
        InputError: when no harmonic lies in the band, or `fade` is not from 0 to 0.5.
    """
    require(
        0.0 <= fade <= 0.5,
        f"`fade` is {fade:g}, a share of the duration at each end. Give a number from 0 to 0.5.",
    )
    times = np.asarray(t - t[0])
    period = float(times[-1])
    harmonics = harmonics_within(low, high, period)
    require(
        harmonics.size > 0,
        f"From {low:g} to {high:g} Hz there is no harmonic of {period:g} s. Widen the band.",
    )
    angle = 2.0 * np.pi * harmonics[None] * times[:, None] / period
    share = np.minimum(times, period - times) / period
    risen = np.divide(share, fade, out=np.ones_like(share), where=share < fade)
    window = np.sin(0.5 * np.pi * risen) ** 2
    return Multisine(
        jnp.asarray(np.concatenate([np.cos(angle), np.sin(angle)], 1) * window[:, None])
    )


def square_wave(t: Float[Array, " time"], pulses: int) -> SquareWave:
    """Return pulses of alternating sign with free widths and one height.

    Args:
        t: sample times [s].
        pulses: number of pulses per axis.

    Raises:
        InputError: for fewer than one pulse.
    """
    require(pulses >= 1, f"{pulses} pulses are no input. Give at least 1.")
    return SquareWave(t, pulses)


def stages(t: Float[Array, " time"], stage: int, ramp: int = 1) -> Stages:
    """Return constant levels of stages of equal length.

    Args:
        t: sample times [s].
        stage: samples of a stage; the first sample belongs to none.
        ramp: sample times from one level to the next.

    Raises:
        InputError: when the stages do not divide the samples after the first.
    """
    require(
        stage >= 1 and t.size > 1 and (t.size - 1) % stage == 0,
        f"Stages of {stage} samples do not divide the {t.size - 1} samples after the first, which "
        "is at trim. Give a divisor of this number, or another duration.",
    )
    share = np.minimum(np.arange(1, stage + 1) / ramp, 1.0)[:, None]
    count = (t.size - 1) // stage
    basis = np.kron(np.eye(count), share) + np.kron(np.eye(count, k=-1), 1.0 - share)
    return Stages(jnp.asarray(np.pad(basis, ((1, 0), (0, 0)))))
