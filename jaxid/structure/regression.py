"""What a regression found, and the report's rule for which of its terms are strong."""

from dataclasses import dataclass

import numpy as np

from .._foundation.checks import require
from .._foundation.types import Float


@dataclass(frozen=True, eq=False)
class Regression:
    """A response as a sum of terms, `y = constant + X values + e`, with the uncertainty of each number.

    Attributes:
        response, names: of what is explained and of the terms.
        values, standard_errors: shape (term,) [response/term].
        covariance: of the values, shape (term, term).
        F: of each term when all others are in, `(value / standard error)^2` (B.28).
        constant, constant_error: the constant and its standard error [response]; zero where none was fitted.
        constant_covariance: of the constant with each value, shape (term,).
        has_constant: whether one was fitted.
        overall_F: of the whole equation (B.20), with as many and `dof` degrees of freedom; NaN without a term.
        R2: `1 - SSE/SST` (B.19); where values are not those of least squares it can be negative.
        s: standard deviation of the residual, `sqrt(SSE/dof)` [response]; of the weighted one where there are weights.
        residuals: `y - constant - X values`, shape (time,) [response].
        dof: samples less all that was fitted.
        method: in words.
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
        """The response for other values of the terms, columns in the order of `names`."""
        return self.constant + X @ self.values

    def __str__(self) -> str:
        width = max(map(len, (*self.names, "constant", "term")))
        lines = [f"{self.response}: {self.method}", f"{'term':<{width}} {'value':>13} {'std error':>13} {'F':>10}"]
        for row in zip(self.names, self.values, self.standard_errors, self.F, strict=True):
            lines.append(f"{row[0]:<{width}} {row[1]:>13.5g} {row[2]:>13.3g} {row[3]:>10.4g}")
        if self.has_constant:
            lines.append(f"{'constant':<{width}} {self.constant:>13.5g} {self.constant_error:>13.3g}")
        overall = f"overall F({len(self.names)}, {self.dof}) {self.overall_F:.5g}"
        return "\n".join([*lines, f"R2 {self.R2:.6g}, {overall}, residual standard deviation {self.s:.4g}"])


def strong(regression: Regression, share: float = 0.04) -> tuple[str, ...]:
    """Terms whose F is at least a share of the largest, in their order: those worth estimating by likelihood.

    The others stay in the model with the regression's values. A share of 0.04 is a standard error, relative to the value, five
    times that of the best term (report section 6.2.3.1, Table 6.3).

    Args:
        regression: of one response.
        share: of the largest F.

    Raises:
        InputError: when the share is not between 0 and 1.
    """
    require(0 <= share <= 1, f"The share is {share}; it lies between 0 and 1, the report's is 0.04.")
    largest = max(regression.F, default=0.0)
    return tuple(name for name, F in zip(regression.names, regression.F, strict=True) if share * largest <= F)
