"""Ordinary and weighted least squares, with standard errors for white or coloured residuals."""

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
    """Return the values that minimise `sum_i w_i (y_i - constant - X_i values)^2` (B.1, B.3).

    The problem is solved by orthogonal triangularisation. The noise level is estimated from the
    residual, also with weights: only their ratios matter. Values and standard errors are unbiased
    if the columns are free of noise and the residual is white.

    Args:
        X: columns, shape (time, term).
        y: the response, shape (time,).
        names: names of the columns.
        weights: weights of the samples, inversely proportional to their variance.
        deviations: standard deviation of each sample's noise, in place of weights.
        constant: fit a constant in addition to the columns.
        response: name of the response.

    Raises:
        InputError: see `prepare`; and if a column is a linear combination of others.
    """
    problem = prepare(
        X, y, names, weights=weights, deviations=deviations, constant=constant, response=response
    )
    return regress(problem, range(len(problem.names)))


def regress(problem: Problem, active: Sequence[int]) -> Regression:
    """Return the least-squares regression on some columns of a problem.

    Args:
        problem: result of `prepare`.
        active: numbers of the columns, in the order of the result's names.

    Raises:
        InputError: if a column is a linear combination of others.
    """
    fitted = fit(problem, active)
    values = fitted.inverse @ fitted.coordinates / problem.scale[list(fitted.active)]
    transform = _error_transform(problem, fitted)
    weighted = bool(np.ptp(problem.root) > 0)
    return assemble(
        problem,
        fitted.active,
        values,
        transform @ transform.T * (fitted.SSE / fitted.dof),
        SSE=fitted.SSE,
        overall_F=criteria.overall_F(fitted.SSE, problem.SST, len(fitted.active), fitted.dof),
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
    """Return a regression from values and their covariance.

    If a constant is fitted, the last row and column of the covariance belong to it.
    """
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
    """Return the regression with standard errors for a coloured residual.

        cov = A (Q' E[v v'] Q) A',    values = A Q' y,    Q the orthonormal basis of the columns

    The autocorrelation is estimated from the residual v. If neighbouring samples share a modelling
    error, standard errors for white residuals are too small.

    Args:
        regression: result of ordinary or weighted least squares.
        X: columns, shape (time, term), equally spaced in time within a manoeuvre; columns that are
            not in the regression are ignored.
        names: names of the columns.
        weights: weights of the regression.
        runs: label of the manoeuvre of each sample; samples of different manoeuvres are
            uncorrelated. One manoeuvre by default.

    Returns:
        The regression with new standard errors, covariances and F, and the same `overall_F`.

    Raises:
        InputError: if a name of the regression is not among the columns, or shapes do not match.

    (Morelli & Klein, Journal of Aircraft 34(6), 1997.)
    """
    require_known("column", regression.names, names)
    X = np.asarray(X, float)[:, [tuple(names).index(name) for name in regression.names]]
    y = regression.predict(X) + regression.residuals
    problem = prepare(X, y, regression.names, weights=weights, constant=regression.has_constant)
    fitted = fit(problem, range(len(regression.names)))
    basis = problem.Q @ fitted.basis
    if problem.constant:
        basis = np.column_stack([basis, problem.root / np.linalg.norm(problem.root)])
    labels = np.zeros(len(y)) if runs is None else np.asarray(runs)
    require(
        labels.shape == y.shape,
        f"There are {len(y)} samples, and the labels of runs have shape {labels.shape}. Give one "
        "label for each sample.",
    )
    v = problem.root * regression.residuals
    cases = [labels == label for label in dict.fromkeys(labels.tolist())]
    # Samples of weight zero and the padding of shorter runs count as missing.
    valid = _stack(problem.root > 0, cases) > 0
    score = score_covariance(
        _stack(basis, cases)[:, :, None], _stack(v, cases)[:, :, None], valid[:, :, None]
    )
    transform = _error_transform(problem, fitted)
    covariance = (
        transform
        @ np.asarray(score)
        @ transform.T
        * (problem.samples / problem.dof(len(fitted.active)))
    )
    coloured = assemble(
        problem,
        fitted.active,
        regression.values,
        covariance,
        SSE=fitted.SSE,
        overall_F=0.0,
        method="",
    )
    changed = ("standard_errors", "covariance", "F", "constant_error", "constant_covariance")
    method = f"{regression.method}, standard errors for a coloured residual"
    return dataclasses.replace(
        regression, method=method, **{name: getattr(coloured, name) for name in changed}
    )


def _error_transform(problem: Problem, fitted: Fit) -> np.ndarray:
    """Return the matrix that maps noise to errors of the values and of the constant.

    The noise is given in the orthonormal basis, and along the constant if there is one.
    """
    active = list(fitted.active)
    transform = fitted.inverse / problem.scale[active][:, None]
    if not problem.constant:
        return transform
    level = 1.0 / np.linalg.norm(problem.root)
    last_row = np.append(-problem.means[active] @ transform, level)
    return np.vstack([np.column_stack([transform, np.zeros(len(active))]), last_row])


def _stack(values: np.ndarray, cases: list[np.ndarray]):
    """Return runs of different lengths along a leading axis, padded with zeros."""
    longest = max(int(np.sum(case)) for case in cases)
    stacked = np.zeros((len(cases), longest, *values.shape[1:]))
    for row, case in zip(stacked, cases, strict=True):
        row[: np.sum(case)] = values[case]
    return jnp.asarray(stacked)
