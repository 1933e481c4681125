"""Errors of a model's coefficients against the tables: whole, static and derivatives."""

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxid.aircraft.flight.simulate_flight import Flight
from jaxid.aircraft.vehicle.aerodynamics import COEFFICIENTS, AbstractAerodynamics
from jaxid.models.polynomial import Polynomial, factors
from jaxid.structure import columns
from jaxid.study import Identification

Signals = Mapping[str, np.ndarray]
CONTROLS = {
    "CX": ("stabilator",),
    "CZ": ("stabilator",),
    "Cm": ("stabilator",),
    **dict.fromkeys(("CY", "Cl", "Cn"), ("rudder", "aileron")),
}
AT_REST = ("stabilator", "aileron", "rudder", "phat", "qhat", "rhat")


class Estimated(NamedTuple):
    """A coefficient or a derivative of it along some signals, each of shape (time,).

    Attributes:
        value: value of the model.
        deviation: its standard deviation, from the covariance of the estimated parameters.
        true: value of the tables.
    """

    value: np.ndarray
    deviation: np.ndarray
    true: np.ndarray


class Error(NamedTuple):
    """Error of a history of a coefficient.

    Attributes:
        coefficient: name of the coefficient.
        part: "total" along the fitted motion, or "at the true motion"; "static", without controls
            and rates, or "d/d aileron" and so on, both at the true angles.
        rms: root mean square of estimated minus true.
        range: largest minus smallest true value.
        relative: the first over the second.
        shape: the same after the mean error is taken off.
    """

    coefficient: str
    part: str
    rms: float
    range: float
    relative: float
    shape: float


def error_of(coefficient: str, part: str, value: np.ndarray, true: np.ndarray) -> Error:
    """Return the error of one history."""
    apart = value - true
    rms, span = float(np.sqrt(np.mean(apart**2))), float(np.ptp(true))
    relative, shape = (
        size / span if span > 0 else float("nan") for size in (rms, float(np.std(apart)))
    )
    return Error(coefficient, part, rms, span, relative, shape)


def kept(identified: Identification) -> tuple[str, ...]:
    """Return the coefficients whose equations were kept."""
    return tuple(name for name, one in identified.equations.items() if one.kept)


def total_errors(identified: Identification, flights: list[Flight]) -> list[list[Error]]:
    """Return the errors of the whole coefficients along the fitted motion, by record."""
    names = kept(identified)
    bands = identified.prediction_bands(*names).signals
    by_record = []
    for row, flight in enumerate(flights):
        rows = []
        for name in names:
            true = np.asarray(flight.truth.channel(name))
            value = np.asarray(bands[name].value)[row, : true.size]
            rows.append(error_of(name, "total", value, true))
        by_record.append(rows)
    return by_record


def part_errors(identified: Identification, flight: Flight) -> list[Error]:
    """Return errors of static coefficients and control derivatives at a flight's true angles."""
    true = angles(flight)
    aerodynamics = flight.aircraft.airframe.aerodynamics
    names = kept(identified)
    chosen = [(name, "static", None) for name in names]
    chosen += [(name, f"d/d {by}", by) for name in names for by in CONTROLS[name]]
    rows = []
    for name, title, by in chosen:
        history = part(identified, aerodynamics, name, true, by)
        rows.append(error_of(name, title, history.value, history.true))
    return rows


def motion_errors(identified: Identification, flight: Flight) -> list[Error]:
    """Return errors of the whole coefficients at a flight's true motion, controls and rates."""
    true = motion_signals(flight)
    rows = []
    for name in kept(identified):
        value, _ = estimated(identified, name, true)
        known = np.asarray(flight.truth.channel(name))
        rows.append(error_of(name, "at the true motion", value, known))
    return rows


def motion_signals(flight: Flight) -> dict[str, np.ndarray]:
    """The signals of the coefficients along the true motion of a flight, each of shape (time,)."""
    true = {
        name: np.asarray(flight.truth.channel(name)) for name in ("alpha", "beta", *AT_REST[:3])
    }
    V, lengths = np.asarray(flight.truth.channel("V")), np.asarray(flight.aircraft.airframe.lengths)
    for rate, length in zip("pqr", lengths, strict=True):
        true[f"{rate}hat"] = np.asarray(flight.truth.channel(rate)) * length / (2.0 * V)
    return true


def angles(flight: Flight) -> dict[str, np.ndarray]:
    """The true angle of attack and sideslip of a flight, each of shape (time,) [rad]."""
    return {name: np.asarray(flight.truth.channel(name)) for name in ("alpha", "beta")}


def part(
    identified: Identification,
    aerodynamics: AbstractAerodynamics,
    coefficient: str,
    at: Signals,
    by: str | None = None,
) -> Estimated:
    """A static coefficient, or its derivative by a signal, with its band and the truth.

    Args:
        identified: whose model holds the polynomials.
        aerodynamics: the tables.
        coefficient: which.
        at: `alpha` and `beta`, each of shape (time,) [rad]; controls and rates are zero.
        by: signal of the derivative.
    """
    value, deviation = estimated(identified, coefficient, at, by)
    return Estimated(value, deviation, true_part(aerodynamics, coefficient, at, by))


def estimated(
    identified: Identification, coefficient: str, at: Signals, by: str | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """A coefficient or its derivative by a signal, and its standard deviation, each of shape
    (time,). Terms that kept the regression's values have its covariance, independent of that of
    the estimated parameters.

    Args:
        identified, coefficient, at, by: as in `part`; controls and rates that are given count.
    """
    polynomial, fit = (
        getattr(identified.model.airframe.aerodynamics, coefficient),
        identified.estimate,
    )
    X = _columns(polynomial, _all_signals(at), by)
    names = [f"{coefficient}.{term}" for term in polynomial.terms]
    free = [(k, fit.names.index(name)) for k, name in enumerate(names) if name in fit.names]
    C = np.asarray(fit.covariance)[np.ix_([i for _, i in free], [i for _, i in free])]
    X_free = X[:, [k for k, _ in free]]
    variance = np.einsum("ti,ij,tj->t", X_free, C, X_free)
    regression = identified.equations[coefficient].regression
    kept = [
        (k, regression.names.index(term))
        for k, term in enumerate(polynomial.terms)
        if names[k] not in fit.names and term in regression.names
    ]
    C = np.asarray(regression.covariance)[np.ix_([i for _, i in kept], [i for _, i in kept])]
    X_kept = X[:, [k for k, _ in kept]]
    variance = variance + np.einsum("ti,ij,tj->t", X_kept, C, X_kept)
    return X @ np.asarray(polynomial.coefficients), np.sqrt(np.maximum(variance, 0.0))


def true_part(
    aerodynamics: AbstractAerodynamics, coefficient: str, at: Signals, by: str | None = None
) -> np.ndarray:
    """A static coefficient of the tables, or its derivative by a signal, shape (time,)."""
    return np.asarray(_true(aerodynamics, _all_signals(at), by))[:, COEFFICIENTS.index(coefficient)]


@eqx.filter_jit
def _true(aerodynamics: AbstractAerodynamics, signals: Signals, by: str | None):
    def one(signals):
        if by is None:
            return aerodynamics.coefficients(signals)
        return jax.jvp(
            lambda x: aerodynamics.coefficients(signals | {by: x}), (signals[by],), (jnp.ones(()),)
        )[1]

    return jax.vmap(one)(signals)


def _columns(polynomial: Polynomial, signals: Signals, by: str | None) -> np.ndarray:
    """The value of each term, or its derivative by a signal, shape (time, term)."""
    if by is None:
        return columns(polynomial.terms, signals, polynomial.centre)
    powers = [dict(factors(term)) for term in polynomial.terms]
    lowered = [_product({**each, by: each.get(by, 1) - 1}) for each in powers]
    distinct = list(dict.fromkeys(lowered))
    values = columns(distinct, signals, polynomial.centre)
    weights = np.array([each.get(by, 0) for each in powers])
    return weights * values[:, [distinct.index(term) for term in lowered]]


def _product(powers: Mapping[str, int]) -> str:
    """Return the term of some powers of signals."""
    return " ".join(f"{base}^{power}" for base, power in powers.items() if power) or "1"


def _all_signals(at: Signals) -> dict[str, jax.Array]:
    """Return all signals of the coefficients; missing controls and rates are zero."""
    given = {name: jnp.asarray(value, float) for name, value in at.items()}
    zero = jnp.zeros_like(given["alpha"])
    return dict.fromkeys(AT_REST, zero) | given
