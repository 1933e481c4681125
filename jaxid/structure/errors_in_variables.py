"""Regression on columns with noise: total least squares, and instrumental variables.

Noise in a column biases its ordinary least-squares value towards zero, however long the record
(report section 3.4, point 2).
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
    """Return the total least squares regression.

        min sum (dX_ik / noise_k)^2 + (dy_i / response_noise)^2
        with y + dy = constant + (X + dX) values

    The corrections dX and dy, each in units of its noise, are the smallest with an exact fit.
    Columns without noise are not corrected. Only the ratios of the noise levels matter; the common
    level is estimated from the corrections.

    Args:
        X: columns, shape (time, term).
        y: the response, shape (time,).
        names: names of the columns.
        noise: standard deviation of each column's noise, independent from column to column and from
            sample to sample, zero for a column without noise [term].
        response_noise: standard deviation of the response's noise [response].
        constant: fit a constant, which is free of noise.
        response: name of the response.

    Returns:
        The values, with their asymptotic covariance for normal noise. `s` is the standard deviation
        of `y - X values`, which includes the noise of the columns; `overall_F` is the quadratic
        form of (B.18a).

    Raises:
        InputError: see `prepare`; for negative noise, for a response without noise, and if no
            least corrections exist.

    (Golub & Van Loan, SIAM J. Numer. Anal. 17, 1980; exact columns: Van Huffel & Vandewalle, The
    Total Least Squares Problem, 1991, section 3.5; covariance: Fuller, Measurement Error Models,
    1987, section 2.3.)
    """
    problem = prepare(X, y, names, constant=constant, response=response)
    require_varying(problem, range(len(problem.names)))
    noise = np.asarray(noise, float)
    require(
        noise.shape == (len(problem.names),) and bool(np.all(np.isfinite(noise) & (noise >= 0))),
        f"The noise is {noise.tolist()}. Give one number for each of the {len(problem.names)} "
        "columns, none negative.",
    )
    require(
        np.isfinite(response_noise) and response_noise > 0,
        f"The noise of the response is {response_noise}; it must be positive. If the response has "
        "no noise, exchange it with a column.",
    )
    values = _least_corrections(problem, noise, response_noise)
    residuals = _residuals(problem, values)
    variance = float(residuals @ residuals) / problem.dof(len(values))
    # estimated variance of the noise relative to the given variance
    ratio = variance / (response_noise**2 + float(noise**2 @ values**2))
    covariance = _fuller(problem, noise, values, ratio)
    return _result(problem, values, covariance, variance, residuals, "total least squares")


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
    """Return the instrumental-variables regression (two-stage least squares).

        values = (X' P X)^-1 X' P y,    P the projection on the instruments

    The residual is uncorrelated with the instruments: signals that are correlated with the columns
    but not with their noise. Examples are the same terms from other sensors, from a simulation, or,
    for white noise, from samples some steps earlier. A column without noise is its own instrument
    and must be one of them.

    Args:
        X: columns, shape (time, term).
        y: the response, shape (time,).
        names: names of the columns.
        instruments: shape (time, instrument), with at least as many columns as X.
        weights: weights of the samples.
        constant: fit a constant, which is its own instrument.
        response: name of the response.

    Raises:
        InputError: see `prepare`, for X and for the instruments; and if the projections of the
            columns on the instruments are linearly dependent.

    (Wright, 1928; Soderstrom & Stoica, Instrumental Variable Methods for System Identification,
    1983, chapter 3.)
    """
    problem = prepare(X, y, names, weights=weights, constant=constant, response=response)
    require_varying(problem, range(len(problem.names)))
    instruments = np.asarray(instruments, float)
    labels = [f"instrument {i}" for i in range(instruments.shape[1])]
    require(
        len(labels) >= len(problem.names),
        f"There are {len(labels)} instruments for {len(problem.names)} columns. Give at least as "
        "many instruments as columns.",
    )
    stage_one = prepare(
        instruments, problem.y, labels, weights=weights, constant=constant, response=response
    )
    basis = stage_one.Q @ fit(stage_one, range(len(labels))).basis
    projected = basis.T @ problem.Q @ problem.T
    half, R = np.linalg.qr(projected[:, :-1])
    require(
        bool(np.min(np.abs(np.diagonal(R))) > problem.samples * np.finfo(float).eps),
        "The projections of the columns on the instruments are linearly dependent. Give "
        "instruments that are correlated with each column.",
    )
    inverse = np.linalg.inv(R) / problem.scale[:, None]
    values = inverse @ (half.T @ projected[:, -1])
    residuals = _residuals(problem, values)
    variance = float(residuals @ residuals) / problem.dof(len(values))
    return _result(
        problem,
        values,
        inverse @ inverse.T * variance,
        variance,
        residuals,
        "instrumental variables",
    )


def _least_corrections(problem: Problem, noise: np.ndarray, response_noise: float) -> np.ndarray:
    """Return the values from the singular vector of the smallest singular value.

    The columns without noise are eliminated first.
    """
    order = np.argsort(noise > 0, kind="stable")
    exact = int(np.sum(noise == 0))
    scaled = problem.T[:, [*order, len(order)]]
    R = np.asarray(np.linalg.qr(scaled, mode="r"))
    # Columns are scaled to length one, so their noise is divided by the scale; the response is not.
    units = np.append(noise / problem.scale, response_noise)[[*order, len(order)]]
    _, sizes, right = np.linalg.svd(R[exact:, exact:] / units[exact:])
    smallest = right[-1]
    require(
        bool(abs(smallest[-1]) > 1e-12) and (len(sizes) < 2 or bool(sizes[-1] < sizes[-2])),
        f"No least corrections of the columns explain {problem.response!r}: within their noise the "
        "columns are linearly dependent. Leave one out.",
    )
    noisy = -smallest[:-1] / units[exact:-1] / (smallest[-1] / response_noise)
    first = np.linalg.solve(R[:exact, :exact], R[:exact, -1] - R[:exact, exact:-1] @ noisy)
    values = np.empty(len(order))
    values[order] = np.append(first, noisy)
    return values / problem.scale


def _fuller(problem: Problem, noise: np.ndarray, values: np.ndarray, ratio: float) -> np.ndarray:
    """Return the asymptotic covariance of the values.

        (M^-1 s + M^-1 (U s - c c') M^-1) / m

    M are the columns' moments without noise, U the covariance of the columns' noise, s the variance
    of `e = y - X values`, c the covariance of the columns with e, and m the number of samples.
    `ratio` is the variance of the noise relative to the given variance.
    """
    U = np.diag(noise**2 * ratio)
    triangle = problem.T[:, :-1] * problem.scale
    inverse = np.linalg.inv(triangle.T @ triangle / problem.samples - U)
    c = -U @ values
    residuals = _residuals(problem, values)
    s = float(residuals @ residuals) / problem.dof(len(values))
    return (inverse * s + inverse @ (U * s - np.outer(c, c)) @ inverse) / problem.samples


def _residuals(problem: Problem, values: np.ndarray) -> np.ndarray:
    """Return the residuals of the centred, weighted regression, in the triangle's coordinates."""
    return problem.T[:, -1] - problem.T[:, :-1] @ (problem.scale * values)


def _result(
    problem: Problem, values, covariance, variance: float, residuals, method: str
) -> Regression:
    """Return the regression, with the variance of the constant.

    That variance is the sum of two parts: the variance of the residual's mean, and the variance of
    the values propagated through the means of the columns.
    """
    count, overall = len(values), float(values @ np.linalg.solve(covariance, values)) / len(values)
    if problem.constant:
        mean_variance = variance / float(np.sum(problem.root**2))
        propagation = np.vstack([np.eye(count), -problem.means])
        covariance = propagation @ covariance @ propagation.T
        covariance[-1, -1] += mean_variance
    SSE = float(residuals @ residuals)
    return assemble(
        problem, range(count), values, covariance, SSE=SSE, overall_F=overall, method=method
    )
