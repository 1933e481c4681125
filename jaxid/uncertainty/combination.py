"""Estimates of several flights combined after the fact, and linear constraints on an estimate.

Both solve the linear least-squares problem of the square-root information `T (theta - theta_i) = r`
of the estimates, and so need no records.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy

from .._foundation.checks import require, require_known
from .._foundation.notebook import Table
from .._foundation.types import Array, Float
from ..estimation.coloured_errors import colour_ratio
from ..estimation.result import Estimate
from ..sensitivity.spectrum import SHARE


class ParameterTable(eqx.Module):
    """Values of parameters with their covariance, and a test of the agreement of their sources.

    Attributes:
        names, units: of the parameters.
        values, standard_errors, covariance: as in `Estimate`; an infinite standard error for a
            parameter that remains undetermined.
        misfit: sum of squares by which the parts disagree: of the estimates that were combined,
            or of the estimate with its constraints.
        degrees_of_freedom: of the misfit, which is chi-square distributed if the parts agree.
        p_value: probability of a misfit that is larger. A small one: the flights do not have the
            same parameters, or the constraints are not true.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    values: Float[Array, " parameter"]
    standard_errors: Float[Array, " parameter"]
    covariance: Float[Array, "parameter parameter"]
    misfit: Float[Array, ""]
    degrees_of_freedom: int = eqx.field(static=True)
    p_value: Float[Array, ""]

    def value(self, name: str) -> float:
        """Return the value of one parameter, by name."""
        return float(np.asarray(self.values)[self.names.index(name)])

    def standard_error(self, name: str) -> float:
        """Return the standard error of one parameter, by name."""
        return float(np.asarray(self.standard_errors)[self.names.index(name)])

    def _repr_html_(self) -> str:
        return self.html()

    def __str__(self) -> str:
        return "\n".join([*self._table().lines(), self._misfit_words()])

    def html(self, above: Sequence[str] = ()) -> str:
        """Return the table as an HTML element, with lines of text above."""
        return self._table().html(above, below=[self._misfit_words()])

    def _table(self) -> Table:
        """Return the parameters in words."""
        rows = zip(self.names, self.values, self.standard_errors, self.units, strict=True)
        return Table(
            ("parameter", "value", "std. error", "unit"),
            (9, 13, 11),
            tuple(
                (name, f"{float(value):.6g}", f"{float(error):.3g}", unit)
                for name, value, error, unit in rows
            ),
        )

    def _misfit_words(self) -> str:
        return (
            f"misfit: {float(self.misfit):.4g} with {self.degrees_of_freedom} degrees of "
            f"freedom (p = {float(self.p_value):.2g})"
        )


class Rows(NamedTuple):
    """Rows of a least-squares problem `T d = r`."""

    T: np.ndarray
    r: np.ndarray


def combine(estimates: Sequence[Estimate], *, coloured: bool = False) -> ParameterTable:
    """Return the estimate of the parameters that several estimates share, by information.

        theta = ( sum_i M_i )^-1 sum_i M_i theta_i,    covariance = ( sum_i M_i )^-1

    For models that are linear in their parameters and a known R it equals the joint estimate from
    all records; for others it is asymptotically as good. A direction that one flight does not
    determine gets no weight from it. (Section 4.2, Information Aggregation.)

    Args:
        estimates: of the same parameters, in any order; each of one case.
        coloured: weights from the errors corrected for the colour of the residuals.

    Raises:
        InputError: when there is no estimate, parameters differ, one stands on a bound, or more
            than one estimate contains a prior of the same parameter, which would count twice.
    """
    require(len(estimates) > 0, "There is no estimate to combine. Give at least one.")
    first = estimates[0]
    for number, estimate in enumerate(estimates):
        _require_plain(estimate, f"Estimate {number}")
        require(
            sorted(estimate.names) == sorted(first.names),
            f"Estimate {number} has the parameters ({', '.join(estimate.names)}), estimate 0 has "
            f"({', '.join(first.names)}). Combine estimates of the same parameters.",
        )
    for name in first.names:
        priors = [number for number, one in enumerate(estimates) if name in one.free.prior]
        require(
            len(priors) <= 1,
            f"The prior of {name!r} is in the estimates {', '.join(map(str, priors))} and would "
            "count more than once. Keep it in one of them.",
        )
    origin = np.asarray(first.values)
    blocks = [_rows(estimate, first.names, origin, coloured) for estimate in estimates]
    rows = Rows(np.concatenate([b.T for b in blocks]), np.concatenate([b.r for b in blocks]))
    return solved(
        *(first.names, first.units, rows),
        origin=origin,
        basis=np.eye(origin.size),
        rank=sum(map(_rank, estimates)),
        threshold=first.threshold,
    )


def constrain(
    estimate: Estimate, constraints: Sequence[tuple[Mapping[str, float], float]]
) -> ParameterTable:
    """Return an estimate under linear constraints `sum_k a_k theta_k = b`.

        theta = theta_0 + N q,    min_q |T (theta - theta_hat) - r|    (N: null space of A)

    For a model that is linear in its parameters and a known R it equals the estimate of the model
    with the constraints. Constraints can determine a combination that the data do not.

    Args:
        estimate: of one case.
        constraints: coefficients by name, and the right-hand side:
            `[({"Cm.de": 1.0, "CZ.de": -2.9}, 0.0)]`.

    Raises:
        InputError: for a name that is not free, constraints that contradict or repeat each other,
            or a parameter on a bound.
    """
    _require_plain(estimate, "The estimate")
    A = np.zeros((len(constraints), len(estimate.names)))
    b = np.zeros(len(constraints))
    for row, (coefficients, value) in enumerate(constraints):
        require_known("free parameter (in `constraints`)", coefficients, estimate.names)
        for name, coefficient in coefficients.items():
            A[row, estimate.names.index(name)] = coefficient
        b[row] = value
    scale = np.asarray(estimate.spectrum.scale)
    U, s, Vt = np.linalg.svd(A / scale[None])
    require(
        bool(len(b) and len(b) <= A.shape[1] and s[-1] > 1e-9 * s[0]),
        f"The {len(b)} constraints are empty, or repeat or contradict each other. Give independent "
        "ones, fewer than parameters.",
    )
    origin = np.asarray(estimate.values)
    offset = (Vt[: len(b)].T @ ((U.T @ (b - A @ origin)) / s)) / scale
    null = Vt[len(b) :].T / scale[:, None]
    rows = _rows(estimate, estimate.names, origin + offset, coloured=False)
    return solved(
        *(estimate.names, estimate.units, rows),
        origin=origin + offset,
        basis=null,
        rank=_rank(estimate),
        threshold=estimate.threshold,
    )


def _require_plain(estimate: Estimate, which: str) -> None:
    """Refuse a batch of cases, and a parameter on a bound, which has no information."""
    require(
        np.ndim(estimate.values) == 1,
        f"{which} is a batch of {np.shape(estimate.values)[0]} cases. Give its cases one by one.",
    )
    on_bound = [
        name for name, on in zip(estimate.names, np.asarray(estimate.on_bound), strict=True) if on
    ]
    require(
        not on_bound,
        f"{which} has {', '.join(on_bound)} on a bound, where there is no information about it. "
        "Estimate without the bound, or fix the parameter in all.",
    )


def _rows(estimate: Estimate, names: tuple[str, ...], origin, coloured: bool) -> Rows:
    """Return the rows of an estimate in the order of `names`, about an origin."""
    count = len(names)
    order = [estimate.names.index(name) for name in names]
    T = np.asarray(estimate.information.triangle)[:count, order]
    r = np.asarray(estimate.information.rhs)[:count]
    if coloured:
        ratio = colour_ratio(estimate.standard_errors, estimate.corrected_errors)
        T = T / np.asarray(ratio)[order][None]
    return Rows(T, r + T @ (np.asarray(estimate.values)[order] - origin))


def _rank(estimate: Estimate) -> int:
    """Return the number of directions that an estimate determines."""
    spectrum = estimate.spectrum
    weak = np.asarray(spectrum.weak(estimate.threshold))
    return int(np.sum(~weak & (np.asarray(spectrum.singular_values) > 0)))


def solved(
    names: tuple[str, ...],
    units: tuple[str, ...],
    rows: Rows,
    *,
    origin: np.ndarray,
    basis: np.ndarray,
    rank: int,
    threshold: float,
) -> ParameterTable:
    """Return the solution `origin + basis q` of the rows, over the directions that they determine.

    Args:
        names, units: of the parameters.
        rows: the least-squares problem.
        origin: parameters about which the rows are.
        basis: one column for each unknown.
        rank: number of directions that the estimates determine, each for itself.
        threshold: squares of singular values below this share of the largest are weak.
    """
    T, size = rows.T @ basis, _length(rows.T)
    length = _length(T)
    U, s, Vt = np.linalg.svd(T / length[None], full_matrices=False)
    strong = (s > 0) & (s**2 >= threshold * np.max(s, initial=0.0) ** 2)
    half = basis @ (Vt[strong].T / s[strong] / length[:, None])
    turned = U[:, strong].T @ rows.r
    weak = size[:, None] * (basis @ (Vt[~strong].T / length[:, None]))
    undetermined = np.any(np.abs(weak) > SHARE * _length(weak)[None], axis=1)
    covariance = half @ half.T
    errors = np.where(undetermined, np.inf, np.sqrt(np.diagonal(covariance)))
    misfit = float(np.sum((rows.r - U[:, strong] @ turned) ** 2))
    dof = rank - int(np.sum(strong))
    return ParameterTable(
        names=names,
        units=units,
        values=jnp.asarray(origin + half @ turned),
        standard_errors=jnp.asarray(errors),
        covariance=jnp.asarray(covariance + np.diag(np.where(undetermined, np.inf, 0.0))),
        misfit=jnp.asarray(misfit),
        degrees_of_freedom=dof,
        p_value=jnp.asarray(scipy.stats.chi2.sf(misfit, dof) if dof > 0 else 1.0),
    )


def _length(columns: np.ndarray) -> np.ndarray:
    """Return the lengths of columns, one for a column of zeros."""
    length = np.linalg.norm(columns, axis=0)
    return np.where(length > 0, length, 1.0)
