"""Gauss-Newton iteration in NumPy for the programs that have none of their own."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

# As the default of `jaxid.GaussNewton`: the full step [standard errors], the smallest step.
TOLERANCE, SMALLEST_STEP = 1e-6, 2.0**-24
MAX_STEPS = 200
# Rounding of a cost relative to its size, as in `jaxid.estimation.minimiser`.
COST_ROUNDING = 64 * np.finfo(float).eps


class Pass(NamedTuple):
    """One evaluation: simulation, sensitivities, R, normal equations.

    Attributes:
        cost: N/2 (log det R + 10), as that of `jaxid`.
        matrix: S' R^-1 S, shape (30, 30).
        gradient: S' R^-1 v, shape (30,).
    """

    cost: float
    matrix: np.ndarray
    gradient: np.ndarray


class Fitted(NamedTuple):
    """Result of a fit.

    Attributes:
        theta: estimates, shape (30,).
        errors: standard errors by the Cramer-Rao bound, shape (30,).
        cost: N/2 (log det R + 10), as that of `jaxid`.
        passes: evaluations.
        converged: True if the last full step is shorter than the tolerance.
    """

    theta: np.ndarray
    errors: np.ndarray
    cost: float
    passes: int
    converged: bool


def normal_pass(y: np.ndarray, S: np.ndarray, z: np.ndarray) -> Pass:
    """Return the pass of given outputs (time, 10) and sensitivities (time, 10, 30)."""
    v = z - y
    deviation = np.sqrt(np.mean(v**2, axis=0))
    rows = (S / deviation[:, None]).reshape(-1, S.shape[-1])
    cost = len(z) * float(np.sum(np.log(deviation) + 0.5))
    return Pass(cost, rows.T @ rows, rows.T @ (v / deviation).ravel())


def fit(evaluate: Callable[[np.ndarray], Pass], start: np.ndarray) -> Fitted:
    """Return the fit by Gauss-Newton steps that are halved while they raise the cost.

    Args:
        evaluate: the pass at given coefficients.
        start: coefficients at which the iteration starts.
    """
    theta, now, passes = np.array(start, float), evaluate(start), 1
    converged = False
    while passes < MAX_STEPS:
        step = _full_step(now)
        if np.sqrt(step @ now.gradient) < TOLERANCE:
            converged = True
            break
        size = 1.0
        while size >= SMALLEST_STEP:
            trial, passes = evaluate(theta + size * step), passes + 1
            if trial.cost <= now.cost + COST_ROUNDING * abs(now.cost):
                break
            size *= 0.5
        else:
            break
        theta, now = theta + size * step, trial
    return Fitted(theta, errors_of(now.matrix), now.cost, passes, converged)


def errors_of(matrix: np.ndarray) -> np.ndarray:
    """Return the standard errors by the Cramer-Rao bound, from a normal matrix."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    return scale * np.sqrt(np.diag(np.linalg.inv(matrix * scale[:, None] * scale)))


def _full_step(now: Pass) -> np.ndarray:
    """Return the full step, from columns scaled to unit length."""
    scale = 1.0 / np.sqrt(np.diag(now.matrix))
    return scale * np.linalg.solve(now.matrix * scale[:, None] * scale, scale * now.gradient)
