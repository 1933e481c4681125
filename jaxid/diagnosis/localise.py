"""Localisation of a residual: the share of its power that a free-form disturbance at each place
explains.

The places are equations, inputs, sensors, parameters and the air, one at a time. The response of
the outputs to a disturbance is computed in `free_form`; the part of it that the free parameters can
reproduce is projected out.
"""
# pyright: reportCallIssue=false

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.compiler import fast_compile_jit
from .._foundation.grid import typical_step
from .._foundation.host import to_device
from .._foundation.location import Location, LocationKind
from .._foundation.types import Array, Bool, Float, Int
from ..data.record import Record
from ..effects.library import uncertain_equations
from ..estimation.estimate import as_stack, check_channels
from ..estimation.likelihoods import AbstractLikelihood, OutputError
from ..estimation.problem import Problem
from ..estimation.result import Estimate
from ..models.free import Parameters
from ..models.innovation import InnovationModel
from ..models.stochastic import StochasticModel
from .autoregression import white_noise_variance
from .free_form import Linear, answers, gusts_of, linear_models, spline_basis
from .places import LocalisationResult, Place
from .thresholds import FEW_KNOTS, MANY_KNOTS, SAMPLES_PER_DEGREE, WEAK_DIRECTION

KINDS = (LocationKind.EQUATION, LocationKind.INPUT, LocationKind.SENSOR, LocationKind.AIR)


def localise_residual(
    fit: Estimate,
    records: Record | Sequence[Record],
    likelihood: AbstractLikelihood | None = None,
    *,
    knots: int | None = None,
    kinds: Sequence[LocationKind] = KINDS,
    equations: Sequence[str] | None = None,
) -> LocalisationResult:
    r"""Explain the residual by a free-form disturbance at each place, one place at a time.

        score = v' R^-1 G (G' M G)^-1 G' R^-1 v

    with G the response of the outputs to linear B-splines at one place (each record has its own), M
    the projection that removes the sensitivities to the free parameters, and R the diagonal of the
    noise covariance. A place that is not the cause can explain nearly as much if it moves the
    outputs in nearly the same way: the data do not distinguish a force on a mass from the input
    that pushes it. Effects on whole signals (a sensor's lag) are not part of the linear model.

    Args:
        fit: estimate of the model on these records; `fit.noise` is the noise covariance.
        records: the records of the fit.
        likelihood: the likelihood of the fit.
        knots: number of B-splines in each record; by default 20 or 60, chosen from the spectrum of
            the residual (`resolution`). If 60 are not enough, only the first part of each record is
            used.
        kinds: kinds of places. AIR exists if the model has disturbance inputs. A PARAMETER that
            drifts acts in an equation times its factor there, and can explain more than any force
            in it; therefore it is not among the defaults.
        equations: states whose equations may be disturbed; by default those that hold a free
            parameter, as the others are exact by definition.

    Returns:
        Places in falling order of their share, each with its most probable disturbance.

    Raises:
        InputError: if channels differ, the fit is one of a filter, there are fewer than two knots,
            `kinds` is empty, or a state does not exist.
    """
    records = as_stack(records)
    check_channels(fit.model, records)
    likelihood = OutputError() if likelihood is None else likelihood
    _require_simulated(fit, likelihood)
    require(
        knots is None or knots >= 2,
        f"There are {knots} knots in each record; free-form means two at least.",
    )
    require(
        len(kinds) > 0,
        "`kinds` is empty. Name members of `jaxid.effects.LocationKind`, such as EQUATION.",
    )
    problem = Problem.of(fit.model, fit.free, records, likelihood)
    if equations is None:
        equations = uncertain_equations(problem.model, np.asarray(problem.positions.shared))
    require_known("state (in `equations`)", equations, fit.model.states)
    splines = resolution(records, fit.residuals) if knots is None else (knots, records.t.shape[-1])
    places = {
        LocationKind.EQUATION: tuple(equations),
        LocationKind.INPUT: fit.model.inputs,
        LocationKind.SENSOR: fit.model.outputs,
        LocationKind.PARAMETER: fit.free.shared,
        LocationKind.AIR: gusts_of(problem.model),
    }
    require(
        all(kind in places for kind in kinds),
        f"`kinds` is {tuple(kinds)}. Name members of `jaxid.effects.LocationKind` among "
        f"{', '.join(kind.name for kind in places)}.",
    )
    linearised = _sensitivities(problem, fit.parameters)
    requested = {kind: places[kind] for kind in kinds if places[kind]}
    words = " or ".join(kind.label for kind in kinds)
    require(len(requested) > 0, f"The model has no place of the kind {words}. Name another kind.")
    linear = linear_models(problem, fit.parameters, tuple(requested.items()))
    return localise(problem, linear, linearised, fit.noise, splines, requested)


def _require_simulated(fit: Estimate, likelihood: AbstractLikelihood) -> None:
    """Refuse a fit by a filter."""
    filtered = isinstance(fit.model, StochasticModel | InnovationModel)
    require(
        isinstance(likelihood, OutputError) and not filtered,
        "A residual is localised in a simulation, and the states of this fit are corrected by the "
        "measurements. Give a fit by OutputError.",
    )


def resolution(records: Record, v: Float[Array, "case time output"]) -> tuple[int, int]:
    """Return the number of B-splines (20 or 60) and of rows that the residual's spectrum requires.

    B-splines with knots `1/(2.5 f)` apart follow signals slower than f, the frequency below which
    95 % of the residual's power lies. The power of white noise, estimated by the median over all
    frequencies, is subtracted first; otherwise the knots would resolve the noise and cover only a
    few rows of a long record. The rows are all of a record, or a half, a quarter, ...

    Args:
        records: a stack, sampled about uniformly.
        v: its residuals.
    """
    residual = np.asarray(v)
    step, rows = float(typical_step(records.t)), records.t.shape[-1]
    size = np.maximum(np.sqrt(np.mean(residual**2, axis=(0, 1))), 1e-300)
    power = np.abs(np.fft.rfft(residual / size, axis=1)) ** 2
    spectrum = np.sum(power, axis=(0, 2))
    cumulative = np.cumsum(np.maximum(spectrum - np.median(spectrum), 0.0))
    fast = np.fft.rfftfreq(rows, step)[np.searchsorted(cumulative, 0.95 * cumulative[-1])]
    spacing = 1.0 / (2.5 * max(float(fast), 1.0 / (rows * step)))
    wanted = int(np.ceil((rows - 1) * step / spacing)) + 1
    halvings = max(int(np.ceil(np.log2(wanted / MANY_KNOTS))), 0)
    return (FEW_KNOTS if wanted <= FEW_KNOTS else MANY_KNOTS), max(
        rows >> halvings, min(rows, 2 * MANY_KNOTS)
    )


@fast_compile_jit
def _sensitivities(problem: Problem, parameters: Parameters):
    """Return residuals and sensitivities, first those to the per-record parameters (jitted)."""
    return problem.sensitivities(parameters)


class LocalisationArrays(NamedTuple):
    """Arrays of a localisation: values of each place, and the whitened sum of squares of the
    residual with its degrees of freedom.
    """

    score: Float[Array, " place"]
    dof: Float[Array, " place"]
    disturbance: Float[Array, "place case knot"]
    deviation: Float[Array, "place case knot"]
    knots: Float[Array, "case knot"]
    variables: Float[Array, "case knot variable"]
    squares: Float[Array, ""]
    samples: Float[Array, ""]


def localise(
    problem: Problem,
    linear: Linear,
    linearised: tuple[Float[Array, "case time output"], Float[Array, "case time output column"]],
    noise: Float[Array, "output output"],
    splines: tuple[int, int],
    places: Mapping[LocationKind, tuple[str, ...]],
) -> LocalisationResult:
    """Localise the residual of a problem at its solution; see `localise_residual`.

    Args:
        problem: the estimation problem.
        linear: its linear models at the solution, with these places.
        linearised: residuals and sensitivities to the free parameters (`Problem.sensitivities`).
        noise: R; if it was estimated, its diagonal is limited to the variance of the white part of
            the residual.
        splines: number of B-splines in each record, and number of rows that they cover.
        places: names by kind: of states, and all inputs, outputs, or shared parameters of the
            problem.
    """
    noise_known, noise_dof = problem.likelihood.noise.is_known, np.inf
    if not noise_known:
        # An estimated R contains the model error, and would hide the channel with the largest one.
        white, R = white_noise_variance(linearised[0], problem.records.mask), np.diagonal(noise)
        noise = to_device(np.diag(np.clip(np.asarray(white), 1e-6 * R, R)))
        counts = np.sum(np.asarray(problem.records.mask), axis=(0, 1))
        noise_dof = float(np.min(np.where(counts > 0, counts, np.inf))) / SAMPLES_PER_DEGREE
    records, own = problem.records, problem.positions.rows.size
    signals = records.t, records.u, records.mask
    arrays = search(linear, signals, linearised, noise, own, *splines)
    squares, samples = float(arrays.squares), float(arrays.samples)
    most = float(np.max(np.asarray(arrays.score) - np.asarray(arrays.dof)))
    power = max(squares - samples if noise_known else squares, most)
    power = power if power > 0 else float("nan")
    locations = [Location(kind, name) for kind, names in places.items() for name in names]
    scores, dofs = np.asarray(arrays.score).tolist(), np.asarray(arrays.dof).tolist()
    disturbances, deviations = np.asarray(arrays.disturbance), np.asarray(arrays.deviation)
    rows = [
        Place(location, score, int(dof), (score - dof) / power, disturbances[k], deviations[k])
        for k, (location, score, dof) in enumerate(zip(locations, scores, dofs, strict=True))
    ]
    variables = (*problem.model.states, *problem.model.inputs, *problem.model.outputs)
    named = dict(zip(variables, np.moveaxis(np.asarray(arrays.variables), -1, 0), strict=True))
    return LocalisationResult(
        tuple(sorted(rows, key=lambda place: -place.score + place.dof)),
        np.asarray(arrays.knots),
        named,
        splines,
        power,
        noise_dof,
    )


@fast_compile_jit
def search(
    linear: Linear,
    signals: tuple[
        Float[Array, "case time"], Float[Array, "case time input"], Bool[Array, "case time output"]
    ],
    linearised: tuple[Float[Array, "case time output"], Float[Array, "case time output column"]],
    noise: Float[Array, "output output"],
    own: int,
    knots: int,
    rows: int,
) -> LocalisationArrays:
    """Array computation of `localise_residual`, on the first rows of each record.

    Args:
        linear: linear model of each record, with a disturbance at each place.
        signals: times, inputs and valid samples.
        linearised: residuals and sensitivities, those to the per-record parameters first.
        noise: R; its diagonal is used.
        own: number of per-record parameters.
        knots, rows: number of splines in each record, and of the rows that they cover.
    """
    t, u, mask = (part[:, :rows] for part in signals)
    v, S = (part[:, :rows] for part in linearised)
    scaled = mask / jnp.sqrt(jnp.diagonal(noise))[None, None]

    def responses(linear, t, u, weight):
        splines, grid = spline_basis(t, knots)
        at = jnp.clip(jnp.searchsorted(t, grid), 0, rows - 1)
        variables = jnp.concatenate([linear.x, u, linear.y], axis=-1)[at]
        return weight[..., None, None] * answers(linear, splines), grid, variables

    G, grid, variables = jax.vmap(responses)(linear.of_rows(rows), t, u, scaled)
    white, columns = v * scaled, S * scaled[..., None]
    basis = _basis(columns, own)
    cases = G.shape[0]
    G = jnp.moveaxis(G.reshape(cases, -1, *G.shape[-2:]), 2, 0)
    directions, white = basis.reshape(cases, G.shape[2], -1), white.reshape(cases, -1)
    samples = jnp.sum(mask) - jnp.sum(jnp.any(basis != 0, axis=0))
    squares = jnp.sum(
        (white - jnp.einsum("crd,d->cr", directions, jnp.einsum("crd,cr->d", directions, white)))
        ** 2
    )
    values = jax.lax.map(
        lambda response: _explained(response, directions, white, squares, samples), G
    )
    return LocalisationArrays(*values, grid, variables, squares, samples)


def _basis(
    columns: Float[Array, "case time output column"], own: int
) -> Float[Array, "row direction"]:
    """Orthonormal basis of the responses to the free parameters.

    The own unknowns of each record have columns of their own.
    """
    cases = columns.shape[0]
    own_columns, shared = columns[..., :own], columns[..., own:]
    apart = jnp.eye(cases)[:, None, None, :, None] * own_columns[:, :, :, None, :]
    A = jnp.concatenate([apart.reshape(*apart.shape[:3], -1), shared], axis=-1)
    A = A.reshape(-1, A.shape[-1])
    length = jnp.linalg.norm(A, axis=0)
    U, s, _ = jnp.linalg.svd(A / jnp.where(length > 0, length, 1.0)[None], full_matrices=False)
    return U * (s > 1e-10 * jnp.max(s, initial=0.0))[None]


def _explained(
    G: Float[Array, "case row knot"],
    basis: Float[Array, "case row direction"],
    v: Float[Array, "case row"],
    squares: Float[Array, ""],
    samples: Int[Array, ""],
):
    """Score, dof, disturbance and deviation of one place."""
    cases, _, knots = G.shape
    inside = jnp.einsum("crd,crk->dck", basis, G).reshape(-1, cases * knots)
    own = jnp.einsum("crk,crl->ckl", G, G)
    gram = jnp.eye(cases)[:, None, :, None] * own[:, :, None, :]
    gram = gram.reshape(cases * knots, cases * knots)
    # The tolerance is relative to the splines themselves, because only rounding errors remain of a
    # response that the free parameters reproduce.
    size = jnp.sqrt(jnp.maximum(jnp.diagonal(gram), jnp.finfo(float).tiny))
    projected_gram = (gram - inside.T @ inside) / (size[:, None] * size[None])
    rhs = jnp.einsum(
        "crk,cr->ck", G, v - jnp.einsum("crd,d->cr", basis, jnp.einsum("crd,cr->d", basis, v))
    ).reshape(-1)
    values, vectors = jnp.linalg.eigh(projected_gram)
    strong = values > WEAK_DIRECTION * jnp.maximum(values[-1], 1.0)
    inverse = jnp.where(strong, 1.0 / jnp.where(strong, values, 1.0), 0.0)
    projected = vectors.T @ (rhs / size)
    score, dof = jnp.sum(inverse * projected**2), jnp.sum(strong)
    # The remaining residual is the noise. Each direction is weighted by its excess over the noise
    # (empirical Bayes); otherwise directions that hardly move an output would dominate.
    noise = jnp.maximum(squares - score, 0.0) / jnp.maximum(samples - dof, 1.0)
    power = jnp.where(strong, inverse * projected**2, 1.0)
    shrinkage = jnp.where(
        strong, jnp.maximum(1.0 - noise / jnp.maximum(power, jnp.finfo(float).tiny), 0.0), 0.0
    )
    best = vectors @ (shrinkage * inverse * projected) / size
    spread = jnp.sqrt(noise * jnp.sum(vectors**2 * (shrinkage * inverse)[None], axis=1)) / size
    # Knots that lie mainly in directions without influence on the outputs.
    unobservable = jnp.sum(jnp.where(strong, 0.0, vectors**2), axis=1) > 0.5
    deviation = jnp.where(unobservable, jnp.inf, spread)
    return score, dof, best.reshape(cases, knots), deviation.reshape(cases, knots)
