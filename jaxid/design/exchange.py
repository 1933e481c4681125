"""Optimal allocation of an effort to candidate experiments, by the exchange algorithm.

Each candidate adds `weight * rows' rows` to the information. A convex measure has its minimum where
no candidate is worth more than the design in the mean (Kiefer & Wolfowitz; Theorem C.1 of the
report), which gives the certificate

    max_i phi_i / sum_j w_j phi_j        (at least 1, and 1 at the optimum)

A step adds the candidates that are worth more than the design and more than their neighbours, and
determines the weights of all its points, by sequential quadratic programming; points without
weight leave (steps (b) to (d) of C.4.2.2 and C.2.1, with all weights at their best in each step).

Sources: V. V. Fedorov, Theory of Optimal Experiments, Academic Press, 1972, for the exchange;
C. L. Atwood, Sequences converging to D-optimal designs of experiments, Annals of Statistics 1,
1973, for the weights.
"""

import equinox as eqx
import numpy as np
import scipy

from .._foundation.checks import require
from .._foundation.types import Float, Numbers
from .measures import AbstractMeasure

# Limit of the iterations that determine the weights of a design (chosen).
WEIGHT_ITERATIONS = 200
NEGLIGIBLE = 1e-7  # a weight below it is no point of a design (chosen)


class Allocation(eqx.Module):
    """Weights of candidates with the certificate of their optimality.

    Attributes:
        weights: share of the effort of each candidate; their sum is one.
        gains: usefulness phi of each candidate at this design.
        cost: value of the measure.
        certificate: largest usefulness over the mean of the design, 1 at the optimum. A trace or
            combination is within this factor of its optimum.
        steps: number of exchanges.
    """

    weights: Float[np.ndarray, " candidate"]
    gains: Float[np.ndarray, " candidate"]
    cost: float = eqx.field(static=True)
    certificate: float = eqx.field(static=True)
    steps: int = eqx.field(static=True)


class Experiments(eqx.Module):
    """Candidate experiments on the host, with the information that is there already.

    Attributes:
        rows: whitened sensitivities of each candidate for the whole effort.
        measure: the measure to be minimised.
        earlier: factor of earlier information.
    """

    rows: Float[np.ndarray, "candidate sample parameter"]
    measure: AbstractMeasure
    earlier: Float[np.ndarray, "earlier_row parameter"]

    @classmethod
    def of(cls, rows, measure: AbstractMeasure, earlier=None) -> "Experiments":
        """Return the experiments as NumPy arrays, with no earlier information by default."""
        rows = np.asarray(rows, float)
        width = rows.shape[-1]
        return cls(rows, measure, np.zeros((0, width)) if earlier is None else np.array(earlier))

    def factor(self, index: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Return a factor of the information of a design."""
        own = np.sqrt(weight)[:, None, None] * self.rows[index]
        return np.concatenate([own.reshape(-1, own.shape[-1]), self.earlier])

    def cost(self, index: np.ndarray, weight: np.ndarray) -> float:
        """Return the cost of a design, infinite where it does not determine the parameters."""
        value = float(self.measure.cost(self.factor(index, weight)))
        return value if np.isfinite(value) else np.inf

    def gains(self, index: np.ndarray, weight: np.ndarray, of: np.ndarray | None = None):
        """Return the usefulness of all candidates, or of some of them, at a design."""
        rows = self.rows if of is None else self.rows[of]
        return np.asarray(self.measure.gain(self.factor(index, weight), rows))

    def weights(self, index: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
        """Return the best weights of given points, by sequential quadratic programming.

        Args:
            index: the points.
            start: weights to begin with; equal ones by default.
        """
        equal = np.full(index.size, 1.0 / index.size)
        start = equal if start is None else start
        phi = self.gains(index, start, index)
        scale = np.sum(start * phi)
        result = scipy.optimize.minimize(
            lambda weight: self.cost(index, np.maximum(weight, 0.0)) / scale,
            start,
            jac=lambda weight: -self.gains(index, np.maximum(weight, 0.0), index) / scale,
            bounds=[(0.0, 1.0)] * index.size,
            constraints={
                "type": "eq",
                "fun": lambda weight: np.sum(weight) - 1.0,
                "jac": lambda weight: np.ones((1, weight.size)),
            },
            method="SLSQP",
            options={"maxiter": WEIGHT_ITERATIONS, "ftol": 1e-10},
        )
        weight = np.maximum(result.x, 0.0)
        weight = weight / np.sum(weight)
        return weight if self.cost(index, weight) < self.cost(index, start) else start

    def certificate(self, index: np.ndarray, weight: np.ndarray) -> float:
        """Return the largest usefulness of a candidate over the mean of the design."""
        phi = self.gains(index, weight)
        return float(np.max(phi) / np.sum(weight * phi[index]))


def allocate(
    rows: Float[Numbers, "candidate sample parameter"],
    measure: AbstractMeasure,
    *,
    earlier: Float[Numbers, "earlier_row parameter"] | None = None,
    tolerance: float = 1e-4,
    max_steps: int = 100,
) -> Allocation:
    """Return the optimal weights of candidate experiments.

    Args:
        rows: whitened sensitivities of each candidate for the whole effort.
        measure: the measure to be minimised.
        earlier: factor of information that is there already; none by default.
        tolerance: the exchange stops at a certificate below `1 + tolerance`.
        max_steps: limit of the number of exchanges.

    Raises:
        InputError: when all candidates together do not determine the parameters.
    """
    experiments = Experiments.of(rows, measure, earlier)
    _check_rank(experiments)
    candidate_count = experiments.rows.shape[0]
    index = _start(experiments)
    weight = experiments.weights(index)
    for steps in range(max_steps + 1):  # noqa: B007
        phi = experiments.gains(index, weight)
        mean = np.sum(weight * phi[index])
        certificate = float(np.max(phi) / mean)
        if certificate <= 1.0 + tolerance:
            break
        added = np.setdiff1d(_peaks(phi, mean), index)
        if not added.size:
            break
        # New points begin with a tenth of the weight (chosen).
        new = np.full(added.size, 0.1 / added.size)
        start = np.concatenate([0.9 * weight, new])
        index = np.concatenate([index, added])
        weight = experiments.weights(index, start)
        index, weight = index[weight > NEGLIGIBLE], weight[weight > NEGLIGIBLE]
        weight = weight / np.sum(weight)
    weights = np.zeros(candidate_count)
    weights[index] = weight
    return Allocation(weights, phi, experiments.cost(index, weight), certificate, steps)


def _start(experiments: Experiments) -> np.ndarray:
    """Return equally spaced candidates that determine the parameters."""
    candidate_count, _, width = experiments.rows.shape
    count = width + 1
    while True:
        index = np.unique(np.linspace(0, candidate_count - 1, count).round().astype(int))
        determined = np.isfinite(experiments.cost(index, np.full(index.size, 1.0 / index.size)))
        if determined or index.size == candidate_count:
            return index
        count = 2 * count


def _peaks(phi: np.ndarray, mean: float) -> np.ndarray:
    """Return the candidates worth more than the mean, and not less than their neighbours."""
    padded = np.concatenate([[-np.inf], phi, [-np.inf]])
    peak = (phi >= padded[:-2]) & (phi >= padded[2:])
    return np.flatnonzero(peak & (phi > mean))


def _check_rank(experiments: Experiments) -> None:
    width = experiments.rows.shape[-1]
    every = np.concatenate([experiments.rows.reshape(-1, width), experiments.earlier])
    scale = np.linalg.norm(every, axis=0)
    scaled = every / np.where(scale > 0, scale, 1.0)
    strength = np.linalg.svd(scaled, compute_uv=False)
    require(
        strength.size == width and bool(strength[-1] > 1e-12 * strength[0]),
        "The candidates together do not determine all parameters. Add candidates, fix a "
        "parameter, or give earlier information.",
    )
