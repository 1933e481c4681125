"""The loop on flights of two aircraft of DLR: `python -m benchmarks.flight_records --data FOLDER
[--json] [--cases stall,elevator]`.

Each case declares the model that `identify` finds in one flight, and closes the loop on this flight
with the default library and options. Errors are RMS of the simulation of another flight, or of a
later part, which takes no part in any decision. The files come with a book (`ORIGIN`) and are not
part of the project: a case without its files is reported as skipped.
"""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jaxid
from benchmarks.command_line import add_json, print_rows, report_progress, requested
from jaxid import OutputError, Record, Study, close_loop, identify
from jaxid._foundation.checks import InputError
from jaxid.aircraft import (
    SMALL_MOTION,
    ConstantThrust,
    Engine,
    IdentificationModel,
    Instruments,
    model_of,
)
from jaxid.data import ATTAS, ATTAS_STALL, HFB320, read_columns, segment, split_at
from jaxid.data.io.layouts import Columns
from jaxid.study import LONG_RECORDS, IdentifyOptions

ORIGIN = (
    "R. V. Jategaonkar, Flight Vehicle System Identification: A Time Domain Methodology, 2nd ed., "
    "AIAA 2015: its flight data, at arc.aiaa.org/doi/suppl/10.2514/4.102790, with the masses and "
    "positions of its programs umr_reg_attas and umr_reg_hfb."
)
SURFACES = ("stabilator", "aileron", "rudder", "thrust")
WINDOW = 25  # samples in which the initial state of a test record is fitted: 1 s of ATTAS
# ATTAS: accelerometers 1 m behind the centre of gravity, vanes at the noseboom.
ATTAS_SIZE = {
    "mass": 17631.0,
    "Ix": 133367.0,
    "Iy": 252687.0,
    "Iz": 359593.0,
    "Ixz": 11442.0,
    "S": 64.0,
    "b": 21.5,
    "cbar": 3.159,
}
ATTAS_INSTRUMENTS = Instruments(
    position=dict.fromkeys(("alpha", "beta"), (13.08, 0.0, 0.0))
    | dict.fromkeys(("ax", "ay", "az"), (-1.01, 0.886, 0.103))
)
HFB_SIZE = {"mass": 7472.0, "Iy": 91420.0, "S": 30.1, "b": 14.5, "cbar": 2.43}
HFB_ENGINES = (Engine(ConstantThrust(0.0), position=(-1.343, 0.0, -0.652), up=0.0524),)
# A slow stall shows little of the pitching moment: without Cm the measured pitch rate is an input.
# Over minutes an open-loop motion drifts, so that the records are in pieces.
STALL_TERMS = {"CX": ("alpha", "alpha^2"), "CZ": ("alpha", "qhat", "stabilator")}
STALL_PIECES = 20.0  # [s]
# Samples of the ailerons in `fAttasAilRud*`; the rudder follows after 30 s that are left out.
AILERONS = 751


class Flights(NamedTuple):
    """An identification model, and the flights to identify it from and to predict."""

    model: IdentificationModel
    train: tuple[Record, ...]
    test: tuple[Record, ...]
    options: IdentifyOptions = LONG_RECORDS


def _read(folder: Path, file: str, layout: Columns, leave_out: tuple[str, ...] = ()) -> Record:
    inputs = tuple(name for name in SURFACES if name not in leave_out)
    outputs = tuple(name for name in layout if name not in ("t", *SURFACES, *leave_out))
    return read_columns(folder / file, layout, inputs=inputs, outputs=outputs)


def stall(folder: Path) -> Flights:
    """Two quasi-steady stalls of ATTAS, to 16 deg."""
    lateral = ("aileron", "rudder", "ay", "p", "r", "phi", "psi", "beta", "pdot", "rdot", "mach")
    first, second = (
        _read(folder, f"fAttas_qst0{number}.asc", ATTAS_STALL, lateral) for number in (1, 2)
    )
    model = model_of(
        first,
        **ATTAS_SIZE,
        states="longitudinal",
        held={"aileron": 0.0, "rudder": 0.0},
        candidates=STALL_TERMS,
    )
    terms = IdentifyOptions(terms=STALL_TERMS, keep=tuple(STALL_TERMS), share=0.0)
    train, test = (segment(record, STALL_PIECES) for record in (first, second))
    return Flights(model.without(("Cm",)), train, test, terms)


def elevator(folder: Path) -> Flights:
    """Elevator manoeuvre of ATTAS, and its repeat."""
    train, test = _attas(folder, "fAttasElv")
    return Flights(_attas_model(train, "longitudinal"), (train,), (test,))


def ailerons(folder: Path) -> Flights:
    """Ailerons, then rudder of ATTAS, and the repeat."""
    train, test = (split_at(both, AILERONS) for both in _attas(folder, "fAttasAilRud"))
    return Flights(_attas_model(train[0], "lateral"), train, test)


def _attas(folder: Path, name: str) -> tuple[Record, ...]:
    """Return both records of a manoeuvre of ATTAS."""
    files = (f"{name}{number}.mat" for number in (1, 2))
    return tuple(_read(folder, file, ATTAS, ("psi", "mach")) for file in files)


def _attas_model(record: Record, states: str) -> IdentificationModel:
    """Return the model of ATTAS, with the channels of a record."""
    options = {"states": states, "candidates": SMALL_MOTION, "instruments": ATTAS_INSTRUMENTS}
    return model_of(record, **ATTAS_SIZE, **options)


def pulse(folder: Path) -> Flights:
    """HFB-320: the 3-2-1-1 of the elevator, and the long pulse after it."""
    record = _read(folder, "hfb320_1_10.asc", HFB320)
    model = model_of(
        record, **HFB_SIZE, engines=HFB_ENGINES, states="longitudinal", candidates=SMALL_MOTION
    )
    train, test = split_at(record, 231)  # the pulse begins at 25 s
    return Flights(model, (train,), (test,))


CASES: dict[str, Callable[[Path], Flights]] = {
    "stall": stall,
    "elevator": elevator,
    "ailerons": ailerons,
    "pulse": pulse,
}


def measure(name: str, folder: Path, report: Callable[[str], None]) -> dict[str, Any]:
    """Run the loop on one case; return its row, or the reason why it is skipped."""
    start = time.perf_counter()
    try:
        flights = CASES[name](folder)
    except InputError as missing:
        return {"case": name, "status": "skipped", "why": str(missing)}
    found = identify(flights.model, list(flights.train), options=flights.options)
    likelihood = OutputError()
    study = close_loop(
        found.model,
        found.estimate.free,
        likelihood,
        train=[found.model.prepared(record) for record in flights.train],
        test=[found.model.prepared(record) for record in flights.test],
        window=WINDOW,
        progress=lambda words: report(f"{time.perf_counter() - start:6.0f} s  {name}: {words}"),
    )
    return row(name, study) | {"seconds": round(time.perf_counter() - start, 1)}


def row(name: str, study: Study) -> dict[str, Any]:
    """Return the reported numbers of one study."""
    summary = study.to_dict()
    return {
        "case": name,
        "status": "measured",
        "flights": (CASES[name].__doc__ or "").rstrip("."),
        "before": study.before.rms,
        "after": study.after.rms,
        "outcome": study.outcome.value,
        "verdict": study.verdict,
        "effects": summary["effects"],
        "parameters": summary["parameters"],
    }


def table(rows: list[dict[str, Any]]) -> str:
    """Return the errors of each case as a text table, with its effects and its verdict."""
    lines = [ORIGIN]
    for one in rows:
        if one["status"] == "skipped":
            lines += ["", f"{one['case']} skipped: {one['why']}"]
            continue
        lines += ["", f"{one['case']}: {one['flights']}; {one['outcome']}; {one['seconds']:.0f} s"]
        lines += [f"    {one['verdict']}", f"    {'channel':<10} {'before':>10} {'after':>10}"]
        for record, errors in one["before"].items():
            lines += [
                f"    {channel:<10} {error:>10.4g} {one['after'][record][channel]:>10.4g}"
                for channel, error in errors.items()
            ]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; return 0."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.flight_records", description="The loop on flights of DLR."
    )
    add_json(parser)
    parser.add_argument(
        "--cases", default=",".join(CASES), help=f"which, of {', '.join(CASES)} (default: all)"
    )
    parser.add_argument(
        "--data", metavar="FOLDER", required=True, help="where the book's files are"
    )
    options = parser.parse_args(arguments)
    names = requested(parser, options.cases, CASES, "case")
    jaxid.configure()
    rows = [measure(name, Path(options.data), report_progress) for name in names]
    print_rows(rows, ORIGIN, table, options.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
