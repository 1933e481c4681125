"""The report's tables of chapters III, V and VI, from our own flights: `python -m
benchmarks.report_tables [--seeds 20] [--json] [--log FILE]`.

Progress, and the verdicts after each seed, go to standard error.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from benchmarks import report_numbers
from benchmarks.report_tables.cases import CaseResult, fit, larger_set, run
from benchmarks.report_tables.comparisons import curves
from benchmarks.report_tables.examples import Small, small
from benchmarks.report_tables.rows import overall_F
from benchmarks.report_tables.settings import LATERAL, SETTINGS
from benchmarks.report_tables.text import (
    F_table,
    as_numbers,
    case_table,
    error_table,
    example_table,
    plain,
    verdict_lines,
)
from benchmarks.report_tables.verdicts import (
    FIRST_10_S,
    JOINT,
    LARGER,
    Judged,
    judge,
    verdicts,
)
from jaxid._foundation.checks import InputError
from jaxid._foundation.memory import release_compiled_programs_if_needed
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
    """Run the benchmark; return 0 if every case converged in every seed."""
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
        help="first seed of the instruments' errors, the noise and the gusts (default: 0)",
    )
    parser.add_argument(
        "--seeds", type=int, default=1, help="number of seeds on which claims are judged"
    )
    parser.add_argument("--log", type=Path, help="add a line of JSON to this file for each seed")
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
    # short records: compiling takes longer than running; the variable is for jaxid's own options
    os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
    jax.config.update("jax_disable_most_optimizations", True)
    if options.part == "f16":
        from benchmarks.report_tables.f16 import main as f16

        return f16(options.seed, options.json)
    seeds = range(options.seed, options.seed + options.seeds)
    return report(seeds, options.cases or [*CASES, "examples"], options.json, options.log)


class Seed(NamedTuple):
    """Results of one seed.

    Attributes:
        seed: of the instruments' errors, the noise and the gusts.
        results: by name of the case or of the further fit.
        examples: small manoeuvres by name.
        failures: message by name of a case that could not be identified.
        claims: the claims with these results.
    """

    seed: int
    results: dict[str, CaseResult]
    examples: dict[str, Small]
    failures: dict[str, str]
    claims: list[Judged]


def one_seed(
    seed: int, cases: list[str], show: Callable[[str], None], *, totals: bool = False
) -> Seed:
    """Run cases, further fits and small manoeuvres of one seed.

    Args:
        seed: of the instruments' errors, the noise and the gusts.
        cases: names of the cases, and "examples".
        show: receives one line when a fit has ended.
        totals: if True, also compute the errors of whole coefficients, which no claim needs.
    """
    results: dict[str, CaseResult] = {}
    failures: dict[str, str] = {}
    begin = time.perf_counter()
    for name in (*CASES, *MORE):
        try:
            if name in MORE:
                if not set(MORE[name]) <= set(results):
                    continue
                result = more(name, results)
            elif name in cases:
                result = run(name, seed, totals=totals)
            else:
                continue
        except InputError as error:
            failures[name] = str(error)
            show(f"seed {seed}, {time.perf_counter() - begin:.0f} s: {name} failed: {error}")
            continue
        if np.isfinite(float(result.identified.estimate.cost)):
            results[name] = result
        else:
            failures[name] = result.fitted.status
        show(f"seed {seed}, {time.perf_counter() - begin:.0f} s: {name} {result.fitted.status}")
    examples = (
        {one.case: small(one, seed) for one in report_numbers.examples()}
        if "examples" in cases
        else {}
    )
    return Seed(seed, results, examples, failures, judge(results, examples))


def report(seeds: range, cases: list[str], as_json: bool, log: Path | None = None) -> int:
    """Run the report's part: cases, further fits for the claims, small manoeuvres, verdicts.

    Args:
        seeds: the seeds; full tables are printed for the first.
        cases: names of the cases, and "examples".
        as_json: if True, print one JSON object, with progress on standard error.
        log: file that receives a line of JSON for each seed.
    """
    begin, rows, claims, first, fine = time.perf_counter(), [], [], {}, True

    def show(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    for seed in seeds:
        used = time.process_time()
        done = one_seed(seed, cases, show, totals=len(seeds) == 1)
        claims.append(done.claims)
        converged = {
            name: bool(one.identified.estimate.successful) for name, one in done.results.items()
        }
        fine = (
            fine and not done.failures and all(converged[name] for name in CASES if name in cases)
        )
        row = {
            "seed": seed,
            "processor_seconds": time.process_time() - used,
            "converged": converged,
            "failures": done.failures,
            "overall_F": {
                name: [one._asdict() for one in overall_F(result)]
                for name, result in done.results.items()
                if name in CASES
            },
            "claims": done.claims,
        }
        rows.append(plain(row))
        if log is not None:
            with log.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
        if seed == seeds[0]:
            first = {name: as_numbers(one, TABLES.get(name)) for name, one in done.results.items()}
            first = {"cases": first, "Cm over alpha": curves(done.results)}
            first |= {"examples": done.examples}
            if not as_json:
                _print_tables(done)
        show(verdict_lines(verdicts(claims)))
        release_compiled_programs_if_needed()
    judged = verdicts(claims)
    if as_json:
        output = {"status": "converged" if fine else "not converged", "seeds": list(seeds)}
        output |= {"seconds": time.perf_counter() - begin, **first, "rows": rows}
        print(json.dumps(plain(output | {"verdicts": judged})))
    else:
        print(verdict_lines(judged))
        print(f"\nSeeds {seeds[0]} to {seeds[-1]}, {time.perf_counter() - begin:.0f} s.")
    return 0 if fine else 1


def _print_tables(done: Seed) -> None:
    for name, result in done.results.items():
        print(case_table(result, TABLES.get(name)) + "\n")
    if done.examples:
        print(example_table(done.examples.values()) + "\n")
    print(F_table(done.results) + "\n")
    for totals in (True, False):
        print(error_table(done.results, totals) + "\n")


if __name__ == "__main__":
    sys.exit(main())
