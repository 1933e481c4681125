"""The reference problem of speed: `python -m benchmarks.reference_problem [--json]`.

An aircraft in output error with 9 states, 10 outputs and 30 free coefficients, solved by jaxid and
by what its users might take instead, C among them. The table shows the time of a pass and of a fit
with their ratios to C, the first estimate of a new process, and the agreement with the reference
(hand-derived sensitivity equations in JAX). A second table shows how jaxid's pass grows.
"""

import argparse
import datetime
import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import jax

from benchmarks.reference_problem.clocks import CLOCKS
from benchmarks.reference_problem.contenders import CONTENDERS
from benchmarks.reference_problem.growth import FULL, QUICK, growth
from benchmarks.reference_problem.measure import Options, measure
from benchmarks.reference_problem.problem import SAMPLES
from benchmarks.reference_problem.table import NOTE, contender_table, growth_table

PARTS = ("pass", "first", "growth")
QUICK_SAMPLES = 151


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return 0 if all programs that could be made agree."""
    options = _parser().parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    # compile times are measured, not read from a file
    jax.config.update("jax_enable_compilation_cache", False)
    samples = options.samples or (QUICK_SAMPLES if options.quick else SAMPLES)
    repeats = options.repeats or (3 if options.quick else 20)
    parts = options.parts or (("pass",) if options.quick else PARTS)
    setting = {"samples": samples, "statistic": "minimum", "repeats": repeats}
    setting |= {"clock": options.clock} | machine()
    rows, grown = [], []
    if "pass" in parts or "first" in parts:
        first = "first" in parts
        rows = measure(
            Options(options.only, samples, repeats, options.budget, options.clock, first)
        )
    if "growth" in parts:
        clock = CLOCKS[options.clock]
        grown = growth(QUICK if options.quick else FULL, samples, repeats, clock)
    status = "differs" if any(row["status"] == "differs" for row in rows) else "agrees"
    if options.json:
        print(json.dumps({"status": status, **setting, "rows": rows, "growth": grown}))
    else:
        print(*_texts(rows, grown), sep="\n\n")
        print(NOTE)
        print(f"minimum of up to {repeats} repeats in turns; {setting}")
    return 0 if status == "agrees" else 1


def machine() -> dict:
    """Return commit, date, machine and versions."""
    git = ["git", "-C", str(Path(__file__).parent)]
    commit = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True)
    changes = subprocess.run([*git, "status", "--porcelain"], capture_output=True, text=True)
    allowed = getattr(os, "sched_getaffinity", None)
    return {
        "commit": commit.stdout.strip() + ("+changes" if changes.stdout.strip() else ""),
        "date": datetime.date.today().isoformat(),
        "cores": len(allowed(0)) if allowed else os.cpu_count(),
        "processor": platform.machine(),
        "load": os.getloadavg()[0],
        "device": jax.devices()[0].platform,
        "jax": jax.__version__,
        "python": platform.python_version(),
    }


def _texts(rows, grown) -> list[str]:
    texts = [contender_table(rows)] if rows else []
    return texts + ([growth_table(grown)] if grown else [])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.reference_problem", description=__doc__.splitlines()[0]
    )
    add = parser.add_argument
    add("--json", action="store_true", help="print one JSON object and nothing else")
    add("--quick", action="store_true", help="151 samples, 3 repeats, few sizes, passes only")
    add("--only", nargs="+", choices=CONTENDERS, default=list(CONTENDERS), metavar="NAME")
    add("--parts", nargs="+", choices=PARTS, help="what is measured (default: all)")
    add("--samples", type=int, help=f"of the record (default: {SAMPLES})")
    add("--repeats", type=int, help="of each pass and fit, of which the smallest is taken")
    add("--budget", type=float, default=10.0, help="most seconds of one program's repeats")
    add("--clock", choices=CLOCKS, default="wall", help="cpu: on a shared machine, on one core")
    return parser


if __name__ == "__main__":
    sys.exit(main())
