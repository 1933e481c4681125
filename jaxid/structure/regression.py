"""The result of a regression, and the report's rule for its strong terms."""

from dataclasses import dataclass

import numpy as np

from .._foundation.checks import require
from .._foundation.types import Float


@dataclass(frozen=True, eq=False)
class Regression:
    """A response as a sum of terms, `y = constant + X values + e`, with uncertainties.

    Attributes:
        response, names: names of the response and of the terms.
        values, standard_errors: shape (term,) [response/term].
        covariance: covariance of the values, shape (term, term).
        F: F of each term given all others, `(value / standard error)^2` (B.28).
        constant, constant_error: the constant and its standard error [response]; zero if no
            constant is fitted.
        constant_covariance: covariance of the constant with each value, shape (term,).
        has_constant: whether a constant is fitted.
        overall_F: F of all terms together (B.20), with the number of terms and `dof` degrees of
            freedom; NaN without a term.
        R2: `1 - SSE/SST` (B.19); it can be negative if the values are not least-squares values.
        s: standard deviation of the residual, `sqrt(SSE/dof)`, with weights of mean one [response].
        residuals: `y - constant - X values`, shape (time,) [response].
        dof: number of samples minus number of fitted values.
        method: name of the method, for tables.
    """

    response: str
    names: tuple[str, ...]
    values: np.ndarray
    standard_errors: np.ndarray
    covariance: np.ndarray
    F: np.ndarray
    constant: float
    constant_error: float
    constant_covariance: np.ndarray
    has_constant: bool
    overall_F: float  # noqa: N815
    R2: float
    s: float
    residuals: np.ndarray
    dof: int
    method: str

    def predict(self, X: Float[np.ndarray, "time term"]) -> Float[np.ndarray, " time"]:
        """Return the response for other values of the terms, columns in the order of `names`."""
        return self.constant + X @ self.values

    def __str__(self) -> str:
        width = max(map(len, (*self.names, "constant", "term")))
        lines = [
            f"{self.response}: {self.method}",
            f"{'term':<{width}} {'value':>13} {'std error':>13} {'F':>10}",
        ]
        for row in zip(self.names, self.values, self.standard_errors, self.F, strict=True):
            lines.append(f"{row[0]:<{width}} {row[1]:>13.5g} {row[2]:>13.3g} {row[3]:>10.4g}")
        if self.has_constant:
            lines.append(
                f"{'constant':<{width}} {self.constant:>13.5g} {self.constant_error:>13.3g}"
            )
        overall = f"overall F({len(self.names)}, {self.dof}) {self.overall_F:.5g}"
        return "\n".join(
            [*lines, f"R2 {self.R2:.6g}, {overall}, residual standard deviation {self.s:.4g}"]
        )


def strong_terms(regression: Regression, share: float = 0.04) -> tuple[str, ...]:
    """Return the terms whose F is at least a share of the largest F, in their order.

    These terms are worth estimating by maximum likelihood; the others keep the values of the
    regression. At a share of 0.04 the relative standard error is five times the relative standard
    error of the best term (report section 6.2.3.1, Table 6.3).

    Args:
        regression: regression of one response.
        share: share of the largest F.

    Raises:
        InputError: if the share is not between 0 and 1.
    """
    require(
        0 <= share <= 1, f"The share is {share}; it lies between 0 and 1, the report's is 0.04."
    )
    largest = max(regression.F, default=0.0)
    return tuple(
        name for name, F in zip(regression.names, regression.F, strict=True) if share * largest <= F
    )
