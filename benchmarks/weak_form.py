"""Starting values of `identify` on the report's flights: samples and the weak form.

`python -m benchmarks.weak_form [--seeds 5] [--json]`.

The eight flights are regressed with recorded angular accelerations, with angular accelerations by
smoothing of the rates, and in weak form of three radii from the rates alone. The error of a
coefficient is the standard deviation of regression minus tables along the true motion, over the
range of the tables there.
"""

import argparse
import itertools
import json
import sys
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.report_tables.cases import fly_case, model_of, record_of
from benchmarks.report_tables.coefficients import motion_signals
from benchmarks.report_tables.settings import SETTINGS
from jaxid.aircraft.flight.report_cases import CASES
from jaxid.data.smoothing import Fourier, SmoothingSpline, differentiate
from jaxid.structure import columns
from jaxid.study import IdentifyOptions
from jaxid.study.terms.regressions import equations_of, regressions

RATES = {"p": "pdot", "q": "qdot", "r": "rdot"}
SMOOTHERS = {"Fourier": Fourier(), "spline": SmoothingSpline()}
RADII = (0.4, 0.6, 1.0)  # s; the flights are sampled at 10 Hz
MOMENTS = ("Cl", "Cm", "Cn")


class Row(NamedTuple):
    """Error of one coefficient of one flight.

    Attributes:
        seed, case, variant, coefficient: seed and name of the flight, regression, coefficient.
        error: relative error.
        terms: number of terms.
    """

    seed: int
    case: str
    variant: str
    coefficient: str
    error: float
    terms: int


def rows(case: str, seed: int) -> Iterator[Row]:
    """Yield the errors of all regressions of one flight."""
    flight, setting = fly_case(case, seed), SETTINGS[case]
    model, recorded = model_of(flight, setting), record_of(flight, setting)
    rates = recorded.without(*RATES.values())
    variants = {"recorded": (recorded, None)}
    variants |= {name: (differentiate(rates, RATES, by), None) for name, by in SMOOTHERS.items()}
    variants |= {f"weak {radius:g} s": (rates, radius) for radius in RADII}
    signals = motion_signals(flight)
    for variant, (record, radius) in variants.items():
        measured = [equations_of(model, radius)(record)]
        equations, centre = regressions(measured, IdentifyOptions(weak_radius=radius))
        for name, equation in equations.items():
            one, true = equation.regression, np.asarray(flight.truth.channel(name))
            apart = one.predict(columns(one.names, signals, centre)) - true
            error = float(np.std(apart) / np.ptp(true))
            yield Row(seed, case, variant, name, error, len(one.names))


def ratios(results: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Return the geometric mean of the errors over those with Fourier derivatives, by variant and
    case, of the moments; "all" are all cases.
    """
    moments = [row for row in results if row.coefficient in MOMENTS]
    base = {(*row[:2], row.coefficient): row.error for row in moments if row.variant == "Fourier"}
    table: dict[str, dict[str, float]] = {}
    for variant, case in itertools.product({row.variant: 0 for row in moments}, (*CASES, "all")):
        logs = [
            np.log(row.error / base[(*row[:2], row.coefficient)])
            for row in moments
            if row.variant == variant and case in (row.case, "all")
        ]
        if logs:
            table.setdefault(variant, {})[case] = float(np.exp(np.mean(logs)))
    return table


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args(arguments)
    flights = itertools.product(range(options.seeds), CASES)
    results = [row for seed, case in flights for row in rows(case, seed)]
    table = ratios(results)
    if options.json:
        print(json.dumps({"ratios": table, "rows": [row._asdict() for row in results]}))
        return 0
    print("moments: geometric mean of the error over that with Fourier derivatives")
    for variant, by_case in table.items():
        cells = "  ".join(f"{case} {value:.2f}" for case, value in by_case.items())
        print(f"{variant:<11} {cells}")
    return 0


if __name__ == "__main__":
    import jaxid

    jaxid.configure()
    sys.exit(main())
