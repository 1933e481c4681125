"""Where a residual comes from: a free-form disturbance in every equation, input, output and parameter, one place at a time.

What the free parameters could do as well is projected out of the outputs' answers to the disturbance (`free_form`).
"""
# Pyright counts the arguments of functions that equinox and jaxtyping wrap in its own way; the tests execute them.
# pyright: reportCallIssue=false

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.grid import typical_step
from .._foundation.quickly import quickly
from .._foundation.types import Array, Float, Int
from ..data.record import Record
from ..estimation.estimate import as_stack, check_channels
from ..estimation.likelihoods import OutputError
from ..estimation.problem import Problem
from ..estimation.result import Estimate
from ..models.free import Parameters
from ..models.library import uncertain_equations
from ..models.noise import FixedNoise
from .free_form import FORCES, Kind, Places, answers, gusts_of, hats_of, linear_model
from .predictable import white_part
from .scores import sensitivities

BEST = 3.0  # times the median weight: no knot counts for more, however well its disturbance is known
FEW, MANY = 20, 60  # hats: two numbers only, so that studies share what is compiled
WEAK = (
    1e-8  # of the largest eigenvalue of a place's information: below it a direction is imitated by the free parameters
)


class Place(NamedTuple):
    """One place, and what a free-form disturbance there would explain.

    Attributes:
        kind, name: an equation by its state, an input, an output, a parameter that drifts, or the air by what moves in it.
        score: by how much the whitened sum of squares of the residual falls; chi-square with `dof` where nothing is missing.
        dof: how many combinations of hats the free parameters cannot imitate.
        share: of the residual's power (of what it has beyond the noise, where that is known) the part that is explained, what
            white noise would let it explain taken off; NaN where there is nothing beyond the noise.
        disturbance, deviation: the one that explains most, as far as it stands out of the noise, and its standard deviation,
            shape (case, knot) [rate of the state, or the channel's or parameter's unit].
    """

    kind: Kind
    name: str
    score: float
    dof: int
    share: float
    disturbance: Float[np.ndarray, "case knot"]
    deviation: Float[np.ndarray, "case knot"]

    @property
    def size(self) -> float:
        """Root mean square of the disturbance."""
        return float(np.sqrt(np.mean(self.disturbance**2)))


class Where(NamedTuple):
    """The places, that of the highest share first.

    Attributes:
        places: all that were asked about.
        knots: times of the hats' tops, shape (case, knot) [s].
        variables: states, inputs and outputs at the knots, by name, each of shape (case, knot).
        hats: how many there are in each record, and over how many of its rows.
        power: what the shares are of: the whitened sum of squares of the residual, less its degrees of freedom where the noise
            is known; where that scatters below what the first place explains, what that explains. NaN where it explains nothing.
    """

    places: tuple[Place, ...]
    knots: Float[np.ndarray, "case knot"]
    variables: dict[str, Float[np.ndarray, "case knot"]]
    hats: tuple[int, int]
    power: float

    def rivals(self, within: float = 0.05) -> tuple[Place, ...]:
        """The first place and those whose share is less than `within` below its."""
        first, *others = self.places
        return (first, *(one for one in others if one.share > first.share - within))

    def random(self) -> tuple[Place, ...]:
        """Where a random force could act: in the equations, or in the air, or in both, as the first place and its rivals say."""
        kinds = {one.kind for one in self.rivals()}
        return tuple(one for kind in FORCES if kind in kinds for one in self.places if one.kind == kind)

    def follows(self, place: Place) -> tuple[tuple[str, float], ...]:
        """By how much each variable says the disturbance at a place, as its cubic: share of its power, the best first.

        Each knot counts by how well the disturbance is known there. The free parameters can imitate a part of the
        disturbance, so that its linear part in a variable may be missing from it.
        """
        d, weight = place.disturbance.reshape(-1), 1.0 / np.maximum(place.deviation.reshape(-1), 1e-300)
        weight = np.minimum(weight, BEST * np.median(weight[weight > 0])) if np.any(weight > 0) else weight
        power = float(np.sum((weight * d) ** 2))
        found = []
        for name, values in self.variables.items():
            s = values.reshape(-1)
            size = np.ptp(s) or 1.0
            A = weight[:, None] * np.vander((s - s.mean()) / size, 4)
            rest = weight * d - A @ np.linalg.lstsq(A, weight * d, rcond=None)[0]
            found.append((name, 1.0 - float(rest @ rest) / power if power > 0 else 0.0))
        return tuple(sorted(found, key=lambda one: -one[1]))

    def __str__(self) -> str:
        width = max(len(f"{one.kind} {one.name}") for one in self.places)
        lines = [f"{'place':<{width}} {'share':>8} {'chi-square':>11} {'dof':>5}"]
        for one in self.places:
            lines.append(f"{one.kind + ' ' + one.name:<{width}} {one.share:>8.1%} {one.score:>11.4g} {one.dof:>5}")
        return "\n".join(lines)


def where(
    fit: Estimate,
    records: Record | Sequence[Record],
    likelihood: OutputError | None = None,
    *,
    knots: int | None = None,
    kinds: Sequence[Kind] = ("equation", "input", "output", "air"),
    equations: Sequence[str] | None = None,
) -> Where:
    r"""How much of the residual a free-form disturbance at each place could explain, beyond what the free parameters do.

        score = v' R^-1 G (G' M G)^-1 G' R^-1 v,    M the projection that takes out the free parameters' sensitivities,
                                                    R its diagonal

    with G the outputs' answers to the hats at one place, each record with hats of its own. A place that is not the cause can
    explain nearly as much where it moves the outputs in nearly the same way: a force on a mass and the input that pushes it are
    one to the data. What acts on whole signals (a sensor's lag) is left out of the linear model.

    Args:
        fit: of the model, from `estimate` on these records, with what is known of the noise in `fit.noise`.
        records: those it was fitted to.
        likelihood: that of the fit.
        knots: hats in each record; by default 20 or 60, as the residual's spectrum asks for (`resolution`), and where that is
            not enough, only the first part of each record is looked at.
        kinds: which places to ask about. The `air` is one where the model knows of gusts. A `parameter` that drifts acts in an
            equation, times what it multiplies: it can explain more than any force there, so that it is asked about by name.
        equations: the states whose equations may be disturbed; by default those that hold a free parameter, as the others
            are exact by definition.

    Returns:
        Places in falling order of their share, with the disturbance that explains most.

    Raises:
        InputError: when channels differ, there are fewer than two knots, no kind is asked about, or a state does not exist.
    """
    records = as_stack(records)
    check_channels(fit.model, records)
    require(knots is None or knots >= 2, f"There are {knots} knots in each record; free-form means two at least.")
    require(len(kinds) > 0, "No kind of place is asked about. Name one of equation, input, output, parameter, air.")
    problem = Problem.of(fit.model, fit.free, records, OutputError() if likelihood is None else likelihood)
    if equations is None:
        equations = uncertain_equations(problem.model, np.asarray(problem.positions.shared))
    require_known("state (in `equations`)", equations, fit.model.states)
    hats = resolution(records, fit.residuals) if knots is None else (knots, records.t.shape[-1])
    places = {"equation": tuple(equations), "input": fit.model.inputs, "output": fit.model.outputs}
    places |= {"parameter": fit.free.shared, "air": gusts_of(problem.model)}
    seen = sensitivities(problem, fit.parameters)
    asked: dict[Kind, tuple[str, ...]] = {kind: places[kind] for kind in kinds if places[kind]}
    require(len(asked) > 0, f"The model has no place of the kind {' or '.join(kinds)}. Ask about another one.")
    return located(problem, fit.parameters, seen, fit.noise, hats, asked)


def resolution(records: Record, v: Float[Array, "case time output"]) -> tuple[int, int]:
    """How many hats, 20 or 60, over how many rows of each record, the residual's spectrum asks for: all, or half, a quarter...

    Hats with their tops `1/(2.5 f)` apart follow what is slower than f, below which 95 % of the residual's power lies, but for
    that of white noise, the median over all frequencies: else it asked for hats that follow the noise, and where the record
    is long so few rows are left that they may miss what happens.

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
    halvings = max(int(np.ceil(np.log2(wanted / MANY))), 0)
    return (FEW if wanted <= FEW else MANY), max(rows >> halvings, min(rows, 2 * MANY))


class Found(NamedTuple):
    """What `search` leaves, as arrays: of each place, and the whitened sum of squares with its degrees of freedom."""

    score: Float[Array, " place"]
    dof: Float[Array, " place"]
    disturbance: Float[Array, "place case knot"]
    deviation: Float[Array, "place case knot"]
    knots: Float[Array, "case knot"]
    variables: Float[Array, "case knot variable"]
    squares: Float[Array, ""]
    samples: Float[Array, ""]


def located(
    problem: Problem,
    parameters: Parameters,
    seen: tuple[Float[Array, "case time output"], Float[Array, "case time output column"]],
    noise: Float[Array, "output output"],
    hats: tuple[int, int],
    places: Mapping[Kind, tuple[str, ...]],
) -> Where:
    """`where` for a problem and its solution.

    Args:
        problem, parameters: what was solved, and its solution.
        seen: its residuals, and its sensitivities to what is free (`sensitivities`).
        noise: R; where it was estimated, its diagonal is replaced by what is white in the residual, if that is less.
        hats: how many in each record, and over how many of its rows.
        places: names by kind: of states, and all inputs, outputs, or shared parameters of the problem.
    """
    noise_known = isinstance(problem.likelihood.noise, FixedNoise)
    if not noise_known:
        # An estimate of R counts what the model lacks as noise, and would hide the channel in which it shows most.
        white = white_part(seen[0], problem.records.mask)
        noise = jnp.diag(jnp.clip(white, 1e-6 * jnp.diagonal(noise), jnp.diagonal(noise)))
    found = search(problem, parameters, seen, noise, *hats, tuple(places.items()))
    squares, samples = float(found.squares), float(found.samples)
    most = float(np.max(np.asarray(found.score) - np.asarray(found.dof)))
    power = max(squares - samples if noise_known else squares, most)
    power = power if power > 0 else float("nan")
    names = [(kind, name) for kind, of in places.items() for name in of]
    rows = [
        Place(*place, score, int(dof), (score - dof) / power, disturbance, deviation)
        for place, score, dof, disturbance, deviation in zip(
            names, *(np.asarray(one).tolist() for one in found[:2]), *map(np.asarray, found[2:4]), strict=True
        )
    ]
    variables = (*problem.model.states, *problem.model.inputs, *problem.model.outputs)
    named = {name: np.asarray(found.variables[..., k]) for k, name in enumerate(variables)}
    return Where(tuple(sorted(rows, key=lambda one: -one.score + one.dof)), np.asarray(found.knots), named, hats, power)


@quickly
def search(
    problem: Problem,
    parameters: Parameters,
    seen: tuple[Float[Array, "case time output"], Float[Array, "case time output column"]],
    noise: Float[Array, "output output"],
    knots: int,
    rows: int,
    places: Places,
) -> Found:
    """The pure inside of `where`, on the first rows of each record."""
    parts = {name: getattr(problem.records, name)[:, :rows] for name in ("t", "u", "z", "mask")}
    problem = eqx.tree_at(lambda one: [getattr(one.records, name) for name in parts], problem, list(parts.values()))
    v, S = (one[:, :rows] for one in seen)
    scaled = problem.records.mask / jnp.sqrt(jnp.diagonal(noise))[None, None]

    def one(own, case, seen):
        t, u = case[1].t, case[1].u
        linear = linear_model(problem, own, parameters.shared, case, places)
        hats, grid = hats_of(t, knots)
        at = jnp.clip(jnp.searchsorted(t, grid), 0, rows - 1)
        variables = jnp.concatenate([linear.x, u, linear.y], axis=-1)[at]
        return seen[..., None, None] * answers(linear, hats), grid, variables

    G, grid, variables = jax.vmap(one)(parameters.rows, problem.cases(), scaled)
    white, columns = v * scaled, S * scaled[..., None]
    basis = _basis(columns, problem.positions.rows.size)
    cases = G.shape[0]
    G = jnp.moveaxis(G.reshape(cases, -1, *G.shape[-2:]), 2, 0)
    directions, white = basis.reshape(cases, G.shape[2], -1), white.reshape(cases, -1)
    samples = jnp.sum(problem.records.mask) - jnp.sum(jnp.any(basis != 0, axis=0))
    squares = jnp.sum((white - jnp.einsum("crd,d->cr", directions, jnp.einsum("crd,cr->d", directions, white))) ** 2)
    values = jax.lax.map(lambda of_place: _explained(of_place, directions, white, squares, samples), G)
    return Found(*values, grid, variables, squares, samples)


def _basis(columns: Float[Array, "case time output column"], own: int) -> Float[Array, "row direction"]:
    """Orthonormal basis of what the free parameters can do, each record's own unknowns in columns of its own."""
    cases = columns.shape[0]
    mine, shared = columns[..., :own], columns[..., own:]
    apart = jnp.eye(cases)[:, None, None, :, None] * mine[:, :, :, None, :]
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
    # Rounding is measured against the hats themselves: what the free parameters imitate leaves nothing but rounding of it.
    size = jnp.sqrt(jnp.maximum(jnp.diagonal(gram), jnp.finfo(float).tiny))
    left = (gram - inside.T @ inside) / (size[:, None] * size[None])
    toward = jnp.einsum("crk,cr->ck", G, v - jnp.einsum("crd,d->cr", basis, jnp.einsum("crd,cr->d", basis, v))).reshape(
        -1
    )
    values, vectors = jnp.linalg.eigh(left)
    strong = values > WEAK * jnp.maximum(values[-1], 1.0)
    inverse = jnp.where(strong, 1.0 / jnp.where(strong, values, 1.0), 0.0)
    turned = vectors.T @ (toward / size)
    score, dof = jnp.sum(inverse * turned**2), jnp.sum(strong)
    # What this place leaves is the noise; a direction counts by how far it stands out of it (empirical Bayes, direction by
    # direction), else the directions that hardly move an output would drown the others.
    noise = jnp.maximum(squares - score, 0.0) / jnp.maximum(samples - dof, 1.0)
    seen = jnp.where(strong, inverse * turned**2, 1.0)
    stands_out = jnp.where(strong, jnp.maximum(1.0 - noise / jnp.maximum(seen, jnp.finfo(float).tiny), 0.0), 0.0)
    best = vectors @ (stands_out * inverse * turned) / size
    spread = jnp.sqrt(noise * jnp.sum(vectors**2 * (stands_out * inverse)[None], axis=1)) / size
    unseen = jnp.sum(jnp.where(strong, 0.0, vectors**2), axis=1) > 0.5  # most of it lies where nothing is felt
    return score, dof, best.reshape(cases, knots), jnp.where(unseen, jnp.inf, spread).reshape(cases, knots)
