"""Detection of missing effects by the loop: `python -m benchmarks.missing_effects
[--json] [--systems spring,ship] [--harder] [--log FILE]`.
"""

import argparse
import itertools
import json
import multiprocessing
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import jax

from benchmarks.missing_effects.judge import goals, rows
from benchmarks.missing_effects.measure import measure_by_name, system_of
from benchmarks.missing_effects.scenarios import Scenario, System
from benchmarks.missing_effects.table import text

SYSTEMS = ("spring", "longitudinal", "ship")
Task = tuple[System, Scenario, int, bool]


def tasks(systems: list[System], options: argparse.Namespace) -> Iterator[Task]:
    """Yield all requested studies.

    Seeds are the outer loop, so that an interrupted run has studies of every scenario.
    """
    for system in systems:
        chosen = [
            one
            for one in system.scenarios
            if not options.scenarios or one.name in options.scenarios
        ]
        for seed in range(options.seeds):
            for one in chosen:
                yield system, one, seed, False
                if one.planted and not options.no_removed:
                    yield system, one, seed, True
    yield from _controls(systems, options)


def _controls(systems: list[System], options: argparse.Namespace) -> Iterator[Task]:
    """Yield further control studies, in turn over the cheap systems, with new seeds."""
    kinds = [
        [
            (system, one)
            for one in system.scenarios
            if one.kind == "control" and _wanted(one, options)
        ]
        for system in systems
        if system.cheap
    ]
    everywhere = [
        pair for group in itertools.zip_longest(*kinds) for pair in group if pair is not None
    ]
    total = sum(
        1
        for system in systems
        for one in system.scenarios
        if one.kind == "control" and _wanted(one, options)
    )
    for number in range(max(options.controls - total * options.seeds, 0) if everywhere else 0):
        system, one = everywhere[number % len(everywhere)]
        yield system, one, options.seeds + number // len(everywhere), False


def _wanted(one: Scenario, options: argparse.Namespace) -> bool:
    return not options.scenarios or one.name in options.scenarios


def key_of(one: dict[str, Any]) -> tuple:
    """Return the key that identifies a study."""
    return one["system"], one["scenario"], one["seed"], one["removed"]


def logged(log: Path | None) -> list[dict[str, Any]]:
    """Return the studies of a log; an incomplete last line is left out."""
    lines = log.read_text().splitlines() if log and log.exists() else []
    return [json.loads(line) for line in lines if line.endswith("}")]


def measured(keys: list[tuple], *, harder: bool, workers: int) -> Iterator[dict[str, Any]]:
    """Yield the results of each study when it ends; several processes end them in any order."""
    if workers == 1:
        yield from (measure_by_name(*key, harder) for key in keys)
        return
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        futures = [pool.submit(measure_by_name, *key, harder) for key in keys]
        yield from (future.result() for future in as_completed(futures))


def run(options: argparse.Namespace) -> list[dict[str, Any]]:
    """Run all studies that the log does not hold yet, system by system."""
    log = Path(options.log) if options.log else None
    results = {key_of(one): one for one in logged(log)}
    systems = [system_of(name, harder=options.harder) for name in options.systems]
    wanted = sorted(tasks(systems, options), key=lambda task: options.systems.index(task[0].name))
    keys = [(system.name, one.name, seed, removed) for system, one, seed, removed in wanted]
    left = [key for key in keys if key not in results]
    begin = time.perf_counter()
    studies = measured(left, harder=options.harder, workers=options.workers)
    for number, result in enumerate(studies, 1 + len(keys) - len(left)):
        results[key_of(result)] = result
        summary = result["failed"] or f"{result['outcome']}: {', '.join(result['effects']) or '-'}"
        print(
            f"{number}/{len(keys)} {time.perf_counter() - begin:.0f} s, {result['system']}, "
            f"{result['scenario']}{', removed' if result['removed'] else ''}, "
            f"seed {result['seed']}: {summary}",
            file=sys.stderr,
            flush=True,
        )
        if log:
            with log.open("a") as file:
                file.write(json.dumps(result) + "\n")
    return [results[key] for key in keys]


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return 0 if no study failed."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.missing_effects", description=__doc__.splitlines()[0]
    )

    def names(value: str) -> list[str]:
        return value.split(",")

    parser.add_argument(
        "--json", action="store_true", help="print one JSON object and nothing else"
    )
    parser.add_argument("--seeds", type=int, default=10, help="of each scenario (default: 10)")
    parser.add_argument(
        "--systems", type=names, default=list(SYSTEMS), help=f"(default: {','.join(SYSTEMS)})"
    )
    parser.add_argument("--scenarios", nargs="+", metavar="NAME", help="only these (default: all)")
    parser.add_argument(
        "--controls", type=int, default=500, help="control studies in all (default: 500)"
    )
    parser.add_argument(
        "--harder",
        action="store_true",
        help="only the harder truths, drawn at random for each seed, without controls",
    )
    parser.add_argument(
        "--no-removed",
        action="store_true",
        help="skip studies without the effect in the library",
    )
    parser.add_argument(
        "--log", metavar="FILE", help="append each study here, and skip those that it holds"
    )
    parser.add_argument("--workers", type=int, default=1, help="processes (default: 1)")
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    begin = time.perf_counter()
    results = run(options)
    if options.json:
        status = "measured" if not any(one["failed"] for one in results) else "some studies failed"
        output = {
            "status": status,
            "seconds": time.perf_counter() - begin,
            "goals": [one._asdict() | {"interval": one.share.interval} for one in goals(results)],
            "scenarios": [one._asdict() for one in rows(results)],
            "studies": results,
        }
        print(json.dumps(output))
    else:
        print(text(results))
    return int(any(one["failed"] for one in results))


if __name__ == "__main__":
    sys.exit(main())
