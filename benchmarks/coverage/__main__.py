"""Share of 95 % intervals that hold the truth: `python -m benchmarks.coverage [--json]
[--draws 2000] [--only NAME ...]`.

Each case simulates many records of a known system, estimates from all of them in one program, or
by a study of each, and counts for each parameter the intervals that hold the truth. A correct share
lies within the band with 99.9 % probability, Bonferroni over the parameters of the case. A
parameter on its bound has no asymptotic interval, and counts as one that does not hold the truth.
"""

import argparse
import json
import sys
import time
from collections.abc import Mapping

import numpy as np
from scipy.stats import binom

from benchmarks.coverage.cases import CASES, LEVEL
from benchmarks.coverage.flights import DERIVATIVES, Flights
from benchmarks.reference_problem.__main__ import machine
from jaxid import configure


def measure(name: str, draws: int, seed: int = 1974) -> dict:
    """Return the row of one case: shares, their band and the efficiency of each parameter.

    Args:
        name: name of the case.
        draws: number of records.
        seed: seed of the noise.
    """
    case, begin = CASES[name], time.process_time()
    flights = case.fly(draws, case.samples, seed)
    answer = case.intervals(flights)
    truth = _truth(answer.names, flights, case.truth)
    low, high = band(draws, len(answer.names), case.expected)
    inside = (answer.ends[..., 0] <= truth) & (truth <= answer.ends[..., 1])
    mistakes, variance = answer.values - truth, np.nanmean(answer.errors**2, axis=0)
    rows = [
        {
            "parameter": parameter,
            "truth": float(truth[:, at].mean()),
            "coverage": float(inside[:, at].mean()),
            "on_bound": float(np.isnan(answer.ends[:, at]).any(axis=-1).mean()),
            "rms_error": float(np.sqrt(np.mean(mistakes[:, at] ** 2))),
            "bias_in_scatter": float(mistakes[:, at].mean() / mistakes[:, at].std()),
            "efficiency": float(mistakes[:, at].var() / variance[at]),
        }
        for at, parameter in enumerate(answer.names)
    ]
    return {
        "case": name,
        "draws": draws,
        "samples": case.samples,
        "converged": float(answer.successful.mean()),
        "expected": case.expected,
        "band": [low, high],
        "inside": bool(all(low <= row["coverage"] <= high for row in rows)),
        "claimed": case.claimed,
        "processor_seconds": time.process_time() - begin,
        "rows": rows,
    }


def band(draws: int, parameters: int, expected: float = LEVEL) -> tuple[float, float]:
    """Return the shares that a correct interval meets with 99.9 % probability."""
    tail = 0.0005 / parameters
    low, high = binom.ppf([tail, 1.0 - tail], draws, expected) / draws
    return float(low), float(high)


def _truth(names: tuple[str, ...], flights: Flights, others: Mapping[str, float]) -> np.ndarray:
    """Return the true values of each flight, shape (draw, parameter)."""
    known = dict(zip(DERIVATIVES, flights.derivatives.T, strict=True))
    columns = [known.get(name, np.full(len(flights.z), others.get(name))) for name in names]
    return np.stack(columns, axis=1)


def table(row: dict) -> str:
    """Return the row of one case as text."""
    low, high = row["band"]
    lines = [
        f"{row['case']}: {row['draws']} draws of {row['samples']} samples, "
        f"{row['converged']:.1%} converged, band {low:.2%} to {high:.2%}, "
        f"{row['processor_seconds']:.0f} s",
        f"{'parameter':<24}{'truth':>9}{'coverage':>10}{'bias':>8}{'efficiency':>12}",
    ]
    for entry in row["rows"]:
        mark = "" if low <= entry["coverage"] <= high else "  outside"
        lines.append(
            f"{entry['parameter']:<24}{entry['truth']:>9g}{entry['coverage']:>10.2%}"
            f"{entry['bias_in_scatter']:>8.2f}{entry['efficiency']:>12.3f}{mark}"
        )
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return 0 if every claimed share lies inside its band."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.coverage", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")
    parser.add_argument("--draws", type=int, default=2000, help="records of each case (2000)")
    parser.add_argument("--only", nargs="+", choices=tuple(CASES), help="cases, all by default")
    options = parser.parse_args(arguments)
    configure()
    rows = []
    for name in options.only or CASES:
        rows.append(measure(name, options.draws))
        if not options.json:
            print(table(rows[-1]), flush=True)
    inside = all(row["inside"] for row in rows if row["claimed"])
    if options.json:
        status = "inside" if inside else "outside"
        print(json.dumps({"status": status, "level": LEVEL, **machine(), "rows": rows}))
    else:
        print("bias in units of the scatter; efficiency: variance over the mean of the bounds")
    return 0 if inside else 1


if __name__ == "__main__":
    sys.exit(main())
