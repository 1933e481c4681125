"""Experiment points: at which trims to fly, and for how long (C.4.2.2 of the report)."""

import itertools
from collections.abc import Callable, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import require, require_float64
from ..._foundation.types import Array, Float, Int, Numbers
from ..exchange import NEGLIGIBLE, Experiments, allocate
from ..measures import AbstractMeasure

Basis = Callable[[Array], Array]

# Two points of a design between which every candidate is as useful as the design, but for this
# share, are one point between them. A point with a smaller share of the effort is left out (both
# chosen). The certificate is computed afterwards.
FLAT, SMALLEST_SHARE = 1e-3, 2e-3
# Number of starts of a design of limited size that are improved by moves of points, limit of these
# moves, and the smallest step relative to the one to the nearest peak (chosen).
SUBSETS, MOVES, SMALLEST_MOVE = 2, 50, 0.1


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
    index = _joined(result.weights, result.gains, candidate.position)
    experiments = Experiments.of(candidate.rows, measure)
    shares = experiments.weights(index)
    return _design(candidate, experiments, index[shares > SMALLEST_SHARE], total)


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
    experiments = Experiments.of(candidate.rows, measure)
    index = np.searchsorted(np.asarray(candidate.points), np.asarray(optimum.points))
    starts = [np.array(subset) for subset in itertools.combinations(index, count)]
    starts.sort(key=lambda start: experiments.cost(start, experiments.weights(start)))
    best = [_moved(experiments, start) for start in starts[:SUBSETS]]
    _, chosen = min(best, key=lambda pair: pair[0])
    return _design(candidate, experiments, chosen, total)


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


def _design(candidate, experiments: Experiments, index, total) -> ExperimentPoints:
    """Return a design with its best weights and its certificate over all candidates."""
    index = np.sort(index)
    shares = experiments.weights(index)
    return ExperimentPoints(
        candidate.points[index],
        jnp.asarray(shares),
        jnp.asarray(shares) * total / candidate.cost[index],
        experiments.cost(index, shares),
        experiments.certificate(index, shares),
    )


def _moved(experiments: Experiments, index: np.ndarray) -> tuple[float, np.ndarray]:
    """Return cost and points of a locally optimal design with the same number of points.

    The derivative of the cost by the place of a point is minus its weight times that of its
    usefulness. Each point therefore moves towards the nearest peak of the usefulness, all by one
    share of their distance that lowers the cost.
    """
    weight = experiments.weights(index)
    cost = experiments.cost(index, weight)
    for _ in range(MOVES):
        phi = experiments.gains(index, weight)
        distance = np.array([_peak(phi, int(at)) for at in index]) - index
        share, lower = 1.0, False
        while not lower and share > SMALLEST_MOVE:
            trial = index + np.round(share * distance).astype(int)
            trial_weight = experiments.weights(trial, weight)
            trial_cost = experiments.cost(trial, trial_weight)
            lower = trial_cost < cost * (1.0 - 1e-12 * np.sign(cost))
            share *= 0.5
        if not lower:
            break
        index, weight, cost = trial, trial_weight, trial_cost
    return cost, index


def _peak(phi: np.ndarray, at: int) -> int:
    """Return the candidate that is reached from one candidate by climbing to better neighbours."""
    while True:
        around = np.arange(max(at - 1, 0), min(at + 2, phi.size))
        best = int(around[np.argmax(phi[around])])
        if phi[best] <= phi[at]:
            return at
        at = best
