"""Derivatives of fitted responses along records, such as control effectiveness, with bands."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require_known
from .._foundation.types import Array, Float
from ..data.record import Record
from ..estimation import Estimate
from ..models.base import AbstractModel
from ..models.polynomial import Polynomial
from ..models.replace import polynomials_of
from ..structure import Regression
from ..uncertainty import propagate
from .bands import Band

Signals = dict[str, Float[Array, " time"]]


def derivative_bands(
    fit: Estimate,
    regressions: Mapping[str, Regression],
    model: AbstractModel,
    records: Sequence[Record],
    pairs: Mapping[str, Sequence[str]],
) -> dict[str, Band]:
    """Return derivatives of responses with respect to signals, along the measured signals.

        sigma^2 = J C J' + J_r C_r J_r',    J = d(dc/ds)/dtheta

    C is the covariance of the estimated parameters, corrected for coloured residuals, and C_r the
    covariance of the terms that keep the values of their regression.

    Args:
        fit: from `estimate`.
        regressions: regressions by response, from which the terms that are not estimated have their
            values.
        model: the estimated model, with pseudo-measurements.
        records: single records of the fit, with all channels of the pseudo-measurements.
        pairs: signals by response, such as `{"Cn": ("rudder", "rhat")}`.

    Returns:
        Bands of shape (case, time), shorter records padded with zeros, by name: `dCn/drudder`.

    Raises:
        InputError: for a response without a regression, or an unknown signal.
    """
    require_known("response with an equation", pairs, regressions)
    measured = [model.pseudo_measurements(record) for record in records]
    for signals in pairs.values():
        require_known("signal", signals, measured[0].signals)
    chosen = tuple((response, by) for response, some in pairs.items() for by in some)
    polynomials = polynomials_of(model)
    longest = max(one.t.size for one in measured)
    columns = {_name(*pair): [] for pair in chosen}
    for case, one in enumerate(measured):
        estimated = propagate(fit, _Slopes(one.signals, chosen), case=case, coloured=True)
        for response, by in chosen:
            name = _name(response, by)
            slopes = _slopes_of_terms(polynomials[response], one.signals, by)
            kept = _kept_variance(fit, regressions[response], polynomials[response], slopes)
            deviation = jnp.sqrt(estimated.standard_errors[name] ** 2 + kept)
            both = jnp.stack([estimated.value[name], deviation])
            columns[name].append(jnp.pad(both, ((0, 0), (0, longest - one.t.size))))
    return {name: Band(*jnp.stack(both, axis=1)) for name, both in columns.items()}


def _kept_variance(fit: Estimate, regression: Regression, polynomial: Polynomial, slopes):
    """Return the variance due to terms that keep the values of the regression, shape (time,)."""
    kept = [
        (polynomial.terms.index(term), at)
        for at, term in enumerate(regression.names)
        if term in polynomial.terms and f"{regression.response}.{term}" not in fit.names
    ]
    in_polynomial, in_regression = np.array(kept, int).reshape(-1, 2).T
    C = jnp.asarray(regression.covariance[np.ix_(in_regression, in_regression)])
    J = slopes[:, in_polynomial]
    return jnp.einsum("ti,ij,tj->t", J, C, J)


class _Slopes(eqx.Module):
    """Derivatives of polynomials of a model along signals, as a function of the model."""

    signals: Signals
    pairs: tuple[tuple[str, str], ...] = eqx.field(static=True)

    def __call__(self, model: AbstractModel) -> Signals:
        polynomials = polynomials_of(model)
        return {
            _name(response, by): _slope(polynomials[response], self.signals, by)
            for response, by in self.pairs
        }


def _name(response: str, by: str) -> str:
    return f"d{response}/d{by}"


def _slope(polynomial: Polynomial, signals: Signals, by: str) -> Float[Array, " time"]:
    """Return the derivative of a polynomial with respect to one of its signals."""

    def at(signals):
        def value(moved):
            return polynomial(signals | {by: moved})

        return jax.jvp(value, (signals[by],), (jnp.ones(()),))[1]

    return jax.vmap(at)(signals)


@eqx.filter_jit
def _slopes_of_terms(polynomial: Polynomial, signals: Signals, by: str):
    """Return the derivative of each term, shape (time, term)."""

    def at(coefficients):
        changed = eqx.tree_at(lambda one: one.coefficients, polynomial, coefficients)
        return _slope(changed, signals, by)

    return jax.jacfwd(at)(polynomial.coefficients)
