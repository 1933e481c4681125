"""Polynomial of a coefficient through local estimates at many trims (C.4.2.2 of the report)."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_unique
from .._foundation.notebook import preformatted
from .._foundation.types import Float, Numbers
from .combination import ParameterTable, Rows, solved
from .curves import Curve

# least singular value of the scaled rows, relative to the largest, of a determined polynomial
# (chosen: half of the digits)
LEAST_SINGULAR_VALUE = float(np.sqrt(np.finfo(float).eps))
# asymmetry of a correlation that is taken as rounding (chosen)
SYMMETRY_RTOL = 1e-6


class TrimPolynomial(eqx.Module):
    """A coefficient as a polynomial through local estimates.

    Attributes:
        table: coefficients of the powers with their covariance, and the test of agreement.
        powers: power of each coefficient.
        centre: value about which the polynomial is written [unit of the signal].
        low, high: smallest and largest trim; outside the polynomial is extrapolated.
    """

    table: ParameterTable
    powers: tuple[int, ...] = eqx.field(static=True)
    centre: float = eqx.field(static=True)
    low: float = eqx.field(static=True)
    high: float = eqx.field(static=True)

    def curve(self, points: Float[Numbers, " point"], derivative: int = 0) -> Curve:
        """Return the polynomial or its derivative over points, with its standard errors (6.4).

        Args:
            points: values of the signal; those outside of the trims are not valid.
            derivative: order of the derivative. The value of a polynomial through slopes alone is
                its difference from the value at the centre.
        """
        points = np.asarray(points, float)
        rows = _rows(points - self.centre, self.powers, derivative)
        covariance = rows @ np.asarray(self.table.covariance) @ rows.T
        errors = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
        return Curve(
            jnp.asarray(points),
            jnp.asarray(rows @ np.asarray(self.table.values)),
            jnp.asarray(errors),
            jnp.asarray(covariance),
            jnp.asarray((points >= self.low) & (points <= self.high)),
        )

    def _repr_html_(self) -> str:
        return preformatted(str(self))

    def __str__(self) -> str:
        return f"about {self.centre:g}, from {self.low:g} to {self.high:g}\n{self.table}"


def combine_trims(
    trims: Float[Numbers, " trim"],
    estimates: Float[Numbers, "trim derivative"],
    covariances: Float[Numbers, "trim derivative derivative"],
    degree: int,
    *,
    derivatives: Sequence[int] = (0, 1),
    centre: float = 0.0,
    signal: str = "alpha",
    units: tuple[str, str] = ("", "rad"),
) -> TrimPolynomial:
    """Return the weighted least-squares polynomial through local estimates at trims.

        C^ = M^-1 sum_i X_i' P_i^-1 c_i,    M = sum_i X_i' P_i^-1 X_i,    cov(C^) = M^-1

    (C.69 to C.72, with a matrix P_i in place of `r / t_i`). X_i has one row for each local
    estimate: the powers of `x = trim - centre` for a value, their derivatives for a slope. The
    flights are independent of each other. A small p-value of the table means that the local
    estimates differ from every polynomial of this degree by more than their errors: the degree is
    too low, or a motion about a trim was so large that its slope is an average over a curved part.

    Args:
        trims: values of the signal at which the local models were estimated.
        estimates: at each trim the value of the coefficient, its slope, and so on, such as `Cm` and
            `Cm.alpha` of a local linear model about the trim.
        covariances: of the estimates of each trim, such as parts of `fit.covariance`.
        degree: of the polynomial.
        derivatives: order of the derivative in each column of the estimates; `(1,)` for slopes
            alone, from which the constant is not determined and left out.
        centre: value about which the polynomial is written.
        signal: name of the signal, for the table.
        units: units of the coefficient and of the signal, for the table.

    Raises:
        InputError: for shapes that do not match, values that are not finite, a covariance that is
            not positive definite, and trims that do not determine the polynomial.
    """
    trims, estimates, P = (np.asarray(one, float) for one in (trims, estimates, covariances))
    derivatives = tuple(derivatives)
    _check(trims, estimates, P, derivatives)
    require(
        degree >= min(derivatives),
        f"The degree is {degree}, and derivatives of order {min(derivatives)} determine nothing of "
        "such a polynomial. Give a higher degree.",
    )
    powers = tuple(range(min(derivatives), degree + 1))
    rows = np.stack([_rows(trims - centre, powers, order) for order in derivatives], axis=1)
    whiten = np.linalg.inv(np.linalg.cholesky(P))
    X = (whiten @ rows).reshape(-1, len(powers))
    y = np.einsum("tij,tj->ti", whiten, estimates).ravel()
    names = tuple(_name(signal, centre, power) for power in powers)
    table = _table(Rows(X, y), names, tuple(_unit(units, power) for power in powers))
    return TrimPolynomial(table, powers, float(centre), float(np.min(trims)), float(np.max(trims)))


def _rows(x: np.ndarray, powers: tuple[int, ...], derivative: int) -> np.ndarray:
    """Return the derivative of each power at each point, shape (point, power)."""
    p = np.array(powers)
    factor = np.prod([p - k for k in range(derivative)], axis=0)  # zero for lower powers
    return factor * x[:, None] ** np.maximum(p - derivative, 0)


def _check(
    trims: np.ndarray, estimates: np.ndarray, P: np.ndarray, derivatives: tuple[int, ...]
) -> None:
    count, orders = len(trims), len(derivatives)
    require_unique("derivative", tuple(map(str, derivatives)))
    require(
        orders > 0 and min(derivatives) >= 0,
        f"The derivatives are {derivatives}. Give orders of 0 or more, at least one.",
    )
    require(
        estimates.shape == (count, orders) and P.shape == (count, orders, orders),
        f"For {count} trims and {orders} derivatives the estimates must have shape "
        f"({count}, {orders}) and the covariances ({count}, {orders}, {orders}); they have "
        f"{estimates.shape} and {P.shape}.",
    )
    require(
        all(bool(np.isfinite(one).all()) for one in (trims, estimates, P)),
        "A trim, an estimate or a covariance is not finite. Leave out trims whose estimate is not "
        "determined.",
    )
    for number, one in enumerate(P):
        variances = np.diagonal(one)
        rounding = SYMMETRY_RTOL * np.sqrt(np.abs(np.outer(variances, variances)))
        require(
            bool(np.all(np.abs(one - one.T) <= rounding) and np.linalg.eigvalsh(one)[0] > 0),
            f"The covariance of trim {number} is not symmetric and positive definite.",
        )


def _name(signal: str, centre: float, power: int) -> str:
    about = signal if centre == 0 else f"({signal}-{centre:g})"
    return "1" if power == 0 else about if power == 1 else f"{about}^{power}"


def _unit(units: tuple[str, str], power: int) -> str:
    own, signal = units
    below = signal if power == 1 else f"{signal}^{power}"
    return f"{own or 1}/{below}" if power and signal else own


def _table(rows: Rows, names: tuple[str, ...], units: tuple[str, ...]) -> ParameterTable:
    """Return the least-squares solution of whitened rows; refuse rows that do not determine it."""
    count = len(names)
    table = solved(
        *(names, units, rows),
        origin=np.zeros(count),
        basis=np.eye(count),
        rank=len(rows.r),
        threshold=LEAST_SINGULAR_VALUE**2,
    )
    require(
        len(rows.r) >= count and bool(np.isfinite(np.asarray(table.standard_errors)).all()),
        f"{len(rows.r)} local estimates do not determine the {count} coefficients "
        f"{', '.join(names)}. Give more trims, slopes as well as values, or a lower degree.",
    )
    return table
