"""Regression on columns that carry noise themselves: total least squares, and instrumental variables.

Noise in a column pulls its ordinary least-squares value towards zero, however long the record (report section 3.4, point 2).
"""

from collections.abc import Sequence

import numpy as np

from .._foundation.checks import require
from .._foundation.types import Float, Numbers
from .fit import fit, require_varying
from .least_squares import assemble
from .problem import Problem, prepare
from .regression import Regression


def total_least_squares(
    X: Float[Numbers, "time term"],
    y: Float[Numbers, " time"],
    names: Sequence[str],
    *,
    noise: Sequence[float] | Float[Numbers, " term"],
    response_noise: float,
    constant: bool = True,
    response: str = "y",
) -> Regression:
    """The values for which the smallest corrections of columns and response, each in units of its noise, fit exactly.

        min sum (dX_ik / noise_k)^2 + (dy_i / response_noise)^2    with    y + dy = constant + (X + dX) values

    Columns without noise stay as they are. Only the ratios of the noise count; its level is taken from the corrections.

    Args:
        X: columns, shape (time, term).
        y: the response, shape (time,).
        names: of the columns.
        noise: standard deviation of each column's noise, independent from column to column and from sample to sample, zero for
            a column without noise [term].
        response_noise: standard deviation of the response's noise [response].
        constant: fit a constant, which is free of noise.
        response: name of what is explained.

    Returns:
        The values, with their asymptotic covariance for normal noise. `s` is the standard deviation of `y - X values`, in which
        the noise of the columns is; `overall_F` is the quadratic form of (B.18a).

    Raises:
        InputError: as `prepare` says, for noise that is negative or a response without noise, and when no corrections of least
            size exist.

    (Golub & Van Loan, SIAM J. Numer. Anal. 17, 1980; exact columns: Van Huffel & Vandewalle, The Total Least Squares Problem,
    1991, section 3.5; covariance: Fuller, Measurement Error Models, 1987, section 2.3.)
    """
    problem = prepare(X, y, names, constant=constant, response=response)
    require_varying(problem, range(len(problem.names)))
    noise = np.asarray(noise, float)
    require(
        noise.shape == (len(problem.names),) and bool(np.all(np.isfinite(noise) & (noise >= 0))),
        f"The noise is {noise.tolist()}; it has one number for each of the {len(problem.names)} columns, none negative.",
    )
    require(
        np.isfinite(response_noise) and response_noise > 0,
        f"The noise of the response is {response_noise}; it must be positive. Without noise in it, exchange it with a column.",
    )
    values = _least_corrections(problem, noise, response_noise)
    residuals = _residuals(problem, values)
    variance = float(residuals @ residuals) / problem.dof(len(values))
    unit = variance / (
        response_noise**2 + float(noise**2 @ values**2)
    )  # variance of the noise in units of what was given
    within = _fuller(problem, noise, values, unit)
    return _result(problem, values, within, variance, residuals, "total least squares")


def instrumental_variables(
    X: Float[Numbers, "time term"],
    y: Float[Numbers, " time"],
    names: Sequence[str],
    instruments: Float[Numbers, "time instrument"],
    *,
    weights: Float[Numbers, " time"] | None = None,
    constant: bool = True,
    response: str = "y",
) -> Regression:
    """The values for which the residual is uncorrelated with instruments: signals that follow the columns but not their noise.

        values = (X' P X)^-1 X' P y,    P the projection on the instruments (two-stage least squares)

    Instruments are, for example, the same terms from other sensors, from a simulation, or from samples some steps earlier
    where the noise is white. A column without noise is its own instrument and belongs among them.

    Args:
        X: columns, shape (time, term).
        y: the response, shape (time,).
        names: of the columns.
        instruments: at least as many columns as X has, shape (time, instrument).
        weights: of the samples.
        constant: fit a constant, which is its own instrument.
        response: name of what is explained.

    Raises:
        InputError: as `prepare` says, for X and for the instruments, and when the instruments do not tell the columns apart.

    (Wright, 1928; Soderstrom & Stoica, Instrumental Variable Methods for System Identification, 1983, chapter 3.)
    """
    problem = prepare(X, y, names, weights=weights, constant=constant, response=response)
    require_varying(problem, range(len(problem.names)))
    instruments = np.asarray(instruments, float)
    labels = [f"instrument {i}" for i in range(instruments.shape[1])]
    require(
        len(labels) >= len(problem.names),
        f"There are {len(labels)} instruments for {len(problem.names)} columns. Give at least as many.",
    )
    helpers = prepare(instruments, problem.y, labels, weights=weights, constant=constant, response=response)
    basis = helpers.Q @ fit(helpers, range(len(labels))).basis
    projected = basis.T @ problem.Q @ problem.T
    half, R = np.linalg.qr(projected[:, :-1])
    require(
        bool(np.min(np.abs(np.diagonal(R))) > problem.samples * np.finfo(float).eps),
        "Seen through the instruments, the columns are combinations of each other. Give instruments that follow each of them.",
    )
    inverse = np.linalg.inv(R) / problem.scale[:, None]
    values = inverse @ (half.T @ projected[:, -1])
    residuals = _residuals(problem, values)
    variance = float(residuals @ residuals) / problem.dof(len(values))
    return _result(problem, values, inverse @ inverse.T * variance, variance, residuals, "instrumental variables")


def _least_corrections(problem: Problem, noise: np.ndarray, response_noise: float) -> np.ndarray:
    """Values by the singular vector of the smallest singular value, after the exact columns are taken out."""
    order = np.argsort(noise > 0, kind="stable")
    exact = int(np.sum(noise == 0))
    scaled = problem.T[:, [*order, len(order)]]
    R = np.asarray(np.linalg.qr(scaled, mode="r"))
    # A column at length one has the noise noise/scale; the response was not scaled.
    units = np.append(noise / problem.scale, response_noise)[[*order, len(order)]]
    _, sizes, right = np.linalg.svd(R[exact:, exact:] / units[exact:])
    smallest = right[-1]
    require(
        bool(abs(smallest[-1]) > 1e-12) and (len(sizes) < 2 or bool(sizes[-1] < sizes[-2])),
        f"No least corrections of the columns explain {problem.response!r}: columns are combinations of each other within their "
        "noise. Leave one out.",
    )
    noisy = -smallest[:-1] / units[exact:-1] / (smallest[-1] / response_noise)
    first = np.linalg.solve(R[:exact, :exact], R[:exact, -1] - R[:exact, exact:-1] @ noisy)
    values = np.empty(len(order))
    values[order] = np.append(first, noisy)
    return values / problem.scale


def _fuller(problem: Problem, noise: np.ndarray, values: np.ndarray, unit: float) -> np.ndarray:
    """Asymptotic covariance of the values, `(M^-1 s + M^-1 (U s - c c') M^-1) / m`, with M the columns' moments without noise, U
    the noise of the columns, s the variance of `e = y - X values`, and c the covariance of the columns with e."""
    U = np.diag(noise**2 * unit)
    triangle = problem.T[:, :-1] * problem.scale
    inverse = np.linalg.inv(triangle.T @ triangle / problem.samples - U)
    c = -U @ values
    residuals = _residuals(problem, values)
    s = float(residuals @ residuals) / problem.dof(len(values))
    return (inverse * s + inverse @ (U * s - np.outer(c, c)) @ inverse) / problem.samples


def _residuals(problem: Problem, values: np.ndarray) -> np.ndarray:
    """Of the centred, weighted regression, in the coordinates of the triangle."""
    return problem.T[:, -1] - problem.T[:, :-1] @ (problem.scale * values)


def _result(problem: Problem, values, within, variance: float, residuals, method: str) -> Regression:
    """With the constant's own error: of the mean of the residual, and of the values through the means of the columns."""
    count, overall = len(values), float(values @ np.linalg.solve(within, values)) / len(values)
    if problem.constant:
        of_mean = variance / float(np.sum(problem.root**2))
        down = np.vstack([np.eye(count), -problem.means])
        within = down @ within @ down.T
        within[-1, -1] += of_mean
    SSE = float(residuals @ residuals)
    return assemble(problem, range(count), values, within, SSE=SSE, overall_F=overall, method=method)
