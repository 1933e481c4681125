"""What a subset of terms is judged by: short formulas of sums of squares, degrees of freedom and leverages.

`SSE` is the sum of squares of the residual, `SST` that of the response about its mean; `samples` counts the samples, `terms`
the terms without the constant, `fitted` all that is fitted, the constant included, and `dof = samples - fitted`.
"""

import numpy as np

from .._foundation.checks import require


def r_squared(SSE: float, SST: float) -> float:
    """Square of the multiple correlation, `R^2 = 1 - SSE/SST` (B.19): the share of the response that is explained."""
    return 1.0 - SSE / SST


def overall_F(SSE: float, SST: float, terms: int, dof: int) -> float:
    """F of the whole equation, `(R^2/terms) / ((1 - R^2)/dof)` (B.20); NaN without a term.

    The report divides by `p - 1` and `m - p` with p the number of all that is fitted: the same.
    """
    if terms == 0:
        return float("nan")
    return float("inf") if SSE == 0 else ((SST - SSE) / terms) / (SSE / dof)


def partial_F(value: float, standard_error: float) -> float:
    """F of one term when all others are in, `(value / standard error)^2` (B.28): F(1, dof) where the true value is zero."""
    return (value / standard_error) ** 2


def partial_F_of_correlation(correlation: float, dof: int) -> float:
    """F to enter of a term, `r^2 dof / (1 - r^2)` (B.30), with r its partial correlation.

    `dof` is what remains when the term is in. The report's `m - q` is one more than that; the difference is corrected here.
    """
    return correlation**2 * dof / (1.0 - correlation**2)


def partial_correlation(F: float, dof: int) -> float:
    """Size of the partial correlation of a term from its F, `sqrt(F / (F + dof))` (B.21, B.29), `dof` with the term in."""
    return 1.0 if float("inf") == F else float(np.sqrt(F / (F + dof)))


def PSE(SSE: float, samples: int, fitted: int, bound: float) -> float:
    """Predicted squared error, `SSE/m + 2 bound fitted/m`, m samples.

    Args:
        SSE, samples, fitted: as above.
        bound: the largest variance that the noise may have; mean square of the response about its mean where nothing better is
            known, which keeps models small.

    (Barron, Self-Organizing Methods in Modeling, 1984, chapter 4; Morelli, Journal of Aircraft 32(2), 1995, for the bound.)
    """
    return SSE / samples + 2.0 * bound * fitted / samples


def PRESS(residuals: np.ndarray, leverages: np.ndarray) -> float:
    """Sum of squares of the errors of predicting each sample from all others, `sum (v_i / (1 - h_i))^2` (Allen, 1974)."""
    with np.errstate(divide="ignore"):
        return float(np.sum((residuals / (1.0 - leverages)) ** 2))


def AIC(SSE: float, samples: int, fitted: int) -> float:
    """Akaike's information criterion, `m log(SSE/m) + 2 fitted`, up to what is the same for all models (Akaike, 1974)."""
    return _log_error(SSE, samples) + 2.0 * fitted


def BIC(SSE: float, samples: int, fitted: int) -> float:
    """Bayesian information criterion, `m log(SSE/m) + fitted log m`, up to what is the same for all (Schwarz, 1978)."""
    return _log_error(SSE, samples) + fitted * float(np.log(samples))


def critical_F(level: float, dof: int, terms: int = 1) -> float:
    """The value that `F(terms, dof)` exceeds with this probability where there is no effect.

        level = I_z(dof/2, terms/2),    z = dof / (dof + terms F)

    Args:
        level: probability, such as 0.01 for "99 % confidence".
        dof: degrees of freedom of the residual.
        terms: terms that are tested together.

    Raises:
        InputError: when the level is not between 0 and 1.
    """
    require(0 < level < 1, f"The level is {level}; a probability lies between 0 and 1, such as 0.01.")
    from scipy.special import betaincinv  # its import adds a filter of warnings, and importing jaxid changes nothing

    z = float(betaincinv(dof / 2, terms / 2, level))
    return dof * (1.0 / z - 1.0) / terms


def _log_error(SSE: float, samples: int) -> float:
    return samples * float(np.log(SSE / samples)) if SSE > 0 else -float("inf")
