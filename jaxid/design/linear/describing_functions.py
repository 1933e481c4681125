"""Optimal spectra of inputs to nonlinear models by describing functions (C.4.1 of the report).

Under a multisine of many lines state and input are nearly Gaussian. The linear model that is
nearest to the nonlinear one in the mean square has the mean slopes as its matrices, which are the
describing functions for random signals:

    A = E[df/dx],  B = E[df/du],  C = E[dh/dx],  D = E[dh/du],    E[f] = 0

They depend on the covariance of state and input, hence on the spectrum and its power; the optimal
spectrum of the linear model (C.2.1) and the covariance are computed in turns until they agree. This
suits simple nonlinearities in models of low order (C.4.1).

Source: A. Gelb and W. E. Vander Velde, Multiple-Input Describing Functions and Nonlinear System
Design, McGraw-Hill, 1968, chapter 7 (random-input describing functions).
"""

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy

from ..._foundation.checks import InputError, require, require_float64, require_known
from ..._foundation.types import Array, Float, Numbers
from ...estimation.likelihoods import AbstractLikelihood
from ...models.base import AbstractModel, canonical
from ...models.free import Free
from ...simulation.linearise import linearise
from ...simulation.steppers import rate
from ..measures import AbstractMeasure
from .frequency import OptimalSpectrum, optimal_spectrum

NORMAL_POINTS = 512  # at which the slopes are averaged, with their mirror images (chosen)
TURNS, AGREEMENT = 100, 1e-4  # turns, and relative change of the deviations at their end (chosen)
SHARE_OF_NEW = 0.5  # of a turn's covariance, so that the turns do not swing (chosen)


class QuasiLinear(AbstractModel):
    """The linear model that is nearest to a nonlinear one for Gaussian states and inputs.

    Its parameters are those of the nonlinear model; the amplitudes do not change with them.

    Args:
        model: the nonlinear model.
        mean: means of the states, then of the inputs.
        points: deviations of states and inputs from the means, of their covariance.
    """

    model: AbstractModel
    mean: Float[Array, " channel"]
    points: Float[Array, "point channel"]
    states: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)

    transparent: ClassVar[tuple[str, ...]] = ("model",)

    def __init__(self, model: AbstractModel, mean, points):
        self.model, self.mean, self.points = model, mean, points
        self.states, self.inputs, self.outputs = model.states, model.inputs, model.outputs

    def rhs(self, t, x, u):
        return self._linear(t, self.model.rhs, x, u)

    def output(self, t, x, u):
        return self._linear(t, self.model.output, x, u)

    def _linear(self, t, function, x, u) -> Float[Array, " row"]:
        """Return the linear approximation of a function of time, state and input."""
        value, slopes = self.describing_function(t, function)
        return value + slopes @ (jnp.concatenate([x, u]) - self.mean)

    def describing_function(self, t, function):
        """Return the mean of a function and its mean slopes by state and input."""
        size = len(self.states)

        def at(z):
            return function(t, z[:size], z[size:])

        z = self.mean[None] + self.points
        slopes = jax.vmap(jax.jacfwd(at))(z)
        return jnp.mean(jax.vmap(at)(z), axis=0), jnp.mean(slopes, axis=0)


class QuasiLinearSpectrum(NamedTuple):
    """The optimal spectrum of a nonlinear model at one power.

    Attributes:
        spectrum: distribution of the power; its `value` is that after one second of unit power.
        model: the linear model to which it belongs.
        deviations: standard deviations of states and inputs under it, by name.
        power: mean square of the input.
    """

    spectrum: OptimalSpectrum
    model: QuasiLinear
    deviations: dict[str, float]
    power: float


def quasi_linear_spectrum(
    model: AbstractModel,
    free: Free,
    frequencies: Float[Numbers, " frequency"],
    measure: AbstractMeasure,
    likelihood: AbstractLikelihood,
    power: float,
    *,
    sample_time: float,
    axis: str | None = None,
    state: Float[Numbers, " state"] | None = None,
    trim_input: Float[Numbers, " input"] | None = None,
) -> QuasiLinearSpectrum:
    """Return the spectrum of given power that shows the parameters of a nonlinear model best.

    Args:
        model: the model with declared values, stable.
        free: the parameters of the later estimate.
        frequencies: increasing candidate frequencies [Hz].
        measure: the measure to be minimised.
        likelihood: the likelihood with known noise.
        power: mean square of the input [unit^2].
        sample_time: of the record [s].
        axis: the input that moves; the first by default.
        state, trim_input: equilibrium without the input; zero by default.

    Raises:
        InputError: as `optimal_spectrum`; when the power is not positive, the linear model is not
            stable, or spectrum and covariance do not agree. Parameters that change the same entry
            of its matrices, as a linear and a cubic stiffness do, are not determined together: only
            harmonics separate them, which a linear model lacks.
    """
    require_float64()
    require(power > 0, f"The power is {power:g}; it must be positive.")
    model = canonical(model)
    axis = model.inputs[0] if axis is None else axis
    require_known("input", [axis], model.inputs)
    x = np.zeros(len(model.states)) if state is None else np.asarray(state, float)
    u = np.zeros(len(model.inputs)) if trim_input is None else np.asarray(trim_input, float)
    mean, covariance = np.concatenate([x, u]), np.zeros((x.size + u.size,) * 2)
    directions = _normal_points(mean.size)
    deviations = np.zeros(mean.size)
    for _ in range(TURNS):
        linear = QuasiLinear(model, jnp.asarray(mean), jnp.asarray(directions @ _root(covariance)))
        spectrum = optimal_spectrum(
            *(linear, free, frequencies, measure, likelihood),
            sample_time=sample_time,
            axis=axis,
            state=mean[: x.size],
            trim_input=u,
        )
        tangent = linearise(linear, 0.0, mean[: x.size], u)
        value = rate(linear, jnp.zeros(()), jnp.asarray(mean[: x.size]), jnp.asarray(u))
        A = np.asarray(tangent.A)
        mean = mean - np.append(np.linalg.lstsq(A, np.asarray(value))[0], np.zeros(u.size))
        new = _covariance(A, np.asarray(tangent.B), model.inputs.index(axis), spectrum, power)
        covariance = covariance + SHARE_OF_NEW * (new - covariance)
        before, deviations = deviations, np.sqrt(np.diagonal(covariance))
        if np.all(np.abs(deviations - before) <= AGREEMENT * deviations):
            _require_stable(A)
            names = (*model.states, *model.inputs)
            by_name = dict(zip(names, deviations.tolist(), strict=True))
            return QuasiLinearSpectrum(spectrum, linear, by_name, power)
    raise InputError(
        f"After {TURNS} turns the spectrum and the amplitudes under it do not agree at a power of "
        f"{power:g}: the nonlinearity is too strong for describing functions. Lower the power, or "
        "use `design_input`."
    )


def _covariance(A, B, column: int, spectrum: OptimalSpectrum, power: float) -> np.ndarray:
    """Return the covariance of states and inputs under a spectrum of one input.

    Args:
        A, B: matrices of the linear model.
        column: index of the input.
        spectrum, power: distribution over frequencies, and mean square, of the input.
    """
    size, inputs = B.shape
    covariance = np.zeros((size + inputs, size + inputs))
    for frequency, share in zip(spectrum.frequencies, spectrum.shares, strict=True):
        if share > 0.0:
            response = np.zeros(size + inputs, complex)
            response[:size] = np.linalg.solve(
                2j * np.pi * frequency * np.eye(size) - A, B[:, column]
            )
            response[size + column] = 1.0
            covariance += share * power * np.real(np.outer(response, np.conj(response)))
    return covariance


def _normal_points(channels: int) -> Float[np.ndarray, "point channel"]:
    """Return quasi-random normal points with their mirror images, scaled to unit covariance."""
    sequence = scipy.stats.qmc.Sobol(channels, scramble=True, rng=np.random.default_rng(0))
    points = scipy.stats.norm.ppf(sequence.random(NORMAL_POINTS))
    points = np.concatenate([points, -points])
    factor = np.linalg.cholesky(points.T @ points / len(points))
    return np.linalg.solve(factor, points.T).T


def _root(covariance: np.ndarray) -> np.ndarray:
    """Return a root of a covariance, `root' root = covariance`; some channels may be at rest."""
    values, vectors = np.linalg.eigh(covariance)
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T


def _require_stable(A: np.ndarray) -> None:
    """Refuse a linear model whose motion is not bounded: its frequency response means nothing."""
    growth = float(np.max(np.real(np.linalg.eigvals(A))))
    require(
        growth < 0.0,
        f"The linear model of this power is not stable (its motion grows as exp({growth:.3g} t)). "
        "Give a stable equilibrium by `state` and `trim_input`, or use `design_input`.",
    )
