"""Share of samples whose true coefficient lies in the two-sigma bands of `identify`.

`python -m benchmarks.report_bands [--seeds 10] [--cases "lateral 1,longitudinal 1"] [--json]`.

Three bands of each coefficient along the report's flights: of the parameters, corrected for
coloured residuals; with the misfit of the polynomials; with the errors of instruments, of the
standard deviations from which the flights draw them.
"""

import argparse
import itertools
import json
import sys
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.report_tables.cases import record_of, run
from jaxid._foundation.memory import release_compiled_programs_if_needed
from jaxid.aircraft.flight.report_cases import CASES
from jaxid.aircraft.instruments.noise_levels import NoiseLevel
from jaxid.models.free import all_names
from jaxid.study import Identification

KINDS = ("scale", "bias", "position", "misalignment")
BANDS = ("parameters", "with misfit", "with instruments")


class Row(NamedTuple):
    """Shares of one coefficient of one flight.

    Attributes:
        seed, case, coefficient: seed and name of the flight, and the coefficient.
        inside: share of samples with the true value inside, by band.
        error, parameters, misfit, instruments: root mean squares of the error and the deviations.
    """

    seed: int
    case: str
    coefficient: str
    inside: dict[str, float]
    error: float
    parameters: float
    misfit: float
    instruments: float


def deviations(identified: Identification, level: NoiseLevel | None) -> dict[str, float]:
    """Return the standard deviations of the instruments' constants that are not estimated."""
    found = {}
    if level is None:
        return found
    for name in all_names(identified.model):
        group, _, rest = name.partition(".")
        kind, _, channel = rest.partition(".")
        sizes = getattr(level, kind) if group == "instruments" and kind in KINDS else {}
        if channel.partition(".")[0] in sizes and name not in identified.estimate.free.shared:
            found[name] = float(sizes[channel.partition(".")[0]])
    return found


def rows(case: str, seed: int) -> Iterator[Row]:
    """Yield the shares of the coefficients of one flight."""
    result = run(case, seed, totals=False)
    (flight,), identified = result.flights, result.identified
    bands = identified.combined_bands(
        record_of(flight, result.setting), deviations(identified, CASES[case].noise)
    )
    for name, band in bands.items():
        true = np.asarray(flight.truth.channel(name))
        value, parameters, instruments = (
            np.asarray(each)[0, : true.size]
            for each in (band.value, band.parameters, band.instruments)
        )
        apart, misfit = value - true, float(band.misfit)
        variances = np.cumsum(
            [parameters**2, np.full_like(parameters, misfit**2), instruments**2], axis=0
        )
        inside = np.mean(np.abs(apart) <= 2.0 * np.sqrt(variances), axis=1)
        sizes = (float(np.sqrt(np.mean(each**2))) for each in (apart, parameters, instruments))
        error, of_parameters, of_instruments = sizes
        shares = dict(zip(BANDS, inside.tolist(), strict=True))
        yield Row(seed, case, name, shares, error, of_parameters, misfit, of_instruments)


def summary(results: Sequence[Row]) -> list[str]:
    """Return the mean share over seeds of each coefficient of each case, one line each."""
    lines = [f"{'case':<15} {'':<3} {'seeds':>5}  " + "  ".join(f"{name:>16}" for name in BANDS)]
    groups = dict.fromkeys((row.case, row.coefficient) for row in results)
    for case, name in (*groups, ("all", "")):
        group = [row for row in results if (row.case, row.coefficient) == (case, name) or not name]
        shares = (np.mean([row.inside[band] for row in group]) for band in BANDS)
        cells = "  ".join(f"{share:>16.2f}" for share in shares)
        lines.append(f"{case:<15} {name:<3} {len(group):>5}  {cells}")
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--json", action="store_true", help="print one JSON line a coefficient")
    options = parser.parse_args(arguments)
    results: list[Row] = []
    for seed, case in itertools.product(range(options.seeds), options.cases.split(",")):
        for row in rows(case, seed):
            results.append(row)
            if options.json:
                print(json.dumps(row._asdict()), flush=True)
        release_compiled_programs_if_needed()
    if not options.json:
        print("\n".join(summary(results)))
    return 0


if __name__ == "__main__":
    import jaxid

    jaxid.configure()
    sys.exit(main())
