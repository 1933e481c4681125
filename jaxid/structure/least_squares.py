"""Ordinary and weighted least squares, with standard errors for white residuals or for residuals of their own colour."""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.types import Float, Numbers
from ..estimation.coloured import score_covariance
from . import criteria
from .fit import Fit, fit
from .problem import Labels, Problem, prepare
from .regression import Regression


def least_squares(
    X: Float[Numbers, "time term"],
    y: Float[Numbers, " time"],
    names: Sequence[str],
    *,
    weights: Float[Numbers, " time"] | None = None,
    deviations: Float[Numbers, " time"] | None = None,
    constant: bool = True,
    response: str = "y",
) -> Regression:
    """The values that minimise `sum_i w_i (y_i - constant - X_i values)^2` (B.1, B.3), by orthogonal triangularisation.

    The level of the noise is taken from the residual, with weights too: only their ratios count. Values and standard errors are
    unbiased where the columns are free of noise and the residual is white.

    Args:
        X: columns, shape (time, term).
        y: what they shall explain, shape (time,).
        names: of the columns.
        weights: of the samples, in inverse proportion to their variance.
        deviations: standard deviation of each sample's noise, in place of weights.
        constant: fit a constant beside the columns.
        response: name of what is explained.

    Raises:
        InputError: as `prepare` says, and when a column is a combination of others.
    """
    problem = prepare(X, y, names, weights=weights, deviations=deviations, constant=constant, response=response)
    return regress(problem, range(len(problem.names)))


def regress(problem: Problem, active: Sequence[int]) -> Regression:
    """Least squares on some columns of a problem.

    Args:
        problem: from `prepare`.
        active: numbers of the columns, in the order in which the result names them.

    Raises:
        InputError: when a column is a combination of others.
    """
    found = fit(problem, active)
    values = found.inverse @ found.along / problem.scale[list(found.active)]
    spread = _spread(problem, found)
    weighted = bool(np.ptp(problem.root) > 0)
    return assemble(
        problem,
        found.active,
        values,
        spread @ spread.T * (found.SSE / found.dof),
        SSE=found.SSE,
        overall_F=criteria.overall_F(found.SSE, problem.SST, len(found.active), found.dof),
        method="weighted least squares" if weighted else "least squares",
    )


def assemble(
    problem: Problem,
    active: Sequence[int],
    values: np.ndarray,
    covariance: np.ndarray,
    *,
    SSE: float,
    overall_F: float,
    method: str,
) -> Regression:
    """A result from values and the covariance of values and, where one is fitted, of the constant after them."""
    active, terms = list(active), len(active)
    constant = problem.mean - float(problem.means[active] @ values) if problem.constant else 0.0
    within, errors = covariance[:terms, :terms], np.sqrt(np.diagonal(covariance))
    with np.errstate(divide="ignore"):
        F = (values / errors[:terms]) ** 2
    dof = problem.dof(terms)
    return Regression(
        response=problem.response,
        names=tuple(problem.names[i] for i in active),
        values=values,
        standard_errors=errors[:terms],
        covariance=within,
        F=F,
        constant=constant,
        constant_error=float(errors[terms]) if problem.constant else 0.0,
        constant_covariance=covariance[terms, :terms] if problem.constant else np.zeros(terms),
        has_constant=problem.constant,
        overall_F=overall_F,
        R2=criteria.r_squared(SSE, problem.SST),
        s=float(np.sqrt(SSE / dof)),
        residuals=problem.y - constant - problem.X[:, active] @ values,
        dof=dof,
        method=method,
    )


def with_coloured_errors(
    regression: Regression,
    X: Float[Numbers, "time term"],
    names: Sequence[str],
    *,
    weights: Float[Numbers, " time"] | None = None,
    runs: Labels | None = None,
) -> Regression:
    """The same values with standard errors for a residual of the autocorrelation that it shows.

        cov = A (Q' E[v v'] Q) A',    values = A Q' y,    Q the orthonormal basis of the columns

    Where samples are near enough in time to share what the model lacks, errors for white residuals are too small.

    Args:
        regression: by ordinary or weighted least squares.
        X: columns, shape (time, term), equally spaced in time within a run; more than those of the regression are allowed.
        names: of the columns.
        weights: as the regression had them.
        runs: label of the manoeuvre of each sample; samples of two manoeuvres do not correlate. One by default.

    Returns:
        The regression with other standard errors, covariances and F, `overall_F` as it was.

    Raises:
        InputError: when a name of the regression is not among those of the columns, or shapes do not match.

    (Morelli & Klein, Journal of Aircraft 34(6), 1997.)
    """
    require_known("column", regression.names, names)
    X = np.asarray(X, float)[:, [tuple(names).index(name) for name in regression.names]]
    y = regression.predict(X) + regression.residuals
    problem = prepare(X, y, regression.names, weights=weights, constant=regression.has_constant)
    found = fit(problem, range(len(regression.names)))
    basis = problem.Q @ found.basis
    if problem.constant:
        basis = np.column_stack([basis, problem.root / np.linalg.norm(problem.root)])
    labels = np.zeros(len(y)) if runs is None else np.asarray(runs)
    require(labels.shape == y.shape, f"There are {len(y)} samples and {labels.shape} labels of runs.")
    v = problem.root * regression.residuals
    cases = [labels == label for label in dict.fromkeys(labels.tolist())]
    score = np.asarray(score_covariance(_stack(basis, cases)[:, :, None], _stack(v, cases)[:, :, None]))
    spread = _spread(problem, found)
    covariance = spread @ score @ spread.T * (problem.samples / problem.dof(len(found.active)))
    same = assemble(problem, found.active, regression.values, covariance, SSE=found.SSE, overall_F=0.0, method="")
    changed = ("standard_errors", "covariance", "F", "constant_error", "constant_covariance")
    method = f"{regression.method}, standard errors for a coloured residual"
    return dataclasses.replace(regression, method=method, **{name: getattr(same, name) for name in changed})


def _spread(problem: Problem, found: Fit) -> np.ndarray:
    """From white noise along the orthonormal basis, and along the constant, to errors of the values and of the constant."""
    active = list(found.active)
    spread = found.inverse / problem.scale[active][:, None]
    if not problem.constant:
        return spread
    level = 1.0 / np.linalg.norm(problem.root)
    below = np.append(-problem.means[active] @ spread, level)
    return np.vstack([np.column_stack([spread, np.zeros(len(active))]), below])


def _stack(values: np.ndarray, cases: list[np.ndarray]):
    """Runs of different lengths along a leading axis, filled up with zeros."""
    longest = max(int(np.sum(case)) for case in cases)
    stacked = np.zeros((len(cases), longest, *values.shape[1:]))
    for row, case in zip(stacked, cases, strict=True):
        row[: np.sum(case)] = values[case]
    return jnp.asarray(stacked)
