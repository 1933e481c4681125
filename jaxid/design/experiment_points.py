"""Experiment points: at which trims to fly, and for how long (C.4.2.2 of the report)."""

import itertools
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_float64
from .._foundation.types import Array, Float, Int, Numbers
from .exchange import NEGLIGIBLE, allocate
from .measures import AbstractMeasure

Basis = Callable[[Array], Array]

# Two points of a design between which every candidate is as useful as the design, but for this
# share, are one point between them. A point with a smaller share of the effort is left out (both
# chosen). The certificate is computed afterwards.
FLAT, SMALLEST_SHARE = 1e-3, 2e-3
# Multiplicative steps that determine the weights of a design of few points (chosen), and the
# largest move of a point on the grid at first.
WEIGHT_STEPS, FIRST_MOVE = 300, 256


class ExperimentPoints(eqx.Module):
    """Points of an experiment with the share of the effort for each.

    Attributes:
        points: where to fly, in increasing order [unit of the candidates].
        shares: share of the total cost at each point; the sum is one.
        times: time at each point, `share total / cost` [unit of the total per unit of cost].
        value: value of the measure for a total of one.
        certificate: `max phi / trace(W M^-1)` of Theorem C.1 over all candidates; a design is
            optimal at 1. For a design of limited size it is above 1 and shows the loss.
    """

    points: Float[Array, " point"]
    shares: Float[Array, " point"]
    times: Float[Array, " point"]
    value: float = eqx.field(static=True)
    certificate: float = eqx.field(static=True)

    def __str__(self) -> str:
        lines = [f"{'point':>10}{'share, %':>10}{'time':>10}"]
        rows = zip(self.points, self.shares, self.times, strict=True)
        lines += [f"{p:>10.4g}{100 * s:>10.1f}{t:>10.4g}" for p, s, t in rows]
        return "\n".join([*lines, f"certificate {self.certificate:.4f} (1 at the optimum)"])


class Candidates(eqx.Module):
    """Candidate points of an experiment on a coefficient curve.

    Attributes:
        points: where it is possible to fly, in increasing order.
        rows: regressors over the standard deviation for one unit of cost.
        cost: cost of a unit of time at each point.
        position: position of each point in the grid with the infeasible points.
    """

    points: Float[Array, " candidate"]
    rows: Float[Array, "candidate sample parameter"]
    cost: Float[Array, " candidate"]
    position: Int[np.ndarray, " candidate"]


def candidates(
    points: Float[Numbers, " candidate"],
    basis: Basis,
    *,
    deviation: Float[Numbers, " candidate"] | float = 1.0,
    cost: Float[Numbers, " candidate"] | float = 1.0,
    feasible: Sequence[bool] | np.ndarray | None = None,
) -> Candidates:
    """Return candidate points; the infeasible ones are left out.

    Args:
        points: increasing grid of points, fine compared with the precision required.
        basis: function of points, shape (point,), that returns the regressors of the curve, shape
            (point, parameter).
        deviation: standard deviation of the local estimate after one unit of time.
        cost: cost of one unit of time, such as more than 1 where an approach takes time.
        feasible: False where no experiment is possible.

    Raises:
        InputError: when the grid does not increase, a deviation or cost is not positive, or no
            point is feasible.
    """
    require_float64()
    x = np.asarray(points, float)
    require(
        x.ndim == 1 and x.size > 1 and bool(np.all(np.diff(x) > 0)),
        "The candidate points do not increase. Give a sorted grid without repetitions.",
    )
    sigma, price = (np.broadcast_to(np.asarray(v, float), x.shape) for v in (deviation, cost))
    require(
        bool(np.all(sigma > 0)) and bool(np.all(price > 0)),
        "A standard deviation or a cost is not positive. Mark points where no experiment is "
        "possible by `feasible`.",
    )
    keep = np.ones(x.size, bool) if feasible is None else np.asarray(feasible, bool)
    require(bool(keep.any()), "No candidate point is feasible. Allow a part of the range.")
    x, sigma, price = (jnp.asarray(v[keep]) for v in (x, sigma, price))
    regressors = jnp.asarray(basis(x)) / (sigma * jnp.sqrt(price))[:, None]
    return Candidates(x, regressors[:, None, :], price, np.flatnonzero(keep))


def optimal_points(
    candidate: Candidates,
    measure: AbstractMeasure,
    *,
    total: float = 1.0,
    tolerance: float = 2e-5,
) -> ExperimentPoints:
    """Return the optimal experiment: points and the time at each.

    Args:
        candidate: the points from which to choose.
        measure: the measure of the information on the curve to be minimised.
        total: the effort to be divided, in units of cost.
        tolerance: of the certificate.

    Raises:
        InputError: when the candidates do not determine the curve.
    """
    result = allocate(candidate.rows, measure, tolerance=tolerance)
    index = _joined(np.asarray(result.weights), np.asarray(result.gains), candidate.position)
    shares = np.asarray(_weights(candidate.rows[index], measure)[0])
    return _design(candidate, measure, index[shares > SMALLEST_SHARE], total)


def at_most(
    candidate: Candidates, measure: AbstractMeasure, count: int, *, total: float = 1.0
) -> ExperimentPoints:
    """Return the best experiment of at most `count` points.

    Each subset of `count` points of the optimal experiment is a start; its points then move on the
    grid, with the best weights for each position, until no move lowers the measure. Every move
    lowers the measure, but the result is a local optimum.

    Args:
        candidate: the points from which to choose.
        measure: the measure to be minimised.
        count: number of points, not below the number of parameters.
        total: the effort to be divided, in units of cost.

    Raises:
        InputError: when `count` points cannot determine the curve.
    """
    width = candidate.rows.shape[-1]
    require(
        count >= width,
        f"{count} points cannot determine {width} coefficients. Allow at least {width}.",
    )
    optimum = optimal_points(candidate, measure, total=total)
    if optimum.points.size <= count:
        return optimum
    index = np.searchsorted(np.asarray(candidate.points), np.asarray(optimum.points))
    starts = [np.array(subset) for subset in itertools.combinations(index, count)]
    costs = np.array([_cost(candidate.rows, measure, start) for start in starts])
    best = [_moved(candidate.rows, measure, starts[k]) for k in np.argsort(costs)[:4]]
    _, chosen = min(best, key=lambda pair: pair[0])
    return _design(candidate, measure, chosen, total)


def _joined(weights: np.ndarray, gains: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return the points of a design, neighbours joined at their mean.

    Neighbours stay apart if between them is a valley of usefulness or an infeasible point.
    """
    support = np.flatnonzero(weights > NEGLIGIBLE)
    level = (1.0 - FLAT) * np.sum(weights * gains)
    pairs = list(itertools.pairwise(support))
    valley = np.array([gains[low : high + 1].min() < level for low, high in pairs], bool)
    gap = np.array([position[high] - position[low] > high - low for low, high in pairs], bool)
    groups = np.split(support, np.flatnonzero(valley | gap) + 1)
    return np.array([round(np.average(group, weights=weights[group])) for group in groups])


def _design(candidate, measure, index, total) -> ExperimentPoints:
    """Return a design with its best weights and its certificate over all candidates."""
    index = np.sort(index)
    shares, cost, certificate = _certified(candidate.rows, measure, jnp.asarray(index))
    return ExperimentPoints(
        candidate.points[index],
        shares,
        shares * total / candidate.cost[index],
        float(cost),
        float(certificate),
    )


@eqx.filter_jit
def _certified(rows, measure, index):
    weight, cost = _weights(rows[index], measure)
    factor = _factor(rows[index], weight)
    phi = measure.gain(factor, rows)
    return weight, cost, jnp.max(phi) / jnp.sum(weight * phi[index])


def _factor(rows, weight):
    return (jnp.sqrt(weight)[:, None, None] * rows).reshape(-1, rows.shape[-1])


@eqx.filter_jit
def _weights(rows, measure):
    """Return the best weights of given points by multiplicative steps, and the cost."""

    def step(_, weight):
        phi = measure.gain(_factor(rows, weight), rows)
        weight = weight * jnp.sqrt(phi / jnp.sum(weight * phi))
        return weight / jnp.sum(weight)

    start = jnp.full(rows.shape[0], 1.0 / rows.shape[0])
    weight = jax.lax.fori_loop(0, WEIGHT_STEPS, step, start)
    return weight, measure.cost(_factor(rows, weight))


@eqx.filter_jit
def _costs(rows, measure, designs):
    """Return the cost of designs, shape (design, point), infinite where it is not finite."""
    cost = jax.vmap(lambda index: _weights(rows[index], measure)[1])(designs)
    return jnp.where(jnp.isfinite(cost), cost, jnp.inf)


def _cost(rows, measure, design) -> float:
    return float(_costs(rows, measure, jnp.asarray(design)[None])[0])


def _moved(rows, measure, index: np.ndarray) -> tuple[float, np.ndarray]:
    """Return cost and points after moves of single points that lower the cost, ever smaller."""
    move, last = FIRST_MOVE, rows.shape[0] - 1
    cost = _cost(rows, measure, index)
    moves = np.concatenate([np.eye(index.size, dtype=int), -np.eye(index.size, dtype=int)])
    while move >= 1:
        trials = np.clip(index[None] + move * moves, 0, last)
        costs = np.asarray(_costs(rows, measure, jnp.asarray(trials)))
        best = int(np.argmin(costs))
        if costs[best] < cost - 1e-12 * abs(cost):
            cost, index = float(costs[best]), trials[best]
        else:
            move //= 2
    return cost, index
