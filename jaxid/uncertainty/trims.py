"""Polynomial of a coefficient through local estimates at many trims (C.4.2.2 of the report)."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_unique
from .._foundation.types import Float, Numbers
from .combination import ParameterTable, Rows, solved
from .curves import Curve

# least singular value of the scaled rows, relative to the largest, of a determined polynomial
# (chosen: half of the digits)
LEAST_SINGULAR_VALUE = float(np.sqrt(np.finfo(float).eps))
# asymmetry of a correlation that is taken as rounding (chosen)
SYMMETRY_RTOL = 1e-6


class TrimPolynomial(eqx.Module):
    """A coefficient as a polynomial of one signal or more through local estimates.

    Attributes:
        table: coefficients of the products of powers with their covariance, and the test of
            agreement.
        powers: powers of the signals of each coefficient.
        centre: values about which the polynomial is written, by signal [unit of the signal].
        low, high: smallest and largest trim by signal; outside the polynomial is extrapolated.
    """

    table: ParameterTable
    powers: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    centre: tuple[float, ...] = eqx.field(static=True)
    low: tuple[float, ...] = eqx.field(static=True)
    high: tuple[float, ...] = eqx.field(static=True)

    def curve(self, points: Float[Numbers, "point *signal"], derivative: int = 0) -> Curve:
        """Return the polynomial or its derivative over points, with its standard errors (6.4).

        Args:
            points: values of the signal, or rows of values of several signals; those outside of the
                trims are not valid.
            derivative: order of the derivative by the first signal. The value of a polynomial
                through slopes alone is its difference from the value at the centre.
        """
        points = np.asarray(points, float)
        columns = _columns(points)
        require(
            columns.shape[1:] == (len(self.centre),),
            f"The points have shape {points.shape}, and the polynomial has {len(self.centre)} "
            "signals. Give one column for each.",
        )
        require(
            isinstance(derivative, int) and derivative >= 0,
            f"`derivative` is {derivative}. Give an order of zero or more.",
        )
        rows = _rows(columns - np.array(self.centre), self.powers, derivative)
        covariance = rows @ np.asarray(self.table.covariance) @ rows.T
        errors = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
        return Curve(
            jnp.asarray(points),
            jnp.asarray(rows @ np.asarray(self.table.values)),
            jnp.asarray(errors),
            jnp.asarray(covariance),
            jnp.asarray(np.all((columns >= self.low) & (columns <= self.high), axis=1)),
        )

    def _repr_html_(self) -> str:
        return self.table.html(above=self._ranges())

    def __str__(self) -> str:
        return "\n".join([*self._ranges(), str(self.table)])

    def _ranges(self) -> list[str]:
        """Return the range of each signal in words."""
        ranges = zip(self.centre, self.low, self.high, strict=True)
        return [f"about {centre:g}, from {low:g} to {high:g}" for centre, low, high in ranges]


def combine_trims(
    trims: Float[Numbers, "trim *signal"],
    estimates: Float[Numbers, "trim derivative"],
    covariances: Float[Numbers, "trim derivative derivative"],
    degree: int | Sequence[int],
    *,
    derivatives: Sequence[int] = (0, 1),
    centre: float | Sequence[float] = 0.0,
    signal: str | Sequence[str] = "alpha",
    units: tuple[str, ...] = ("", "rad"),
) -> TrimPolynomial:
    """Return the weighted least-squares polynomial through local estimates at trims.

        C^ = M^-1 sum_i X_i' P_i^-1 c_i,    M = sum_i X_i' P_i^-1 X_i,    cov(C^) = M^-1

    (C.69 to C.72, with a matrix P_i in place of `r / t_i`). X_i has one row for each local
    estimate: the powers of `x = trim - centre` for a value, their derivatives for a slope. With
    further signals, such as the Mach number, it has all products of their powers up to the degrees
    (C.42, C.43), and derivatives are by the first signal. The flights are independent of each
    other. A small p-value of the table means that the local estimates differ from every polynomial
    of this degree by more than their errors: the degree is too low, or a motion about a trim was so
    large that its slope is an average over a curved part.

    Args:
        trims: values of the signal at which the local models were estimated, or rows of values of
            several signals, such as alpha and mach.
        estimates: at each trim the value of the coefficient, its slope, and so on, such as `Cm` and
            `Cm.alpha` of a local linear model about the trim.
        covariances: of the estimates of each trim, such as parts of `fit.covariance`.
        degree: of the polynomial, by signal.
        derivatives: order of the derivative in each column of the estimates; `(1,)` for slopes
            alone, from which the constant is not determined and left out.
        centre: value about which the polynomial is written, the same for all signals or by signal.
        signal: name of the signal, or names, for the table.
        units: units of the coefficient and of the signals, for the table.

    Raises:
        InputError: for shapes that do not match, values that are not finite, a covariance that is
            not positive definite, and trims that do not determine the polynomial.
    """
    trims, estimates, P = (np.asarray(one, float) for one in (trims, estimates, covariances))
    derivatives, trims = tuple(derivatives), _columns(trims)
    axes = _axes(trims, degree, centre, signal, units)
    _check(trims, estimates, P, derivatives)
    first = axes.degrees[0]
    require(
        first >= min(derivatives),
        f"The degree is {first}, and derivatives of order {min(derivatives)} determine nothing of "
        "such a polynomial. Give a higher degree.",
    )
    ranges = (range(min(derivatives), first + 1), *(range(k + 1) for k in axes.degrees[1:]))
    powers = tuple(itertools.product(*ranges))
    x = trims - np.array(axes.centre)
    rows = np.stack([_rows(x, powers, order) for order in derivatives], axis=1)
    whiten = np.linalg.inv(np.linalg.cholesky(P))
    X = (whiten @ rows).reshape(-1, len(powers))
    y = np.einsum("tij,tj->ti", whiten, estimates).ravel()
    names = tuple(axes.name(own) for own in powers)
    table = _table(Rows(X, y), names, tuple(axes.unit(own) for own in powers))
    low, high = (tuple(map(float, limit(trims, axis=0))) for limit in (np.min, np.max))
    return TrimPolynomial(table, powers, axes.centre, low, high)


class _Axes(NamedTuple):
    """Degree, centre, name and unit of each signal, and the unit of the coefficient."""

    degrees: tuple[int, ...]
    centre: tuple[float, ...]
    signals: tuple[str, ...]
    units: tuple[str, ...]
    own: str

    def name(self, powers: tuple[int, ...]) -> str:
        """Return the name of a product, such as `alpha (mach-0.6)^2`."""
        axes = zip(self.signals, self.centre, powers, strict=True)
        factors = [_factor(signal, centre, power) for signal, centre, power in axes if power]
        return " ".join(factors) or "1"

    def unit(self, powers: tuple[int, ...]) -> str:
        """Return the unit of the coefficient of a product, such as `1/rad^2`."""
        below = [
            unit if power == 1 else f"{unit}^{power}"
            for unit, power in zip(self.units, powers, strict=True)
            if power and unit
        ]
        return f"{self.own or 1}/{' '.join(below)}" if below else self.own


def _axes(trims: np.ndarray, degree, centre, signal, units: tuple[str, ...]) -> _Axes:
    """Return degree, centre, name and unit of each signal, after checks."""
    count = trims.shape[1]
    degrees = tuple(np.atleast_1d(degree).tolist())
    require(
        all(isinstance(each, int) and each >= 0 for each in degrees),
        f"`degree` is {degree}. Give a whole number of zero or more for each signal.",
    )
    signals = (signal,) if isinstance(signal, str) else tuple(signal)
    given = (centre,) * count if np.ndim(centre) == 0 else centre
    centres = tuple(map(float, given))
    sizes = {"degree": len(degrees), "signal": len(signals), "centre": len(centres)}
    for name, size in {**sizes, "units": len(units) - 1}.items():
        require(
            size == count,
            f"The trims have {count} signals, and `{name}` is for {size}. Give one for each"
            f"{', after the unit of the coefficient' if name == 'units' else ''}.",
        )
    return _Axes(degrees, centres, signals, tuple(units[1:]), units[0])


def _columns(points: np.ndarray) -> np.ndarray:
    """Return points as rows, also those of one signal."""
    return points[:, None] if points.ndim == 1 else points


def _rows(x: np.ndarray, powers: tuple[tuple[int, ...], ...], derivative: int) -> np.ndarray:
    """Return the derivative of each product by the first signal at each point, (point, product)."""
    p = np.array(powers)
    factor = np.prod([p[:, 0] - k for k in range(derivative)], axis=0)  # zero for lower powers
    lowered = np.column_stack([np.maximum(p[:, 0] - derivative, 0), p[:, 1:]])
    return factor * np.prod(x[:, None, :] ** lowered, axis=2)


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


def _factor(signal: str, centre: float, power: int) -> str:
    about = signal if centre == 0 else f"({signal}-{centre:g})"
    return about if power == 1 else f"{about}^{power}"


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
