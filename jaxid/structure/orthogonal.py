"""Multivariate orthogonal functions: orthogonalised candidates, truncated at the least PSE."""

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
    """Candidates in the order of orthogonalisation, and the selected model.

    Each function is a column minus its projection on the columns before it, so that its share of
    the response does not depend on the number of functions after it.

    Attributes:
        names: names of the candidates, in that order.
        share: share of the response's sum of squares that each function explains.
        PSE: predicted squared error with the first n functions, n = 0, 1, ..., shape (function +
            1,).
        kept: number of functions at the least PSE.
        left_out: candidates that are nearly linear combinations of candidates before them.
        regression: the selected model in ordinary terms, by least squares on the kept candidates.
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
        for k, (name, share, PSE) in enumerate(
            zip(self.names, self.share, self.PSE[1:], strict=True)
        ):
            lines.append(
                f"{name:<{width}} {share:>11.3g} {PSE:>11.4g}{'  kept' if k < self.kept else ''}"
            )
        left_out = (
            f"\nleft out, nearly combinations: {', '.join(self.left_out)}" if self.left_out else ""
        )
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
    """Return the orthogonal functions of the candidates and the model with the least PSE.

        p_j = x_j - sum_(k<j) p_k (p_k' x_j) / (p_k' p_k),    a_j = p_j' y / (p_j' p_j)
        SSE decreases by a_j^2 p_j' p_j

    The candidates are ordered by Gram-Schmidt orthogonalisation: the next column is the one that,
    orthogonal to the columns before it, lowers the sum of squares most, as in forward stepwise
    regression. The model ends at the minimum of PSE, which first decreases and then increases, and
    not at a level of F. Finally the model is written in ordinary terms.

    Args:
        X: candidates, shape (time, term).
        y: the response, shape (time,).
        names: names of the candidates.
        PSE_bound: upper bound of the noise variance [response^2]; mean square of the response about
            its mean by default.
        tolerance: least share of a column that the columns before it leave unexplained.
        weights: weights of the samples.
        constant: fit a constant; it is the first orthogonal function and always kept.
        response: name of the response.

    Raises:
        InputError: see `prepare`.

    (Morelli, Journal of Aircraft 32(2), 1995; Klein & Morelli, Aircraft System Identification,
    2006, section 5.4.)
    """
    problem = prepare(X, y, names, weights=weights, constant=constant, response=response)
    order, reduction = _gram_schmidt(problem, tolerance)
    samples, SST = problem.samples, problem.SST
    bound = SST / samples if PSE_bound is None else PSE_bound
    sums = np.maximum(SST - np.append(0.0, np.cumsum(reduction)), 0.0)
    PSE = np.array(
        [criteria.PSE(SSE, samples, n + problem.constant, bound) for n, SSE in enumerate(sums)]
    )
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
    """Return the order of the columns, and the reduction of the sum of squares by each.

    All columns are kept orthogonal to the columns already chosen.
    """
    columns, residual = problem.T[:, :-1].copy(), problem.T[:, -1].copy()
    order: list[int] = []
    reductions: list[float] = []
    while True:
        size = np.sum(columns**2, axis=0)
        admitted = [i for i in range(len(problem.names)) if i not in order and size[i] >= tolerance]
        if not admitted or float(residual @ residual) <= problem.rounding:
            return order, reductions
        gain = (residual @ columns[:, admitted]) ** 2 / size[admitted]
        best = admitted[int(np.argmax(gain))]
        order.append(best)
        reductions.append(float(np.max(gain)))
        unit = columns[:, best] / np.sqrt(size[best])
        for _ in range(2):  # the second projection removes rounding errors
            columns -= np.outer(unit, unit @ columns)
            residual -= unit * (unit @ residual)
