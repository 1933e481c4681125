"""Command line: find the effect that a model lacks, add it, and report the errors; select terms;
estimate many records; design the next one.
"""

import dataclasses
import sys
from collections.abc import Callable, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import jax
import typer
from rich.console import Console
from rich.text import Text

from ._foundation.checks import InputError, require
from ._foundation.configuration import configure
from ._foundation.types import Array
from .aircraft import model_of
from .aircraft.flight.coupled_flight import coupled_flight
from .aircraft.flight.longitudinal_flight import longitudinal_flight
from .aircraft.flight.simulated_flight import SimulatedFlight, realised_noise
from .batches import estimate_many, summary
from .batches.parts import Part
from .data.io.csv import require_csv_names
from .data.io.study import read_study
from .estimation import OutputError, estimate
from .measured import emps, silverbox, tanks

try:
    from .report import (
        Written,
        require_new,
        require_writable,
        write_design,
        write_json,
        write_or_elsewhere,
        write_study,
    )
except ModuleNotFoundError as missing:
    package = str(missing.name).partition(".")[0]
    if package not in ("matplotlib", "jinja2"):
        raise
    print(
        f"jaxid: the report needs {package}. Install it: pip install 'jaxid[report]'",
        file=sys.stderr,
    )
    raise SystemExit(2) from None
from .report.progress import show_progress
from .study import Study, close_loop, next_record
from .study.candidates import candidate_table
from .study.design_from_file import design_section, informative_input
from .study.from_file import Case, case_of
from .study.identify_from_file import identified
from .study.model_from_file import BuiltIn

app = typer.Typer(add_completion=False, no_args_is_help=False, pretty_exceptions_enable=False)
console = Console(stderr=True)

# The arguments of `aircraft.model_of` that a study file may set: all that TOML can express.
SETTINGS = ("mass", "Ix", "Iy", "Iz", "Ixz", "S", "b", "cbar", "reference", "force_axes")
SETTINGS += ("instruments", "check", "states", "frame", "measured", "held")
BUILT_IN = {"aircraft": BuiltIn(model_of, (*SETTINGS, "outputs", "airspeed", "beta"))}
# Samples, two seconds, from which the initial state of a flight is fitted (chosen).
FLIGHT_WINDOW = 50
# Folder of the report, in the current folder.
STUDY_FOLDER = Path("jaxid-study")
DESIGN_FOLDER = Path("jaxid-design")


class Set(StrEnum):
    """The measured sets that have a declared model."""

    silverbox = "silverbox"
    emps = "emps"
    tanks = "tanks"


StudyPath = Annotated[
    Path,
    typer.Argument(metavar="STUDY.toml", help="The study file; docs/study_file.md has its keys."),
]
Json = Annotated[
    Path | None,
    typer.Option("--json", help="Also write the results to this JSON file, which must not exist."),
]
Out = Annotated[
    Path | None,
    typer.Option(
        help="Folder for the report, which must not exist; by default a new jaxid-study "
        "folder here."
    ),
]


Seed = Annotated[int, typer.Option(help="Seed of the measurement noise.")]


@app.callback(invoke_without_command=True)
def flight(
    context: typer.Context,
    json: Json = None,
    out: Out = None,
    seed: Seed = 0,
) -> None:
    """Find the effect that a model lacks, add it, and report the error before and after on records
    that were not used.

    Without a command: an embedded simulated flight of an F-4-like aircraft in six degrees of
    freedom, with look-up tables, noise and an undeclared effect in it.
    """
    if context.invoked_subcommand is None:
        _fly(coupled_flight, seed, json, out)
        return
    sources = {name: context.get_parameter_source(name) for name in context.params}
    early = [f"--{name}" for name, source in sources.items() if source and source.name != "DEFAULT"]
    if early:
        raise InputError(
            f"{early[0]} stands before {context.invoked_subcommand!r} and would have no effect. "
            "Write it after the command."
        )


@app.command()
def longitudinal(json: Json = None, out: Out = None, seed: Seed = 0) -> None:
    """Find the missing effect of a smaller model, an aircraft in its plane of symmetry.

    It takes a third of the time of the default flight.
    """
    _fly(longitudinal_flight, seed, json, out)


def _fly(
    make: Callable[[Array], SimulatedFlight], seed: int, json: Path | None, out: Path | None
) -> None:
    """Close the loop on a simulated flight, whose noise is known."""
    _require_output(json, out)
    with show_progress(console) as progress:
        progress("simulated flight")
        case = make(jax.random.key(seed))
        study = close_loop(
            case.model,
            case.free,
            OutputError(),
            train=case.train,
            check=case.check,
            test=case.test,
            window=FLIGHT_WINDOW,
            progress=progress,
        )
    noise = realised_noise(case, case.test, skip=FLIGHT_WINDOW)
    study = dataclasses.replace(
        study, noise=dict(zip(study.outputs, map(float, noise), strict=True))
    )
    _deliver(study, "A simulated flight with an undeclared effect", json, out)


@app.command()
def dataset(
    name: Annotated[Set, typer.Argument(help="Which measured set.")],
    path: Annotated[
        Path | None, typer.Argument(help="Its file or folder; by default the variable JAXID_DATA.")
    ] = None,
    json: Json = None,
    out: Out = None,
) -> None:
    """Find the effects that a simple physical model of a measured data set lacks."""
    _require_output(json, out)
    with show_progress(console) as progress:
        progress("reading")
        case = {Set.silverbox: silverbox, Set.emps: emps, Set.tanks: tanks}[name](path)
        study = close_loop(**case.parts, progress=progress)
    _deliver(study, f"{case.data.name}: {case.data.citation}", json, out)


@app.command("close-loop")
def study_file(
    path: StudyPath,
    json: Json = None,
    out: Out = None,
    list_candidates: Annotated[
        bool, typer.Option("--candidates", help="List the candidate effects, and end.")
    ] = False,
) -> None:
    """Find the effects that your own model lacks; a study file names the model and the records."""
    require(
        not list_candidates or (json is None and out is None),
        "--candidates writes no file. Leave --json and --out out.",
    )
    _require_output(json, out)
    with show_progress(console) as progress:
        progress("reading")
        file = read_study(path)
        case = case_of(file, BUILT_IN, progress)
        if list_candidates:
            print("\n".join(candidate_table(case.library).lines()))
            return
        study = _study_of(case, progress)
    _deliver(study, file.title, json, out, (path, *file.files))


def _study_of(case: Case, progress: Callable[[str], None]) -> Study:
    """Close the loop on the case of a study file."""
    return close_loop(
        case.model,
        case.free,
        case.likelihood,
        train=case.train,
        check=case.check,
        test=case.test,
        effects=case.effects,
        window=case.window,
        options=case.options,
        progress=progress,
    )


@app.command("identify")
def identify_file(
    path: StudyPath,
    json: Json = None,
    weak_radius: Annotated[
        float | None,
        typer.Option(
            help="Regress integrals over test functions of this half length [s], in place of "
            "samples and their derivatives."
        ),
    ] = None,
) -> None:
    """Select the terms of a study file's model by regression; estimate them by maximum likelihood.

    Parameters in [free] and the sections for checks, tests, candidates and the loop have no effect.
    """
    if json is not None:
        _require_output(json, None)
    with show_progress(console) as progress:
        progress("reading")
        file = read_study(path)
        result = identified(file, BUILT_IN, weak_radius=weak_radius, progress=progress)
    print(result)
    if json is not None:
        _require_written(write_or_elsewhere(lambda path: write_json(result, path), json))


@app.command()
def batch(
    path: StudyPath,
    store: Annotated[
        Path | None,
        typer.Option(help="Zarr store of the results, by default STUDY.zarr here; continued."),
    ] = None,
    part: Annotated[
        str,
        typer.Option(
            help="Number of this process, from zero, and of all processes that share the store."
        ),
    ] = "0/1",
) -> None:
    """Estimate every training record of a study file by itself, in one call that can be continued.

    The sections for checks, tests and candidates of the file have no effect here.
    """
    with show_progress(console) as progress:
        progress("reading")
        case = case_of(read_study(path), BUILT_IN, progress)
        devices = jax.local_devices()
        results = estimate_many(
            case.model,
            case.free,
            case.train,
            case.likelihood,
            store=store or Path(f"{path.stem}.zarr"),
            part=Part.read(part),
            devices=devices if len(devices) > 1 else None,
            progress=lambda state: progress(state.words),
        )
    print(summary(results))


@app.command()
def design(
    path: Annotated[
        Path,
        typer.Argument(
            metavar="STUDY.toml",
            help="The study file, with a section [design]; docs/study_file.md.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the record to fly, new; by default jaxid-design here."),
    ] = None,
    after_loop: Annotated[
        bool,
        typer.Option(
            "--after-loop",
            help="Close the loop first; design the record that separates its explanations.",
        ),
    ] = False,
) -> None:
    """Design the next record: the declared model is estimated from the training records, and the
    input that then shows its parameters best is written as CSV with a figure.
    """
    folder = out or DESIGN_FOLDER
    require_new(folder)
    require_writable(folder)
    with show_progress(console) as progress:
        progress("reading")
        file = read_study(path)
        case = case_of(file, BUILT_IN, progress)
        section = design_section(file, case.model)
        with file.at("model"):
            require_csv_names((*case.model.inputs, *case.model.outputs))
        if after_loop:
            study = _study_of(case, progress)
            progress("design")
            result = next_record(study, section.t, section.limits, **section.options)
        else:
            progress("estimate of the declared model")
            fit = estimate(case.model, case.free, case.train, case.likelihood)
            progress("design")
            result = informative_input(fit, case.likelihood, section)
    print(result)
    written = write_or_elsewhere(lambda path: write_design(result, path), folder)
    print(f"\nThe record to fly is {written.path / 'design.csv'}")
    _require_written(written)


def _require_output(json: Path | None, out: Path | None) -> None:
    """Check before the long run that no output path exists, and that each can be created."""
    for path in (json, out):
        if path is not None:
            require_new(path)
    if json is not None and not json.absolute().parent.is_dir():
        raise InputError(
            f"There is no folder {str(json.absolute().parent)!r} for {json.name!r}. Make it first."
        )
    for path in (json, out or STUDY_FOLDER):
        if path is not None:
            require_writable(path)


def _deliver(
    study: Study, title: str, json: Path | None, out: Path | None, files: Sequence[Path] = ()
) -> None:
    """Print the study, and write its page, its figures and, if requested, its JSON; the page states
    the SHA-256 of the files that were read.

    Where a path can no longer be written, the results are saved elsewhere, the place is printed,
    and the exit status is 1.
    """
    print(study)
    exist = "refuse" if out else "number"
    report = write_or_elsewhere(
        lambda path: write_study(study, path, title, exist=exist, files=files), out or STUDY_FOLDER
    )
    results = [report]
    if json is not None:
        results.append(write_or_elsewhere(lambda path: write_json(study, path), json))
    print(f"\nThe report is {report.path / 'study.html'}")
    _require_written(*results)


def _require_written(*results: Written) -> None:
    """Print the places of results that were saved elsewhere; end with status 1 if there are any."""
    moved = [result for result in results if result.error is not None]
    for result in moved:
        _print_error(f"{result.error} The results are saved in {str(result.path)!r}.")
    if moved:
        raise SystemExit(1)


def _print_error(message: str) -> None:
    """Print one message on standard error; brackets in it are no markup."""
    console.print(
        Text.assemble(("jaxid:", "bold red"), " ", message), soft_wrap=True, highlight=False
    )


def main() -> None:
    """Run the command line; invalid input gives one message instead of a traceback."""
    try:
        configure()
        app()
    except InputError as error:
        _print_error(str(error))
        raise SystemExit(2) from None
    except OSError as error:
        _print_error(f"{error}. Check the file, its folder and their rights.")
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
