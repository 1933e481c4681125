"""Small manoeuvres of Tables 3.3, 3.4 and 5.1: our terms and the report's for a response."""

from typing import NamedTuple

import numpy as np

from benchmarks.report_numbers import Example
from benchmarks.report_tables.cases import fly_case, model_of
from benchmarks.report_tables.coefficients import angles, true_part
from benchmarks.report_tables.settings import LATERAL, LONGITUDINAL
from jaxid.aircraft.flight.report_cases import EXAMPLES
from jaxid.aircraft.identification.flights import flight_record
from jaxid.structure import REPORT, columns, least_squares, stepwise

MOST = REPORT.R2_stop  # for the report's words "virtually all"


class Small(NamedTuple):
    """One manoeuvre.

    Attributes:
        table, case, response: as printed.
        terms: those of the first model of the stepwise regression that explains as much as the
            report's does, the constant aside.
        explained: R2 of it.
        printed: the report's terms.
        printed_explained: R2 of those on our data.
        printed_share: their R2 as printed in the report.
        values: least-squares values of the report's terms on our data.
        slope: the tables' derivative of the response by beta at the angle of attack of the start,
            without sideslip.
        alpha_deg, beta_deg: smallest and largest true angles.
    """

    table: str
    case: str
    response: str
    terms: tuple[str, ...]
    explained: float
    printed: tuple[str, ...]
    printed_explained: float
    printed_share: float
    values: dict[str, float]
    slope: float
    alpha_deg: tuple[float, float]
    beta_deg: tuple[float, float]


def small(example: Example, seed: int = 0) -> Small:
    """Fly a small manoeuvre without noise and regress its response.

    Args:
        example: row of `report_numbers.examples()`.
        seed: unused by flights without noise, kept for those with.
    """
    flown = fly_case(example.case, seed)
    setting = LONGITUDINAL if example.response == "Cm" else LATERAL
    measured = model_of(flown, setting).pseudo_measurements(flight_record(flown))
    valid = np.asarray(measured.valid)
    signals = {name: np.asarray(value)[valid] for name, value in measured.signals.items()}
    y = np.asarray(measured.responses[example.response])[valid]
    centre = {name: float(np.mean(signals[name])) for name in measured.centred}
    candidates = dict(measured.candidates)[example.response]
    selection = stepwise(
        columns(candidates, signals, centre),
        y,
        candidates,
        options=REPORT,
        response=example.response,
    )
    wanted = min(example.explained, MOST)
    reached = next((one for one in selection.models if wanted <= one.R2), selection.models[-1])
    printed = tuple(term for term in example.terms if term != "1")
    theirs = least_squares(columns(printed, signals, centre), y, printed, response=example.response)
    true = angles(flown)
    start = {"alpha": np.array([EXAMPLES[example.case].alpha]), "beta": np.zeros(1)}
    slope = true_part(flown.aircraft.airframe.aerodynamics, example.response, start, "beta")
    spans = {
        name: tuple(float(np.degrees(edge)) for edge in (np.min(x), np.max(x)))
        for name, x in true.items()
    }
    return Small(
        example.table,
        example.case,
        example.response,
        reached.terms,
        float(reached.R2),
        printed,
        float(theirs.R2),
        example.explained,
        dict(zip(printed, map(float, theirs.values), strict=True)),
        float(slope[0]),
        spans["alpha"],
        spans["beta"],
    )
