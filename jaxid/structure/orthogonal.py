"""Multivariate orthogonal functions: candidates made orthogonal one by one, as many kept as the predicted error asks for."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._foundation.types import Float, Numbers
from . import criteria
from .least_squares import regress
from .problem import Problem, prepare
from .regression import Regression


@dataclass(frozen=True, eq=False)
class OrthogonalFunctions:
    """Candidates in the order in which they were made orthogonal, and the model that was kept.

    Each function is a column less its projection on those before it, so that what it explains does not depend on how many
    follow.

    Attributes:
        names: in that order.
        share: of the response's sum of squares that each explains.
        PSE: predicted squared error with the first n functions, n = 0, 1, ..., shape (function + 1,).
        kept: how many make it least.
        left_out: candidates that are nearly combinations of those before them.
        regression: the kept functions written in ordinary terms, which is least squares on them.
    """

    names: tuple[str, ...]
    share: np.ndarray
    PSE: np.ndarray
    kept: int
    left_out: tuple[str, ...]
    regression: Regression

    def __str__(self) -> str:
        width = max(map(len, (*self.names, "function")))
        lines = [
            f"{'function':<{width}} {'share':>11} {'PSE':>11}",
            f"{'(none)':<{width}} {'':>11} {self.PSE[0]:>11.4g}",
        ]
        for k, (name, share, PSE) in enumerate(zip(self.names, self.share, self.PSE[1:], strict=True)):
            lines.append(f"{name:<{width}} {share:>11.3g} {PSE:>11.4g}{'  kept' if k < self.kept else ''}")
        left_out = f"\nleft out, nearly combinations: {', '.join(self.left_out)}" if self.left_out else ""
        return "\n".join(lines) + left_out + f"\n{self.regression}"


def orthogonal_functions(
    X: Float[Numbers, "time term"],
    y: Float[Numbers, " time"],
    names: Sequence[str],
    *,
    PSE_bound: float | None = None,
    tolerance: float = 1e-8,
    weights: Float[Numbers, " time"] | None = None,
    constant: bool = True,
    response: str = "y",
) -> OrthogonalFunctions:
    """Order the candidates by Gram-Schmidt, keep as many as make PSE least, and go back to ordinary terms.

        p_j = x_j - sum_(k<j) p_k (p_k' x_j) / (p_k' p_k),    a_j = p_j' y / (p_j' p_j),    SSE falls by a_j^2 p_j' p_j

    The next column is the one that lowers the sum of squares most when it is made orthogonal to those before, as in forward
    stepwise regression; it is not the level of an F that ends the model but PSE, which falls and rises once.

    Args:
        X: candidates, shape (time, term).
        y: the response, shape (time,).
        names: of the candidates.
        PSE_bound: largest variance of the noise; mean square of the response about its mean by default [response^2].
        tolerance: least share of a column that those before it leave unexplained.
        weights: of the samples.
        constant: fit a constant; it is the first orthogonal function and always kept.
        response: name of what is explained.

    Raises:
        InputError: as `prepare` says.

    (Morelli, Journal of Aircraft 32(2), 1995; Klein & Morelli, Aircraft System Identification, 2006, section 5.4.)
    """
    problem = prepare(X, y, names, weights=weights, constant=constant, response=response)
    order, reduction = _gram_schmidt(problem, tolerance)
    samples, SST = problem.samples, problem.SST
    bound = SST / samples if PSE_bound is None else PSE_bound
    left = np.maximum(SST - np.append(0.0, np.cumsum(reduction)), 0.0)
    PSE = np.array([criteria.PSE(SSE, samples, n + problem.constant, bound) for n, SSE in enumerate(left)])
    kept = int(np.argmin(PSE))
    return OrthogonalFunctions(
        names=tuple(problem.names[i] for i in order),
        share=np.array(reduction) / SST,
        PSE=PSE,
        kept=kept,
        left_out=tuple(name for i, name in enumerate(problem.names) if i not in order),
        regression=regress(problem, order[:kept]),
    )


def _gram_schmidt(problem: Problem, tolerance: float) -> tuple[list[int], list[float]]:
    """Order of the columns, and by how much each lowers the sum of squares; all columns are kept orthogonal to those chosen."""
    own, rest = problem.T[:, :-1].copy(), problem.T[:, -1].copy()
    order: list[int] = []
    reductions: list[float] = []
    while True:
        size = np.sum(own**2, axis=0)
        open_ = [i for i in range(len(problem.names)) if i not in order and size[i] >= tolerance]
        if not open_ or float(rest @ rest) <= problem.rounding:
            return order, reductions
        gain = (rest @ own[:, open_]) ** 2 / size[open_]
        best = open_[int(np.argmax(gain))]
        order.append(best)
        reductions.append(float(np.max(gain)))
        unit = own[:, best] / np.sqrt(size[best])
        for _ in range(2):  # once more, for what rounding leaves
            own -= np.outer(unit, unit @ own)
            rest -= unit * (unit @ rest)
