"""The eight cases through `identify`: one result each, to be printed, judged, or plotted in a notebook."""

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
from jaxid.aircraft.atmosphere import GRAVITY
from jaxid.aircraft.flights import CASES, SAMPLE_TIME, flight
from jaxid.aircraft.fly import Flight
from jaxid.aircraft.identification import IdentificationModel
from jaxid.aircraft.identification_flights import flight_record, from_aircraft
from jaxid.aircraft.noise_levels import report_instruments
from jaxid.data import SmoothingSpline, smooth
from jaxid.data.record import Record
from jaxid.estimation import GaussNewton
from jaxid.study import Identification, IdentifyOptions, identify

SOLVER = GaussNewton(
    tolerance=1e-3
)  # standard errors; with unknown noise the last steps shrink slowly, by a tenth each at worst
LEAST_F = 50.0  # of the terms that the larger set of section 6.4.3 adds
MORE_BIASES = tuple(BIAS + name for name in ("ay", "p", "r"))


class Fitted(NamedTuple):
    """A run of maximum likelihood in the report's numbers.

    Attributes:
        parameters: how many, initial states and noise not counted.
        J0, Jf: cost before and after, the negative log-likelihood of a sample: `sum ln(sigma) + m/2`, accelerations in g.
        iterations: until the whole step left was shorter than a thousandth of a standard error.
        until: iterations until the relative change of cost was that of the report's last one; None where it has no such run.
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
        name: of the case, or of what was fitted.
        setting: how.
        flights: what was flown, one for each record.
        identified: both stages.
        fitted: the second stage in the report's numbers.
        errors: of coefficients against the tables, by record; empty where they were not asked for.
    """

    name: str
    setting: Setting
    flights: tuple[Flight, ...]
    identified: Identification
    fitted: Fitted
    errors: tuple[tuple[Error, ...], ...]

    def error(self, coefficient: str, part: str = "static", record: int = 0) -> Error:
        """One of the errors."""
        return next(one for one in self.errors[record] if (one.coefficient, one.part) == (coefficient, part))

    def sigma(self) -> dict[str, float]:
        """Estimated standard deviation of each output's noise, accelerations in g, else SI."""
        outputs = self.identified.records.outputs
        values = np.sqrt(np.diagonal(np.asarray(self.identified.estimate.noise)))
        return {name: float(value) / _unit(name) for name, value in zip(outputs, values, strict=True)}


def run(case: str, seed: int = 0, **overruled: Any) -> CaseResult:
    """Fly a case and identify it as its setting says.

    Args:
        case: name in `jaxid.aircraft.flights.CASES`.
        seed: of the instruments' errors, the noise and the gusts.
        overruled: options of `IdentifyOptions` in the place of the setting's.
    """
    return fit(case, [fly_case(case, seed)], SETTINGS[case], **overruled)


def fly_case(case: str, seed: int = 0) -> Flight:
    """A case as `jaxid.aircraft.flights` flies it, without the warning that it leaves the tables' trusted range."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Flight .* to be trusted")
        return flight(case, key_of(case, seed))


def fit(
    name: str,
    flights: Sequence[Flight],
    setting: Setting,
    *,
    seconds: float | None = None,
    totals: bool = True,
    **overruled: Any,
) -> CaseResult:
    """Identify flights, together where they are several.

    Args:
        name: of the result; that of a case has the report's convergence to compare with.
        flights: of one aircraft.
        setting: how.
        seconds: length of the records that is used; all by default.
        totals: whether the errors of whole coefficients along the fitted motion are found too.
        overruled: options of `IdentifyOptions` in the place of the setting's.
    """
    records = [record_of(one, setting, seconds) for one in flights]
    options = IdentifyOptions(**({"add": setting.add, "leave_out": setting.leave_out} | overruled))
    per_record = tuple(f"initial_state.{state}" for state in setting.initial)
    identified = identify(model_of(flights[0], setting), records, options=options, per_record=per_record, solver=SOLVER)
    found = bool(jnp.isfinite(identified.estimate.cost)) and totals and seconds is None
    whole = total_errors(identified, list(flights)) if found else [[] for _ in flights]
    errors = tuple((*total, *part_errors(identified, one)) for total, one in zip(whole, flights, strict=True))
    return CaseResult(name, setting, tuple(flights), identified, _fitted(name, identified), errors)


def model_of(flown: Flight, setting: Setting) -> IdentificationModel:
    """What the analyst starts from: mass, size and nominal instruments of the aircraft that flew, and no coefficient."""
    nominal = eqx.tree_at(lambda one: one.instruments, flown.aircraft, report_instruments())
    return from_aircraft(nominal, states=setting.states, outputs=setting.outputs, measured=setting.measured)


def record_of(flown: Flight, setting: Setting, seconds: float | None = None) -> Record:
    """What the analyst has of a flight: its record, the channels of the setting smoothed.

    Args:
        flown: the flight.
        setting: how it is identified.
        seconds: length that is used; all by default.
    """
    record = flight_record(flown)
    record = record if seconds is None else record.window(0, round(seconds / SAMPLE_TIME))
    return smooth(record, setting.smoothed, SmoothingSpline()) if setting.smoothed else record


def larger_set(base: CaseResult) -> dict[str, Any]:
    """The set of section 6.4.3 for our regression: the 4 % rule's, all terms of F of 50 and more, biases of ay, p and r."""
    terms = {
        name: tuple(term for term, F in zip(one.regression.names, one.regression.F, strict=True) if F >= LEAST_F)
        for name, one in base.identified.equations.items()
    }
    return {"estimate": terms, "add": (*base.setting.add, *MORE_BIASES)}


def _fitted(name: str, identified: Identification) -> Fitted:
    found, records = identified.estimate, identified.records
    samples = np.asarray(jnp.sum(records.mask, axis=(0, 1)))
    units = sum(int(n) * math.log(_unit(output)) for n, output in zip(samples, records.outputs, strict=True))
    J0, Jf = ((float(cost) - units) / int(samples.max()) for cost in (identified.start.cost, found.cost))
    printed = [one.relative_change for one in report_numbers.fits(name) if one.table != "6.15"]
    costs = np.asarray(found.costs)
    costs = costs[np.isfinite(costs)]
    per_sample = (costs - units) / int(samples.max())
    small = np.flatnonzero(np.abs(np.diff(per_sample)) <= (printed[0] if printed else 0.0) * np.abs(per_sample[1:]))
    until = int(small[0]) + 1 if printed and small.size else None
    return Fitted(len(found.names), J0, Jf, int(found.iterations), until, found.status)


def _unit(output: str) -> float:
    """What the report measures an output in [SI]."""
    return GRAVITY if output in ("ax", "ay", "az") else 1.0


def run_all(cases: Sequence[str] = tuple(CASES), seed: int = 0) -> dict[str, CaseResult]:
    """Several cases by name."""
    return {case: run(case, seed) for case in cases}
