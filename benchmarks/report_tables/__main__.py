"""The report's tables of chapters III, V and VI, from our own flights: `python -m
benchmarks.report_tables`.
"""

import argparse
import json
import sys
import time

import jax

from benchmarks import report_numbers
from benchmarks.report_tables.cases import CaseResult, fit, larger_set, run
from benchmarks.report_tables.comparisons import curves
from benchmarks.report_tables.examples import Small, small
from benchmarks.report_tables.settings import LATERAL, SETTINGS
from benchmarks.report_tables.text import (
    as_numbers,
    case_table,
    error_table,
    example_table,
    plain,
    verdict_lines,
)
from benchmarks.report_tables.verdicts import FIRST_10_S, JOINT, LARGER, verdicts
from jaxid.aircraft.flight.report_cases import CASES

# Cases that each further fit needs.
MORE = {LARGER: ("lateral 1",), JOINT: ("lateral 1", "lateral 4"), FIRST_10_S: ("coupled 1",)}

# Table of the report's likelihood, for a case with several tables or none.
TABLES = {"lateral 1": "6.5", LARGER: "6.15", JOINT: ""}


def more(name: str, results: dict[str, CaseResult]) -> CaseResult:
    """Return a fit that the claims need in addition to the eight cases.

    Args:
        name: one of `MORE`.
        results: results of the cases that it needs.
    """
    cases = [results[case] for case in MORE[name]]
    flights = [case.flights[0] for case in cases]
    if name == LARGER:
        return fit(name, flights, LATERAL, totals=False, **larger_set(cases[0]))
    if name == JOINT:
        return fit(name, flights, LATERAL, totals=False)
    return fit(name, flights, SETTINGS["coupled 1"], seconds=10.0)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return 0 if every case converged."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.report_tables", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object and nothing else"
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        help="of the instruments' errors, the noise and the gusts (default: 0)",
    )
    parser.add_argument(
        "--part",
        choices=("report", "f16"),
        default="report",
        help="the report's cases, or the F-16's",
    )
    parser.add_argument(
        "--cases",
        nargs="*",
        choices=[*CASES, "examples"],
        metavar="CASE",
        help="which (default: all)",
    )
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    if options.part == "f16":
        from benchmarks.report_tables.f16 import main as f16

        return f16(options.seed, options.json)
    return report(options.seed, options.cases or [*CASES, "examples"], options.json)


def report(seed: int, cases: list[str], as_json: bool) -> int:
    """Run the report's part: cases, further fits for the claims, small manoeuvres, verdicts."""
    begin, results = time.perf_counter(), {}
    for case in CASES:
        if case in cases:
            results[case] = run(case, seed)
            _print_unless(as_json, case_table(results[case], TABLES.get(case)) + "\n")
    for name, needed in MORE.items():
        if set(needed) <= set(results):
            results[name] = more(name, results)
            _print_unless(as_json, case_table(results[name], TABLES.get(name)) + "\n")
    examples: dict[str, Small] = {}
    if "examples" in cases:
        examples = {one.case: small(one, seed) for one in report_numbers.examples()}
        _print_unless(as_json, example_table(examples.values()) + "\n")
    claims = verdicts(results, examples, seed)
    for totals in (True, False):
        _print_unless(as_json, error_table(results, totals) + "\n")
    _print_unless(as_json, verdict_lines(claims))
    fine = all(
        bool(one.identified.estimate.successful) for name, one in results.items() if name in CASES
    )
    if as_json:
        output = {
            "status": "converged" if fine else "not converged",
            "seed": seed,
            "seconds": time.perf_counter() - begin,
            "cases": {name: as_numbers(one, TABLES.get(name)) for name, one in results.items()},
            "Cm over alpha": curves(results),
            "examples": examples,
            "verdicts": claims,
        }
        print(json.dumps(plain(output)))
    else:
        print(f"\nSeed {seed}, {time.perf_counter() - begin:.0f} s.")
    return 0 if fine else 1


def _print_unless(quiet: bool, words: str) -> None:
    if not quiet:
        print(words, flush=True)


if __name__ == "__main__":
    sys.exit(main())
