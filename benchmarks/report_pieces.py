"""Ten-second pieces of the report's flights through `identify`.

`python -m benchmarks.report_pieces [--json] [--seed 0] [--log FILE]`. Exit status 0 if each piece
ends in an estimate with finite errors or in a refusal that names the cause.

The eight flights of `jaxid.aircraft.flight.report_cases` are flown for 20 s, periodic inputs going
on, and cut into windows of 10 s that start at 0, 5 and 10 s: pieces in which the inputs of the
first seconds may be over. Each is identified with the setting of its case and the defaults of
`identify`.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks.report_tables.cases import SOLVER, fly_case, model_of, record_of
from benchmarks.report_tables.settings import SETTINGS
from jaxid._foundation.checks import InputError
from jaxid.aircraft.flight.report_cases import CASES, REPORT_SAMPLE_TIME
from jaxid.study import IdentifyOptions, identify

FLOWN, LENGTH, STARTS = 20.0, 10.0, (0.0, 5.0, 10.0)  # s
CAUSE = "No equation is left: "  # of a refusal, followed by the reason of each equation


@dataclass(frozen=True)
class Outcome:
    """Result of `identify` for one piece.

    Attributes:
        case: name of the flight.
        start: first time of the piece in the flight [s].
        alpha, beta: range of the measured angles [deg].
        status: status of the estimate; "refused" for an error.
        kept: terms of each equation that is kept, by response.
        left_out: reason for each equation that is left out, by response.
        reduced: reason and limits of a reduced structure; empty for the terms as selected.
        finite: True if all estimated values and their standard errors are finite, but for errors of
            parameters that the result calls undetermined.
        undetermined: parameters of infinite standard error that the result calls undetermined.
        message: message of a refusal; empty for an estimate.
    """

    case: str
    start: float
    alpha: tuple[float, float]
    beta: tuple[float, float]
    status: str
    kept: dict[str, tuple[str, ...]]
    left_out: dict[str, str]
    reduced: str
    finite: bool
    undetermined: tuple[str, ...]
    message: str

    @property
    def passes(self) -> bool:
        """True for a finite estimate, and for a refusal because no equation is explained."""
        return self.finite or self.message.startswith(CAUSE)


def pieces(
    cases: Sequence[str] = tuple(CASES), starts: Sequence[float] = STARTS, seed: int = 0
) -> Iterator[Outcome]:
    """Yield the outcome of `identify` for each piece.

    Args:
        cases: names of the flights.
        starts: first times of the pieces in the flight [s].
        seed: seed of the instruments' errors, the noise and the gusts.
    """
    rows = round(LENGTH / REPORT_SAMPLE_TIME)
    for case in cases:
        flown, setting = fly_case(case, seed, FLOWN), SETTINGS[case]
        model, record = model_of(flown, setting), record_of(flown, setting)
        for start in starts:
            first = round(start / REPORT_SAMPLE_TIME)
            yield outcome(case, start, model, record.window(first, first + rows))


def outcome(case: str, start: float, model, record) -> Outcome:
    """Return the outcome of `identify` for one record, with the setting of a case."""
    setting = SETTINGS[case]
    alpha, beta = (_range_deg(record.channel(name)) for name in ("alpha", "beta"))
    try:
        result = identify(
            model,
            record,
            options=IdentifyOptions(add=setting.add, leave_out=setting.leave_out),
            per_record=tuple(f"initial_state.{state}" for state in setting.initial),
            solver=SOLVER,
        )
    except InputError as error:
        return Outcome(case, start, alpha, beta, "refused", {}, {}, "", False, (), str(error))
    fit = result.estimate
    undetermined = tuple(
        name
        for name, error in zip(fit.names, np.asarray(fit.standard_errors), strict=True)
        if np.isinf(error) and any(name in words for words in fit.weak_directions)
    )
    known = np.array([name not in undetermined for name in fit.names])
    numbers = np.concatenate([fit.values, np.asarray(fit.standard_errors)[known]])
    return Outcome(
        case,
        start,
        alpha,
        beta,
        fit.status,
        {name: one.regression.names for name, one in result.equations.items() if one.kept},
        {name: one.reason for name, one in result.equations.items() if not one.kept},
        result.reduced,
        bool(np.isfinite(numbers).all()),
        undetermined,
        "",
    )


def _range_deg(angle) -> tuple[float, float]:
    """Return least and largest value of an angle, to a tenth [deg]."""
    degrees = np.degrees(np.asarray(angle))
    return round(float(np.min(degrees)), 1), round(float(np.max(degrees)), 1)


def row(result: Outcome) -> str:
    """Return one line of the table."""
    kept = ", ".join(f"{name} ({len(terms)})" for name, terms in result.kept.items())
    words = ", ".join((*result.undetermined, result.message or result.reduced))
    ranges = "  ".join(f"{low:6.1f} to {high:5.1f}" for low, high in (result.alpha, result.beta))
    status = result.status.split(".")[0]
    return f"{result.case:<15} {result.start:>4g}  {ranges}  {status}; {kept}; {words}"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=Path, help="file for one JSON line a piece, as it ends")
    options = parser.parse_args(arguments)
    results = []
    for result in pieces(seed=options.seed):
        results.append(result)
        line = json.dumps(asdict(result) | {"passes": result.passes})
        if options.log:
            with options.log.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        if not options.json:
            print(row(result), flush=True)
    passed = all(result.passes for result in results)
    if options.json:
        print(json.dumps({"pieces": [asdict(one) for one in results], "passes": passed}))
    return 0 if passed else 1


if __name__ == "__main__":
    import jaxid

    jaxid.configure()
    sys.exit(main())
