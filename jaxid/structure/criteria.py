"""Criteria of a subset of terms, from sums of squares, degrees of freedom and leverages.

`SSE` is the sum of squares of the residual, and `SST` the sum of squares of the response about its
mean. `samples` is the number of samples, `terms` the number of terms without the constant, `fitted`
the number of fitted values including the constant, and `dof = samples - fitted`.
"""

import numpy as np
import scipy

from .._foundation.checks import require_level


def r_squared(SSE: float, SST: float) -> float:
    """Return the squared multiple correlation, `R^2 = 1 - SSE/SST` (B.19)."""
    return 1.0 - SSE / SST


def overall_F(SSE: float, SST: float, terms: int, dof: int) -> float:
    """Return the F of all terms together, `(R^2/terms) / ((1 - R^2)/dof)` (B.20).

    The F is NaN without a term. The report divides by `p - 1` and `m - p` with p the number of
    fitted values, which is the same.
    """
    if terms == 0:
        return float("nan")
    return float("inf") if SSE == 0 else ((SST - SSE) / terms) / (SSE / dof)


def partial_F(value: float, standard_error: float) -> float:
    """Return the F of one term given all others, `(value / standard error)^2` (B.28).

    Its distribution is F(1, dof) if the true value is zero.
    """
    return (value / standard_error) ** 2


def partial_correlation(F: float, dof: int) -> float:
    """Return the magnitude of a term's partial correlation, `sqrt(F / (F + dof))` (B.21, B.29).

    `dof` counts the degrees of freedom with the term in the model.
    """
    return 1.0 if float("inf") == F else float(np.sqrt(F / (F + dof)))


def PSE(SSE: float, samples: int, fitted: int, bound: float) -> float:
    """Return the predicted squared error, `SSE/m + 2 bound fitted/m`, for m samples.

    Args:
        SSE, samples, fitted: see the module's docstring.
        bound: upper bound of the noise variance; without a better estimate the mean square of the
            response about its mean, which favours small models.

    (Barron, Self-Organizing Methods in Modeling, 1984, chapter 4; Morelli, Journal of Aircraft
    32(2), 1995, for the bound.)
    """
    return SSE / samples + 2.0 * bound * fitted / samples


def PRESS(residuals: np.ndarray, leverages: np.ndarray) -> float:
    """Return the prediction sum of squares, `sum (v_i / (1 - h_i))^2` (Allen, 1974).

    It is the sum of squared errors of the prediction of each sample from all others, and infinite
    if these do not determine the model: a leverage is then one within rounding.
    """
    free = 1.0 - leverages
    if np.min(free) <= len(free) * np.finfo(float).eps:
        return float("inf")
    return float(np.sum((residuals / free) ** 2))


def AIC(SSE: float, samples: int, fitted: int) -> float:
    """Return Akaike's information criterion, `m log(SSE/m) + 2 fitted` (Akaike, 1974).

    A constant that is the same for all models is omitted.
    """
    return _log_error(SSE, samples) + 2.0 * fitted


def BIC(SSE: float, samples: int, fitted: int) -> float:
    """Return the Bayesian information criterion, `m log(SSE/m) + fitted log m` (Schwarz, 1978).

    A constant that is the same for all models is omitted.
    """
    return _log_error(SSE, samples) + fitted * float(np.log(samples))


def critical_F(level: float, dof: int, terms: int = 1) -> float:
    """Return the value that `F(terms, dof)` exceeds with a probability under the null hypothesis.

        level = I_z(dof/2, terms/2),    z = dof / (dof + terms F)

    Args:
        level: significance level, such as 0.01 for "99 % confidence".
        dof: degrees of freedom of the residual.
        terms: number of terms that are tested together.

    Raises:
        InputError: if the level is not between 0 and 1.
    """
    require_level(level, 0.01)
    # Imported here because the import adds a warning filter, and importing jaxid must not.
    z = float(scipy.special.betaincinv(dof / 2, terms / 2, level))
    return dof * (1.0 / z - 1.0) / terms


def _log_error(SSE: float, samples: int) -> float:
    return samples * float(np.log(SSE / samples)) if SSE > 0 else -float("inf")
