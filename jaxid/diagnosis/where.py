"""Where a residual comes from: free-form disturbances in every equation, input, output and parameter, one place at a time.

A disturbance `d(t)` is a sum of hat functions. What it does to the outputs follows from the linear model along the trajectory,

    dx_(i+1) = Phi_i dx_i + h/2 (Phi_i B_i d_i + B_(i+1) d_(i+1)),    dy_i = C_i dx_i + D_i d_i

so that every place costs a linear recursion and no simulation. What the free parameters could do as well is projected out.
"""
# Pyright counts the arguments of functions that equinox and jaxtyping wrap in its own way; the tests execute them.
# pyright: reportCallIssue=false

from collections.abc import Sequence
from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.types import Array, Float
from ..data.record import Record
from ..estimation.estimate import as_stack, check_channels
from ..estimation.likelihoods import OutputError
from ..estimation.problem import Limits, Problem
from ..estimation.result import Estimate
from ..models.base import AbstractModel, canonical
from ..models.free import Parameters, insert
from ..models.library import uncertain_equations
from ..models.noise import FixedNoise
from ..simulation.simulate import run

Kind = Literal["equation", "input", "output", "parameter"]
WEAK = (
    1e-8  # of the largest eigenvalue of a place's information: below it a direction is imitated by the free parameters
)


class Place(NamedTuple):
    """One place, and what a free-form disturbance there would explain.

    Attributes:
        kind, name: an equation by its state, an input, an output, or a parameter that drifts.
        score: by how much the whitened sum of squares of the residual falls; chi-square with `dof` where nothing is missing.
        dof: how many combinations of hats the free parameters cannot imitate.
        share: of the residual's power (of what it has beyond the noise, where that is known) the part that is explained, what
            white noise would let it explain taken off; NaN where there is nothing beyond the noise.
        disturbance, deviation: the one that explains most and its standard deviation, shape (case, knot) [rate of the state,
            or the channel's or parameter's unit].
    """

    kind: Kind
    name: str
    score: float
    dof: int
    share: float
    disturbance: Float[np.ndarray, "case knot"]
    deviation: Float[np.ndarray, "case knot"]


class Where(NamedTuple):
    """The places, that of the highest share first.

    Attributes:
        places: all that were asked about.
        knots: times of the hats' tops, shape (case, knot) [s].
        power: what the shares are of: the whitened sum of squares of the residual, less its degrees of freedom where the noise
            is known.
    """

    places: tuple[Place, ...]
    knots: Float[np.ndarray, "case knot"]
    power: float

    def rivals(self, within: float = 0.05) -> tuple[Place, ...]:
        """The first place and those whose share is less than `within` below its."""
        return tuple(one for one in self.places if one.share > self.places[0].share - within)

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
    knots: int = 20,
    kinds: Sequence[Kind] = ("equation", "input", "output"),
    equations: Sequence[str] | None = None,
) -> Where:
    r"""How much of the residual a free-form disturbance at each place could explain, beyond what the free parameters do.

        score = v' R^-1 G (G' M G)^-1 G' R^-1 v,    M the projection that takes out the free parameters' sensitivities

    with G the outputs' answers to the hats at one place, each record with hats of its own. A place that is not the cause can
    explain nearly as much where it moves the outputs in nearly the same way: a force on a mass and the input that pushes it are
    one to the data. What acts on whole signals (a sensor's lag) is left out of the linear model.

    Args:
        fit: of the model, from `estimate` on these records, with what is known of the noise in `fit.noise`.
        records: those it was fitted to.
        likelihood: that of the fit.
        knots: hats in each record.
        kinds: which places to ask about. A `parameter` that drifts acts in an equation, times what it multiplies: it can
            explain more than any force there, so that it is asked about by name.
        equations: the states whose equations may be disturbed; by default those that hold a free parameter, as the others
            are exact by definition.

    Returns:
        Places in falling order of their share, with the disturbance that explains most.

    Raises:
        InputError: when channels differ, there are fewer than two knots, no kind is asked about, or a state does not exist.
    """
    records = as_stack(records)
    check_channels(fit.model, records)
    require(knots >= 2, f"There are {knots} knots in each record; free-form means two at least.")
    require(len(kinds) > 0, "No kind of place is asked about. Name one of equation, input, output, parameter.")
    model, free = canonical(fit.model), canonical(fit.free)
    likelihood = OutputError() if likelihood is None else likelihood
    limits = Limits.of(free, records.n_cases)
    problem = Problem(model, free.positions(model), records.anonymous(), canonical(likelihood), limits)
    if equations is None:
        equations = uncertain_equations(model, np.asarray(problem.positions.shared))
    require_known("state (in `equations`)", equations, model.states)
    found = search(problem, fit.parameters, fit.noise, knots, tuple(kinds), tuple(equations))
    names = {"equation": tuple(equations), "input": model.inputs, "output": model.outputs, "parameter": free.shared}
    return ranked(
        found, [(kind, name) for kind in kinds for name in names[kind]], isinstance(likelihood.noise, FixedNoise)
    )


class Found(NamedTuple):
    """What `search` leaves, as arrays: of each place, and the whitened sum of squares with its degrees of freedom."""

    score: Float[Array, " place"]
    dof: Float[Array, " place"]
    disturbance: Float[Array, "place case knot"]
    deviation: Float[Array, "place case knot"]
    knots: Float[Array, "case knot"]
    squares: Float[Array, ""]
    samples: Float[Array, ""]


def ranked(found: Found, places: Sequence[tuple[Kind, str]], noise_known: bool) -> Where:
    """Put names to the arrays.

    Args:
        found: from `search`.
        places: kind and name, in its order.
        noise_known: whether the whitened sum of squares says how much there is beyond the noise.
    """
    squares, samples = float(found.squares), float(found.samples)
    power = squares - samples if noise_known else squares
    power = power if power > 0 else float("nan")
    by_chance = 1.0 if noise_known else squares / samples
    rows = [
        Place(*place, score, int(dof), (score - by_chance * dof) / power, disturbance, deviation)
        for place, score, dof, disturbance, deviation in zip(
            places, *(np.asarray(one).tolist() for one in found[:2]), *map(np.asarray, found[2:4]), strict=True
        )
    ]
    return Where(tuple(sorted(rows, key=lambda one: -one.score + one.dof)), np.asarray(found.knots), power)


class Linear(NamedTuple):
    """The linear model along one trajectory: transitions, outputs, and how each place enters."""

    Phi: Float[Array, "step state state"]
    C: Float[Array, "time output state"]
    B: Float[Array, "time state place"]
    D: Float[Array, "time output place"]


@eqx.filter_jit
def search(
    problem: Problem, parameters: Parameters, noise, knots: int, kinds: tuple[Kind, ...], equations: tuple[str, ...]
) -> Found:
    """The pure inside of `where`."""
    v, S = problem.sensitivities(parameters)
    scaled = problem.records.mask / jnp.sqrt(jnp.diagonal(noise))[None, None]

    def one(own, case, seen):
        linear = _linear_model(problem, own, parameters.shared, case, kinds, equations)
        hats, grid = _hats(case[1].t, knots)
        return seen[..., None, None] * _answers(linear, case[1].t, hats), grid

    G, grid = jax.vmap(one)(parameters.rows, problem.cases(), scaled)
    white, columns = v * scaled, S * scaled[..., None]
    basis = _basis(columns, problem.positions.rows.size)
    cases, places = G.shape[0], G.shape[-2]
    G = jnp.moveaxis(G.reshape(cases, -1, places, knots), 2, 0)
    rows, white = basis.reshape(cases, G.shape[2], -1), white.reshape(cases, -1)
    values = jax.lax.map(lambda of_place: _explained(of_place, rows, white), G)
    samples = jnp.sum(problem.records.mask) - jnp.sum(jnp.any(basis != 0, axis=0))
    return Found(*values, grid, jnp.sum(white**2), samples)


def _linear_model(problem: Problem, own, shared, case, kinds: tuple[Kind, ...], equations: tuple[str, ...]) -> Linear:
    """Along the trajectory of one case."""
    flat, record = case
    likelihood = problem.likelihood
    assert isinstance(likelihood, OutputError)

    def made(theta):
        return insert(problem.model, flat, problem.positions, theta, own)

    model, x0 = made(shared)
    t, u = record.t, record.u
    x = run(model, t, u, x0, likelihood.hold, likelihood.stepper).x
    path = model.input_path(likelihood.hold.path(t, u))

    def interval(i, x):
        return likelihood.stepper.states(model, jax.lax.dynamic_slice(t, (i,), (2,)), path, x)[0][1]

    Phi = jax.vmap(jax.jacfwd(interval, argnums=1))(jnp.arange(t.size - 1), x[:-1])
    Phi = jnp.where((jnp.diff(t) > 0)[:, None, None], Phi, jnp.eye(x.shape[1]))

    def at(t, x, u):
        dx = model.rhs(t, x, u)
        parts = []
        for kind in kinds:
            if kind == "equation":
                D = jax.jacfwd(lambda rate: model.output_given(t, x, u, rate))(dx)
                chosen = np.array([model.states.index(name) for name in equations], int)
                parts.append((jnp.eye(x.size)[:, chosen], D[:, chosen]))
            elif kind == "input":
                parts.append((jax.jacfwd(model.rhs, 2)(t, x, u), jax.jacfwd(model.output, 2)(t, x, u)))
            elif kind == "output":
                parts.append((jnp.zeros((x.size, len(model.outputs))), jnp.eye(len(model.outputs))))
            else:
                parts.append(_by_parameter(made, t, x, u, shared))
        B, D = (jnp.concatenate(part, axis=1) for part in zip(*parts, strict=True))
        return jax.jacfwd(model.output, 1)(t, x, u), B, D

    C, B, D = jax.vmap(at)(t, x, u)
    return Linear(Phi, C, B, D)


def _by_parameter(made, t, x, u, shared):
    """How the rates and the outputs at a given state change with each shared parameter."""

    def both(theta):
        model: AbstractModel = made(theta)[0]
        return model.rhs(t, x, u), model.output(t, x, u)

    return jax.jacfwd(both)(shared)


def _hats(t: Float[Array, " time"], knots: int) -> tuple[Float[Array, "time knot"], Float[Array, " knot"]]:
    """Hat functions over one record, and the times of their tops."""
    grid = jnp.linspace(t[0], t[-1], knots)
    return jnp.clip(1.0 - jnp.abs(t[:, None] - grid[None]) / (grid[1] - grid[0]), 0.0), grid


def _answers(linear: Linear, t, hats) -> Float[Array, "time output place knot"]:
    """The outputs' answers to every hat at every place."""
    h = jnp.diff(t)
    forcing = jnp.einsum("tsp,tk->tspk", linear.B, hats)

    def step(dx, now):
        Phi, h, before, after = now
        dx = jnp.tensordot(Phi, dx + h / 2 * before, 1) + h / 2 * after
        return dx, dx

    start = jnp.zeros(forcing.shape[1:])
    _, later = jax.lax.scan(step, start, (linear.Phi, h, forcing[:-1], forcing[1:]))
    dx = jnp.concatenate([start[None], later])
    return jnp.einsum("tos,tspk->topk", linear.C, dx) + jnp.einsum("top,tk->topk", linear.D, hats)


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
    G: Float[Array, "case row knot"], basis: Float[Array, "case row direction"], v: Float[Array, "case row"]
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
    best = vectors @ (inverse * turned) / size
    spread = jnp.sqrt(jnp.sum(vectors**2 * inverse[None], axis=1)) / size
    return jnp.sum(inverse * turned**2), jnp.sum(strong), best.reshape(cases, knots), spread.reshape(cases, knots)
