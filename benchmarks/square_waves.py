"""Square waves by dynamic programming against conventional ones and a spline, within one set of
limits: `python -m benchmarks.square_waves [--json]`.

The nonlinear longitudinal aircraft of `benchmarks.input_design`, elevator with 3 deg, 100 deg/s,
within its envelope of alpha and q. Each conventional input, with pulses for five frequencies about
the mode's, is scaled to the limits; the best of each family counts. Total standard error,
`sqrt(sum (error / value)^2)`, and processor time of a first design, which compiles, and again.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from typing import Any

from jaxid import configure
from jaxid.design import Limits, Trace, design_input, spline, square_wave_design
from jaxid.models.names import read_parameters

from .input_design import families, short_period, trim_values

# Samples of a stage (0.4, 0.2 and 0.08 s), cells and width of the search.
SEARCHES = ((10, 12, 600), (5, 12, 600), (2, 12, 600), (2, 24, 3000))
KNOTS = (24, 48)  # of the splines


def measure() -> dict[str, dict[str, float]]:
    """Return total standard error and processor seconds, first and again, of each input."""
    case, signals = short_period(), families(short_period())
    envelope = {
        name: (value - case.envelope[name], value + case.envelope[name])
        for name, value in trim_values(case).items()
    }
    rate = {"elevator": math.radians(100.0)}
    limits = Limits({"elevator": case.peak}, rate, None, envelope)
    total = Trace(1.0 / read_parameters(case.model, case.free.shared) ** 2)

    def timed(design: Any, shape, **options) -> tuple[dict[str, float], Any]:
        seconds, result = [], None
        for _ in range(2):
            begin = time.process_time()
            result = design(
                *(case.model, case.free, case.t, shape, total, limits, case.likelihood),
                **options,
                **case.start,
            )
            seconds.append(time.process_time() - begin)
        error = math.exp(0.5 * result.cost)
        return {"error": error, "first": seconds[0], "again": seconds[1]}, result

    table: dict[str, dict[str, float]] = {}
    comparisons = ()
    for knots in KNOTS:
        shape = spline(case.t, knots)
        row, best = timed(design_input, shape, conventional=signals)
        table[f"spline, {knots} knots"], comparisons = row, best.comparisons
    for comparison in comparisons:
        error = math.exp(0.5 * comparison.within_limits)
        previous = table.setdefault(comparison.name, {"error": math.inf})
        previous["error"] = min(previous["error"], error)
    for stage, cells, width in SEARCHES:
        name = f"square wave, stages of {stage * 0.04:g} s, width {width}"
        table[name], _ = timed(square_wave_design, stage, cells=cells, width=width)
    return table


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the comparison and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args(arguments)
    configure()
    table = measure()
    if options.json:
        sys.stdout.write(json.dumps(table, indent=2) + "\n")
        return
    for name, row in sorted(table.items(), key=lambda item: item[1]["error"]):
        times = f"{row['first']:8.1f} s {row['again']:8.1f} s" if "first" in row else ""
        sys.stdout.write(f"{name:<40} {row['error']:.4f} {times}\n")


if __name__ == "__main__":
    main()
