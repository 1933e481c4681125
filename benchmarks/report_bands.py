"""Share of samples whose true coefficient lies in the two-sigma bands of `identify`.

`python -m benchmarks.report_bands [--seeds 10] [--cases "lateral 1;longitudinal 1"] [--json]`.

The bands are those of `benchmarks.report_tables.bands`. Lateral 3, in gusts, is also identified by
filter error.
"""

import argparse
import itertools
import json
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.report_tables.bands import BANDS, Share, shares
from benchmarks.report_tables.cases import CaseResult, run
from benchmarks.report_tables.settings import gust_filter
from jaxid._foundation.memory import release_compiled_programs_if_needed
from jaxid.aircraft.flight.report_cases import CASES

FILTERED = "lateral 3, filter"


class Row(NamedTuple):
    """A coefficient of one flight.

    Attributes:
        seed, case: seed and name of the flight, or `FILTERED`.
        share: the coefficient and its shares.
    """

    seed: int
    case: str
    share: Share


def identified(case: str, seed: int) -> CaseResult:
    """Return the result of a case, or of `FILTERED`."""
    if case == FILTERED:
        return run("lateral 3", seed, totals=False, likelihood=gust_filter())
    return run(case, seed, totals=False)


def summary(results: Sequence[Row]) -> list[str]:
    """Return the mean share over seeds of each coefficient of each case, one line each."""
    lines = [f"{'case':<17} {'':<3} {'seeds':>5}  " + "  ".join(f"{name:>16}" for name in BANDS)]
    groups = dict.fromkeys((row.case, row.share.coefficient) for row in results)
    for case, name in (*groups, ("all", "")):
        group = [
            row.share
            for row in results
            if (row.case, row.share.coefficient) == (case, name) or not name
        ]
        means = (np.mean([share.inside[band] for share in group]) for band in BANDS)
        cells = "  ".join(f"{mean:>16.2f}" for mean in means)
        lines.append(f"{case:<17} {name:<3} {len(group):>5}  {cells}")
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--cases", default=";".join((*CASES, FILTERED)))
    parser.add_argument("--json", action="store_true", help="print one JSON line a coefficient")
    options = parser.parse_args(arguments)
    results: list[Row] = []
    for seed, case in itertools.product(range(options.seeds), options.cases.split(";")):
        for share in shares(identified(case, seed)):
            results.append(Row(seed, case, share))
            if options.json:
                print(json.dumps({"seed": seed, "case": case} | share._asdict()), flush=True)
        release_compiled_programs_if_needed()
    if not options.json:
        print("\n".join(summary(results)))
    return 0


if __name__ == "__main__":
    import jax

    import jaxid

    jaxid.configure()
    # short records: compiling takes longer than running
    jax.config.update("jax_disable_most_optimizations", True)
    sys.exit(main())
