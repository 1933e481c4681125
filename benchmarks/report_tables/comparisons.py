"""Comparisons of results: combined slopes of two experiments, predictions, curves over alpha."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from benchmarks.report_tables.cases import CaseResult, record_of
from benchmarks.report_tables.coefficients import (
    Error,
    Estimated,
    angles,
    motion_errors,
    part,
    part_errors,
)
from jaxid.aircraft.flight.simulate_flight import Flight
from jaxid.diagnosis import statistics

STEPS = 50
DEGREE = np.pi / 180


class Combined(NamedTuple):
    """The slope of Cn in beta over alpha from two experiments (Fig. 6.22), each of shape (alpha,).

    Attributes:
        alpha: the angles that both records cover [rad].
        each: by name of the result, the slope with its standard deviation and the truth.
        value, deviation: the mean with the inverse variances as weights (Eq. 4.15).
        rms: root mean square error by name; that of the mean is called "combined".
    """

    alpha: np.ndarray
    each: dict[str, Estimated]
    value: np.ndarray
    deviation: np.ndarray
    rms: dict[str, float]


class Predicted(NamedTuple):
    """A flight that was not used, simulated with the parameters of another one (Figs 6.31 to 6.34).

    Attributes:
        t, z, y: times, measured and predicted outputs by name.
        theil, theil_of_fit: Theil's coefficient by output, in the prediction and in the fit itself.
        errors: of whole coefficients at the true motion of the flight, of static ones and control
            derivatives at its angles.
    """

    t: np.ndarray
    z: dict[str, np.ndarray]
    y: dict[str, np.ndarray]
    theil: dict[str, float]
    theil_of_fit: dict[str, float]
    errors: tuple[Error, ...]


class CommonErrors(NamedTuple):
    """Absolute errors of a coefficient over the angles of attack that several records cover.

    Attributes:
        low_deg, high_deg: ends of the common range [deg].
        rms: root mean square error by name of the result.
        shape: the same after the mean error is taken off.
    """

    low_deg: float
    high_deg: float
    rms: dict[str, float]
    shape: dict[str, float]


def combined(first: CaseResult, second: CaseResult, *others: CaseResult) -> Combined:
    """Return the average `dCn/dbeta` at beta = 0 of two fits, over the alpha of both records.

    Args:
        first, second: results to average.
        others: fits that are compared and do not enter the mean, such as a joint fit.
    """
    spans = [angles(one.flights[0])["alpha"] for one in (first, second)]
    alpha = np.linspace(max(map(np.min, spans)), min(map(np.max, spans)), STEPS)
    at = {"alpha": alpha, "beta": np.zeros(STEPS)}
    tables = first.flights[0].aircraft.airframe.aerodynamics
    each = {
        one.name: part(one.identified, tables, "Cn", at, "beta") for one in (first, second, *others)
    }
    two = [each[one.name] for one in (first, second)]
    with np.errstate(divide="ignore"):
        weights = np.stack([one.deviation**-2.0 for one in two])
    # A slope without estimated terms has zero variance, so its weight is infinite.
    known = np.all(np.isfinite(weights), axis=0)
    total = np.where(known, np.sum(weights, axis=0), np.nan)
    value = np.where(
        known, np.sum(weights * np.stack([one.value for one in two]), axis=0) / total, np.nan
    )
    true = two[0].true
    rms = {name: _rms(one.value - true) for name, one in each.items()}
    return Combined(alpha, each, value, total**-0.5, rms | {"combined": _rms(value - true)})


def predicted(result: CaseResult, flight: Flight) -> Predicted:
    """Simulate a flight with the parameters of a result, unchanged, from the flight's own measured
    start.

    Args:
        result: of another flight.
        flight: to predict.
    """
    identified = result.identified
    prediction = identified.predict(record_of(flight, result.setting))
    outputs = identified.records.outputs
    theil = statistics(prediction.z, prediction.y, prediction.scored, outputs=outputs).theil
    fit, v = identified.records, identified.estimate.residuals
    theil_of_fit = statistics(fit.z, fit.z - v, fit.mask, outputs=outputs).theil
    return Predicted(
        np.asarray(prediction.t[0]),
        *(
            dict(zip(outputs, np.asarray(each[0]).T, strict=True))
            for each in (prediction.z, prediction.y)
        ),
        *(
            dict(zip(outputs, np.asarray(each).tolist(), strict=True))
            for each in (theil, theil_of_fit)
        ),
        (*motion_errors(identified, flight), *part_errors(identified, flight)),
    )


def curves(
    results: Mapping[str, CaseResult], coefficient: str = "Cm"
) -> dict[str, dict[str, np.ndarray]]:
    """A static coefficient over alpha at beta = 0, of each result over the range of its record
    (Figs 6.9, 6.19).

    Args:
        results: by name; those without this coefficient are left out.
        coefficient: which.

    Returns:
        By name: `alpha` [rad], `value`, `deviation`, `true`.
    """
    histories = {}
    for name, result in results.items():
        equation = result.identified.equations.get(coefficient)
        if equation is None or not equation.kept:
            continue
        flown = angles(result.flights[0])["alpha"]
        alpha = np.linspace(flown.min(), flown.max(), STEPS)
        at = {"alpha": alpha, "beta": np.zeros(STEPS)}
        one = part(
            result.identified, result.flights[0].aircraft.airframe.aerodynamics, coefficient, at
        )
        histories[name] = {"alpha": alpha, **one._asdict()}
    return histories


def on_common_angles(
    results: Mapping[str, CaseResult], coefficient: str = "Cm", by: str | None = None
) -> CommonErrors:
    """Errors of a static coefficient, or of its derivative, at beta = 0 over the angles of attack
    that all records cover.

    Args:
        results: by name, each with this coefficient.
        coefficient: which.
        by: signal of the derivative, such as beta for a lateral coefficient; None for the
            coefficient itself.
    """
    spans = [angles(one.flights[0])["alpha"] for one in results.values()]
    alpha = np.linspace(max(map(np.min, spans)), min(map(np.max, spans)), STEPS)
    at = {"alpha": alpha, "beta": np.zeros(STEPS)}
    apart = {}
    for name, one in results.items():
        tables = one.flights[0].aircraft.airframe.aerodynamics
        history = part(one.identified, tables, coefficient, at, by)
        apart[name] = history.value - history.true
    edges = np.degrees(alpha[[0, -1]])
    return CommonErrors(
        float(edges[0]),
        float(edges[1]),
        {name: _rms(error) for name, error in apart.items()},
        {name: float(np.std(error)) for name, error in apart.items()},
    )


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))
