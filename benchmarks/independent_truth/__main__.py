"""The loop on records of another simulator: `python -m benchmarks.independent_truth [--json]
[--systems NAME ...] [--log FILE]`.

Fourteen systems that an engineer logs, each simulated by SciPy alone with something that its
declared model lacks, or with nothing: loads, lags, stall, a late sensor, resistance, a hidden tank,
waves, and effects that the library lacks. Library and options are the defaults. Three records are
fitted, one decides, one is reported.
"""

import argparse
import json
import resource
import time
from pathlib import Path
from typing import Any

from jaxid import OutputError, close_loop, configure, free, hold
from jaxid.effects.augmented import split_effects

from .judge import Verdict, judge
from .systems import RECORDS, SYSTEMS, System

WINDOW = 20  # samples from which the initial state of a record is fitted (chosen)


def studied(system: System) -> dict[str, Any]:
    """Return the answer to the study of a system, as plain numbers and words."""
    records = [system.measure(number) for number in range(RECORDS)]
    chosen = free(system.model, *system.free, per_record=("initial_state",))
    likelihood = OutputError(hold=hold.ZeroOrder()) if system.held else OutputError()
    begin = time.process_time()
    study = close_loop(
        system.model,
        chosen,
        likelihood,
        train=records[:3],
        check=records[3],
        test=records[4],
        window=WINDOW,
        progress=False,
    )
    families = [effect.card.family for effect in split_effects(study.after.model)[1]]
    return {
        "system": system.name,
        "truth": system.truth,
        "answer": system.answer.name,
        "outcome": study.outcome.value,
        "effects": list(study.effects),
        "verdict": study.verdict,
        "judgement": judge(system, study.outcome, families).name,
        "cpu_s": time.process_time() - begin,
        "peak_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def main() -> None:
    """Study the systems, each printed as soon as it ends."""
    parser = argparse.ArgumentParser("python -m benchmarks.independent_truth", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    names = [system.name for system in SYSTEMS]
    parser.add_argument("--systems", nargs="+", choices=names, default=names, metavar="NAME")
    parser.add_argument("--log", type=Path, help="append each study here")
    options = parser.parse_args()
    configure()
    rows = []
    for system in (one for one in SYSTEMS if one.name in options.systems):
        row = studied(system)
        rows.append(row)
        if options.log:
            with options.log.open("a") as file:
                file.write(json.dumps(row) + "\n")
        if not options.json:
            found = ", ".join(row["effects"]) or "no effect"
            print(
                f"{row['judgement']:<6} {row['cpu_s']:4.0f} s  {system.name} ({system.truth}): "
                f"{row['outcome']}: {found}",
                flush=True,
            )
    counts = {v.name: sum(row["judgement"] == v.name for row in rows) for v in Verdict}
    print(json.dumps({"counts": counts, "rows": rows}) if options.json else counts)


if __name__ == "__main__":
    main()
