"""Inputs of given energy to linear models in the time domain (C.2.2 of the report).

Of a linear model at rest the sensitivities are linear in the input, `S = G u`, so that a weighted
trace of the information is a quadratic form, and the best input of given energy its eigenvector of
the largest eigenvalue (in place of the two-point boundary-value problem, Eq. C.20):

    max  Tr(W M(u)) = u' H u,    integral u'u dt = E

Another measure of the information is improved by such inputs: with W its derivative at `M(u_0)`,
the eigenvector `u_m` is combined with `u_0` (Eq. C.22 to C.24), until the measure no longer falls.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy

from ..._foundation.checks import require, require_float64, require_known
from ..._foundation.types import Array, Float, Numbers
from ...estimation.likelihoods import AbstractLikelihood
from ...models.base import AbstractModel, as_float, canonical
from ...models.free import Free
from ..design import Design
from ..explanations import hypothesis_of
from ..information import (
    planned_information,
    planned_record,
    prior_rows,
    require_known_noise,
    require_shown,
)
from ..measures import AbstractMeasure
from ..objectives import Hypothesis
from ..signals import InputSignal

MIXTURES, LEAST_CHANGE = 60, 1e-5  # of the logarithmic cost (chosen)
ACCURACY = 1e-6  # of the eigenvalue, relative (chosen)
SEED = 0  # of the first input, and of the eigenvector's start
LINEAR = 1e-6  # deviation of doubled sensitivities from those of a doubled input (chosen)


def energy_limited_input(
    model: AbstractModel,
    free: Free,
    t: Float[Numbers, " time"],
    measure: AbstractMeasure,
    likelihood: AbstractLikelihood,
    energy: float,
    *,
    axes: Sequence[str] | None = None,
) -> Design:
    """Return the input of given energy that shows the parameters of a linear model best.

        min_u measure( M(u) ),    integral u'u dt = E,    x(0) = 0

    Args:
        model: a linear model, with declared values.
        free: the shared parameters of the later estimate, with priors; the model starts at rest.
        t: sample times, uniform [s].
        measure: the measure to be minimised.
        likelihood: the likelihood of the later estimate, with known noise.
        energy: E, of all axes together [input^2 s].
        axes: inputs that move; all by default.

    Returns:
        The design; no limit but the energy holds for it.

    Raises:
        InputError: when the model is not linear, a parameter belongs to a record, no input of the
            axes shows a parameter, an axis does not exist, the noise is unknown, or the energy is
            not positive.
    """
    require_float64()
    axes = tuple(model.inputs) if axes is None else tuple(axes)
    require_known("input", axes, model.inputs)
    likelihood = canonical(likelihood)
    require_known_noise(likelihood)
    require(
        not free.per_record,
        f"{', '.join(free.per_record)}: the start is at rest here. Free shared parameters only.",
    )
    require(energy > 0, f"The energy is {energy:g}; it must be positive.")
    t, model = as_float(t), canonical(model)
    hypothesis = hypothesis_of(model, free, jnp.zeros(len(model.states)))
    columns = [model.inputs.index(axis) for axis in axes]
    shape = (t.size, len(axes))
    step = float(t[1] - t[0])

    def placed(u):
        return jnp.zeros((t.size, len(model.inputs))).at[:, np.array(columns)].set(u)

    sensitivities = _Sensitivities(hypothesis, t, likelihood, placed)
    u = np.random.default_rng(SEED).normal(size=shape)
    _require_linear(sensitivities, u)
    require_shown(model, free, sensitivities(u))
    norm = np.sqrt(energy / step)
    known = prior_rows(free)
    u, costs = _improved(sensitivities, norm * u / np.linalg.norm(u), norm, measure, known)
    signal = InputSignal(t, placed(jnp.asarray(u)), model.inputs, "energy-limited design")
    values = np.asarray(hypothesis.flat[hypothesis.positions.shared])
    return Design(
        signal,
        planned_record(model, signal, likelihood),
        planned_information(model, free, values, _triangle(sensitivities(u), known), signal.name),
        costs[-1],
        (),
        {"energy": 1.0},
        (costs[-1],),
    )


class _Sensitivities:
    """Whitened sensitivities of a linear model as a linear function of the input.

    Args:
        hypothesis: the model and its free parameters, at rest.
        t: sample times.
        likelihood: the likelihood.
        placed: returns all inputs for those that move.
    """

    def __init__(self, hypothesis: Hypothesis, t, likelihood, placed: Callable[[Array], Array]):
        def of(u):
            return hypothesis.sensitivities(t, placed(u), likelihood)[1]

        def product(u, rows):
            S, back = jax.vjp(of, u)
            return back(S @ rows.T @ rows)[0]

        self.of, self.product = eqx.filter_jit(of), eqx.filter_jit(product)

    def __call__(self, u: np.ndarray) -> Float[np.ndarray, "row parameter"]:
        return np.asarray(self.of(jnp.asarray(u)))

    def best_input(self, rows, shape: tuple[int, int]) -> np.ndarray:
        """Return the input of unit norm with the largest trace `Tr(rows M rows')`."""
        from scipy.sparse.linalg import LinearOperator, eigsh  # slow to import

        size = shape[0] * shape[1]

        def matvec(u):
            return np.asarray(self.product(jnp.asarray(u.reshape(shape)), rows)).ravel()

        start = np.random.default_rng(SEED).normal(size=size)
        options: dict[str, Any] = {"k": 1, "which": "LA", "v0": start, "tol": ACCURACY}
        operator = LinearOperator((size, size), matvec, dtype=float)  # pyright: ignore
        _, vectors = eigsh(operator, **options)
        return vectors[:, 0].reshape(shape)


class _Mixture(NamedTuple):
    """Two inputs and their sensitivities; their combinations have the norm of both.

    Attributes:
        inputs, sensitivities: of the present input and of another one.
        norm: of each input.
    """

    inputs: tuple[np.ndarray, np.ndarray]
    sensitivities: tuple[np.ndarray, np.ndarray]
    norm: float

    def at(self, angle: float) -> tuple[np.ndarray, np.ndarray]:
        """Return a combination and its sensitivities; at zero the present input (Eq. C.23)."""
        a, b = np.cos(angle), np.sin(angle)
        u = a * self.inputs[0] + b * self.inputs[1]
        S = a * self.sensitivities[0] + b * self.sensitivities[1]
        size = self.norm / np.linalg.norm(u)
        return size * u, size * S


def _improved(sensitivities: _Sensitivities, u, norm: float, measure: AbstractMeasure, known):
    """Return the input at which the measure no longer falls, and the logarithmic costs.

    Args:
        sensitivities: by input.
        u: the first input.
        norm: of each input.
        measure: the measure.
        known: rows of the information that is known before.
    """

    def cost(S) -> float:
        value = float(measure.cost(_triangle(S, known)))
        return float(np.log(value)) if measure.is_variance else value

    S = sensitivities(u)
    costs = [cost(S)]
    for _ in range(MIXTURES):
        rows = jnp.asarray(measure.gradient_rows(_triangle(S, known)))
        other = norm * sensitivities.best_input(rows, u.shape)
        mixture = _Mixture((u, other), (S, sensitivities(other)), norm)
        angle, value = _best_angle(lambda angle, mixture=mixture: cost(mixture.at(angle)[1]))
        if not value < costs[-1] - LEAST_CHANGE:
            break
        u, S = mixture.at(angle)
        costs.append(value)
    return u, costs


def _best_angle(cost: Callable[[float], float]) -> tuple[float, float]:
    """Return the best angle of a mixture, to either side: an eigenvector has no sign."""
    ends = [(0.0, 0.5 * np.pi), (-0.5 * np.pi, 0.0)]
    results: list[Any] = [
        scipy.optimize.minimize_scalar(cost, bounds=end, method="bounded") for end in ends
    ]
    best = min(results, key=lambda result: result.fun)
    return float(best.x), float(best.fun)


def _triangle(S: np.ndarray, known: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.qr(np.concatenate([S, known]), mode="r"))


def _require_linear(sensitivities: _Sensitivities, u: np.ndarray) -> None:
    once, twice, none = sensitivities(u), sensitivities(2.0 * u), sensitivities(0.0 * u)
    largest = np.max(np.abs(twice))
    deviation = max(np.max(np.abs(twice - 2.0 * once)), np.max(np.abs(none)))
    require(
        bool(deviation <= LINEAR * largest),
        "The sensitivities are not linear in the input: the model is not linear, or not at rest. "
        "Use `design_input`.",
    )
