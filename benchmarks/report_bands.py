"""Share of samples whose true coefficient lies in the two-sigma bands of `identify`.

`python -m benchmarks.report_bands [--seeds 10] [--cases "lateral 1,longitudinal 1"] [--json]`.

The bands are those of `benchmarks.report_tables.bands`.
"""

import argparse
import itertools
import json
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.report_tables.bands import BANDS, Share, shares
from benchmarks.report_tables.cases import run
from jaxid._foundation.memory import release_compiled_programs_if_needed
from jaxid.aircraft.flight.report_cases import CASES


class Row(NamedTuple):
    """A coefficient of one flight.

    Attributes:
        seed, case: seed and name of the flight.
        share: the coefficient and its shares.
    """

    seed: int
    case: str
    share: Share


def summary(results: Sequence[Row]) -> list[str]:
    """Return the mean share over seeds of each coefficient of each case, one line each."""
    lines = [f"{'case':<15} {'':<3} {'seeds':>5}  " + "  ".join(f"{name:>16}" for name in BANDS)]
    groups = dict.fromkeys((row.case, row.share.coefficient) for row in results)
    for case, name in (*groups, ("all", "")):
        group = [
            row.share
            for row in results
            if (row.case, row.share.coefficient) == (case, name) or not name
        ]
        means = (np.mean([share.inside[band] for share in group]) for band in BANDS)
        cells = "  ".join(f"{mean:>16.2f}" for mean in means)
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
        for share in shares(run(case, seed, totals=False)):
            results.append(Row(seed, case, share))
            if options.json:
                print(json.dumps({"seed": seed, "case": case} | share._asdict()), flush=True)
        release_compiled_programs_if_needed()
    if not options.json:
        print("\n".join(summary(results)))
    return 0


if __name__ == "__main__":
    import jaxid

    jaxid.configure()
    sys.exit(main())
