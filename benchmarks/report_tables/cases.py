"""Results of the eight cases from `identify`, for tables, verdicts and plots in notebooks."""

import math
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from benchmarks import report_numbers
from benchmarks.report_tables.coefficients import Error, part_errors, total_errors
from benchmarks.report_tables.settings import BIAS, SETTINGS, Setting, key_of
from jaxid.aircraft.air.atmosphere import GRAVITY
from jaxid.aircraft.flight.report_cases import CASES, REPORT_SAMPLE_TIME, report_flight
from jaxid.aircraft.flight.simulate_flight import Flight
from jaxid.aircraft.identification.flights import flight_record, from_aircraft
from jaxid.aircraft.identification.model import IdentificationModel
from jaxid.aircraft.instruments.noise_levels import report_instruments
from jaxid.data.record import Record
from jaxid.data.smoothing import SmoothingSpline, smooth
from jaxid.estimation import GaussNewton
from jaxid.estimation.likelihoods import AbstractLikelihood
from jaxid.study import Identification, IdentifyOptions, identify

# The tolerance is in standard errors; chosen, because with unknown noise the last steps shrink
# slowly, by a tenth each at worst.
SOLVER = GaussNewton(tolerance=1e-3)
LEAST_F = 50.0  # of the terms that the larger set of section 6.4.3 adds
MORE_BIASES = tuple(BIAS + name for name in ("ay", "p", "r"))


class Fitted(NamedTuple):
    """A run of maximum likelihood in the report's numbers.

    Attributes:
        parameters: number of parameters, without initial states and noise.
        J0, Jf: cost before and after, the negative log-likelihood of a sample: `sum ln(sigma) +
            m/2`, accelerations in g.
        iterations: until the whole step left was shorter than a thousandth of a standard error.
        until: iterations until the relative change of cost was that of the report's last one; None
            where it has no such run.
        status: of the search.
    """

    parameters: int
    J0: float
    Jf: float
    iterations: int
    until: int | None
    status: str


class CaseResult(NamedTuple):
    """One case, or one joint fit of several.

    Attributes:
        name: name of the case or of the joint fit.
        setting: identification setting.
        flights: flights, one for each record.
        identified: result of both stages.
        fitted: result of the second stage in the report's numbers.
        errors: errors of the coefficients against the tables, by record; empty if not computed.
    """

    name: str
    setting: Setting
    flights: tuple[Flight, ...]
    identified: Identification
    fitted: Fitted
    errors: tuple[tuple[Error, ...], ...]

    def error(self, coefficient: str, part: str = "static", record: int = 0) -> Error:
        """Return the error of one part of a coefficient."""
        return next(
            one for one in self.errors[record] if (one.coefficient, one.part) == (coefficient, part)
        )

    def sigma(self) -> dict[str, float]:
        """Return the estimated noise deviation of each output; accelerations in g, others in SI."""
        outputs = self.identified.records.outputs
        values = np.sqrt(np.diagonal(np.asarray(self.identified.estimate.noise)))
        return {
            name: float(value) / _unit(name) for name, value in zip(outputs, values, strict=True)
        }


def run(case: str, seed: int = 0, **options: Any) -> CaseResult:
    """Fly a case and identify it with its setting.

    Args:
        case: name in `jaxid.aircraft.flight.report_cases.CASES`.
        seed: seed of the instruments' errors, the noise and the gusts.
        options: options of `fit`.
    """
    return fit(case, [fly_case(case, seed)], SETTINGS[case], **options)


def fly_case(case: str, seed: int = 0, seconds: float | None = None) -> Flight:
    """Return a flight of `jaxid.aircraft.flight.report_cases`.

    The warning that it leaves the trusted range of the tables is suppressed.

    Args:
        case: name of the case.
        seed: see `run`.
        seconds: duration [s]; by default as long as in the report.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Flight .* to be trusted")
        return report_flight(case, key_of(case, seed), seconds)


def fit(
    name: str,
    flights: Sequence[Flight],
    setting: Setting,
    *,
    seconds: float | None = None,
    totals: bool = True,
    likelihood: AbstractLikelihood | None = None,
    **overruled: Any,
) -> CaseResult:
    """Identify one model from one or more flights.

    Args:
        name: name of the result; for a case, the report's convergence is known under it.
        flights: flights of one aircraft.
        setting: identification setting.
        seconds: used length of the records [s]; all by default.
        totals: if True, also compute the errors of whole coefficients along the fitted motion.
        likelihood: of the second stage; output error by default.
        overruled: options of `IdentifyOptions` that replace those of the setting.
    """
    records = [record_of(one, setting, seconds) for one in flights]
    options = IdentifyOptions(**({"add": setting.add, "leave_out": setting.leave_out} | overruled))
    per_record = tuple(f"initial_state.{state}" for state in setting.initial)
    identified = identify(
        model_of(flights[0], setting),
        records,
        options=options,
        likelihood=likelihood,
        per_record=per_record,
        solver=SOLVER,
    )
    with_totals = bool(jnp.isfinite(identified.estimate.cost)) and totals and seconds is None
    total_rows = total_errors(identified, list(flights)) if with_totals else [[] for _ in flights]
    errors = tuple(
        (*total, *part_errors(identified, one))
        for total, one in zip(total_rows, flights, strict=True)
    )
    return CaseResult(name, setting, tuple(flights), identified, _fitted(name, identified), errors)


def model_of(flown: Flight, setting: Setting) -> IdentificationModel:
    """Return the analyst's initial model, without coefficients.

    It has the mass, size and nominal instruments of the aircraft that flew.
    """
    nominal = eqx.tree_at(lambda one: one.instruments, flown.aircraft, report_instruments())
    return from_aircraft(
        nominal, states=setting.states, outputs=setting.outputs, measured=setting.measured
    )


def record_of(flown: Flight, setting: Setting, seconds: float | None = None) -> Record:
    """Return the record of a flight, with the smoothing of the setting.

    Args:
        flown: flight.
        setting: identification setting.
        seconds: used length [s]; all by default.
    """
    record = flight_record(flown)
    record = record if seconds is None else record.window(0, round(seconds / REPORT_SAMPLE_TIME))
    return smooth(record, setting.smoothed, SmoothingSpline()) if setting.smoothed else record


def larger_set(base: CaseResult) -> dict[str, Any]:
    """Return the set of section 6.4.3 for our regression, as options of `fit`.

    It has the terms of the 4 % rule, all terms with F of 50 and more, and biases of ay, p and r.
    """
    terms = {
        name: tuple(
            term
            for term, F in zip(one.regression.names, one.regression.F, strict=True)
            if F >= LEAST_F
        )
        for name, one in base.identified.equations.items()
    }
    return {"estimate": terms, "add": (*base.setting.add, *MORE_BIASES)}


def _fitted(name: str, identified: Identification) -> Fitted:
    final, records = identified.estimate, identified.records
    samples = np.asarray(jnp.sum(records.mask, axis=(0, 1)))
    units = sum(
        int(n) * math.log(_unit(output)) for n, output in zip(samples, records.outputs, strict=True)
    )
    J0, Jf = (
        (float(cost) - units) / int(samples.max()) for cost in (identified.start.cost, final.cost)
    )
    printed = [one.relative_change for one in report_numbers.fits(name) if one.table != "6.15"]
    costs = np.asarray(final.costs)
    costs = costs[np.isfinite(costs)]
    per_sample = (costs - units) / int(samples.max())
    small = np.flatnonzero(
        np.abs(np.diff(per_sample)) <= (printed[0] if printed else 0.0) * np.abs(per_sample[1:])
    )
    until = int(small[0]) + 1 if printed and small.size else None
    return Fitted(len(final.names), J0, Jf, int(final.iterations), until, final.status)


def _unit(output: str) -> float:
    """Return the report's unit of an output [SI]."""
    return GRAVITY if output in ("ax", "ay", "az") else 1.0


def run_all(cases: Sequence[str] = tuple(CASES), seed: int = 0) -> dict[str, CaseResult]:
    """Return the results of the cases by name."""
    return {case: run(case, seed) for case in cases}
