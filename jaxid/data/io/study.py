"""Study files: TOML with a model, its free parameters, CSV records and options of the loop."""

import itertools
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from ..._foundation.checks import InputError, require, require_known
from ..build import TIME
from ..record import Record
from ..smoothing.fourier import Fourier
from ..smoothing.smooth import differentiate
from ..stack import segment
from ..titles import UnclearUnitError
from .assemble import existing
from .csv import read_csv
from .mat import read_mat


class StudyFile(NamedTuple):
    """Content of a study file, with checked keys and with the records read.

    Attributes:
        path: the file.
        title: title of the report.
        model: the section [model]: the model to use, its parameters or settings.
        free: the section [free].
        train: records to fit.
        check: records that decide which effects are kept; None if the file has none.
        test: records that are only reported, by name of set; None if the file has none.
        files: the files of the records.
        noise: known standard deviations by output, numbers in SI or texts such as "0.05 deg".
        loop: the section [loop].
        library: the section [library].
        design: the section [design].
        identify: the section [identify].
    """

    path: Path
    title: str
    model: dict[str, Any]
    free: dict[str, Any]
    train: tuple[Record, ...]
    check: tuple[Record, ...] | None
    test: dict[str, tuple[Record, ...]] | None
    files: tuple[Path, ...]
    noise: dict[str, float | str]
    loop: dict[str, Any]
    library: dict[str, Any]
    design: dict[str, Any]
    identify: dict[str, Any]

    def at(self, section: str, key: str = ""):
        """Return a context whose error messages name this file, the section and the key."""
        return within(self.path, section, key)


class Kind(NamedTuple):
    """Kind of value that a key accepts.

    Attributes:
        words: description, used in error messages.
        example: an example in TOML.
        fits: function that returns True for an accepted value.
    """

    words: str
    example: str
    fits: Callable[[Any], bool]


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_number(value: Any) -> bool:
    """True for a number that a float can hold; TOML integers have no limit."""
    if isinstance(value, int):
        return not isinstance(value, bool) and abs(value) <= sys.float_info.max
    return isinstance(value, float)


def _list_of(fits: Callable[[Any], bool], count: int | None = None) -> Callable[[Any], bool]:
    return lambda value: (
        isinstance(value, list) and all(map(fits, value)) and count in (None, len(value))
    )


def _table_of(fits: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, dict) and all(map(fits, value.values()))


TEXT = Kind("a text", '"x"', _is_text)
TEXTS = Kind("a list of texts", '["x", "y"]', _list_of(_is_text))
FILES = Kind(
    "a list of files",
    '["first.csv", "second.csv"]',
    lambda value: TEXTS.fits(value) and len(value) > 0,
)
SETS = Kind(
    "a list of files, or a table of such lists",
    '{ slow = ["first.csv"], fast = ["second.csv"] }',
    lambda value: FILES.fits(value) or (_table_of(FILES.fits)(value) and len(value) > 0),
)
TEXT_BY_NAME = Kind("a table of texts", '{ x = "mm" }', _table_of(_is_text))
TEXTS_BY_NAME = Kind(
    "a table of lists of texts", '{ Cm = ["alpha", "qhat"] }', _table_of(TEXTS.fits)
)
NUMBER = Kind("a number", "0.5", _is_number)
LINES = Kind("a number of lines", "2", lambda value: type(value) is int and value >= 0)
LAYOUT_TEXT = Kind(
    "a text, or a table of texts by file",
    '{ "first.csv" = ";" }',
    lambda value: _is_text(value) or _table_of(_is_text)(value),
)
LAYOUT_LINES = Kind(
    "a number of lines, or a table of such numbers by file",
    '{ "first.csv" = 2 }',
    lambda value: LINES.fits(value) or _table_of(LINES.fits)(value),
)
COUNT = Kind("a whole number, at least 1", "2", lambda value: type(value) is int and value >= 1)
NUMBERS_BY_NAME = Kind("a table of numbers", "{ mass = 12.0 }", _table_of(_is_number))
BOUNDS = Kind("a table of pairs", "{ k = [0.0, inf] }", _table_of(_list_of(_is_number, 2)))
SWITCH = Kind("true or false", "true", lambda value: isinstance(value, bool))
ANY_TABLE = Kind("a table", "{ k = 1.0 }", lambda value: isinstance(value, dict))
DEVIATION = Kind(
    "a number in SI, or a number with its unit",
    '"0.05 deg"',
    lambda value: _is_number(value) or (_is_text(value) and len(value.split(maxsplit=1)) == 2),
)

SECTIONS: dict[str, dict[str, Kind]] = {
    "model": {
        "use": TEXT,
        "parameters": ANY_TABLE,
        "aircraft": ANY_TABLE,
        "terms": TEXTS_BY_NAME,
        "substeps": COUNT,
        "hold": TEXT,
    },
    "free": {"parameters": TEXTS, "per_record": TEXTS, "bounds": BOUNDS},
    "records": {
        **{"train": FILES, "check": FILES, "test": SETS, "inputs": TEXTS, "outputs": TEXTS},
        **{
            "columns": TEXT_BY_NAME,
            "time": TEXT,
            "sample_time": NUMBER,
            "units": TEXT_BY_NAME,
            "signs": NUMBERS_BY_NAME,
            "units_row": SWITCH,
            **{"delimiter": LAYOUT_TEXT, "decimal": LAYOUT_TEXT, "encoding": LAYOUT_TEXT},
            "skip": LAYOUT_LINES,
        },
        **{"constants": NUMBERS_BY_NAME, "derivatives": TEXT_BY_NAME, "cut": NUMBER},
    },
    "library": {"effects": TEXTS, "leave_out": TEXTS, "general": SWITCH},
    "identify": {
        **{"weak_radius": NUMBER, "rule": TEXT, "candidates": TEXTS_BY_NAME},
        **{
            "least_F": NUMBER,
            "least_R2": NUMBER,
            "share": NUMBER,
            "constants": SWITCH,
            "adapt": SWITCH,
            "lower_powers": SWITCH,
            "prior": BOUNDS,
        },
        **{"add": TEXTS, "keep": TEXTS, "leave_out": TEXTS},
        **{"estimate": TEXTS_BY_NAME, "fix": TEXTS_BY_NAME},
    },
    "design": {
        **{"duration": NUMBER, "sample_time": NUMBER, "knots": COUNT, "axes": TEXTS},
        **{"amplitude": NUMBERS_BY_NAME, "rate": NUMBERS_BY_NAME, "energy": NUMBER},
        **{"envelope": BOUNDS, "trim_input": NUMBERS_BY_NAME, "initial_state": NUMBERS_BY_NAME},
    },
}
# Sections whose keys are names of the model or the loop: they are checked where the model is built.
BY_NAME = {"noise": DEVIATION, "loop": NUMBER}
REQUIRED_KEYS = {"model": ("use",), "records": ("train", "inputs", "outputs")}
READING = (
    "inputs",
    "outputs",
    "columns",
    "time",
    "sample_time",
    "units",
    "signs",
    "units_row",
    "constants",
)
LAYOUT = ("delimiter", "decimal", "encoding", "skip")  # one for all files, or a table by file


def read_study(path: str | Path) -> StudyFile:
    """Read a study file and its records.

    The guide, docs/study_file.md, describes every key. Names that depend on the model (parameters,
    options of the loop, candidates) are checked where the model is built.

    Args:
        path: the TOML file; the records' paths in it are relative to its folder.

    Returns:
        The content of the file, with the records in SI units.

    Raises:
        InputError: when the file is missing or not TOML, a section or key is unknown or missing, a
            value is not of the key's kind, a record is used twice, or `read_csv` refuses a record.
            The message names file, section and key.
    """
    path = existing(path)
    content = _toml(path)
    title = content.pop("title", path.stem)
    _require_kind(path, "", "title", title, TEXT)
    with within(path):
        require_known("section", content, (*SECTIONS, *BY_NAME))
    sections = {name: content.get(name, {}) for name in (*SECTIONS, *BY_NAME)}
    for name, section in sections.items():
        _check_section(path, name, section)
    records = _records(path, sections.pop("records"))
    return StudyFile(path, title, **records._asdict(), **sections)


@contextmanager
def within(path: Path, section: str = "", key: str = "") -> Iterator[None]:
    """Context that adds file, section and key to the message of an `InputError`."""
    try:
        yield
    except InputError as error:
        place = " ".join(part for part in (section and f"[{section}]", key) if part)
        raise InputError(f"{path.name}{place and ', '}{place}: {error}") from error


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:  # syntax, encoding, too many digits, too deep
        raise InputError(f"{path.name} is not a TOML file: {error}. Correct it there.") from error


def _check_section(path: Path, name: str, section: Any) -> None:
    """Refuse keys that are unknown or not of their kind, and a section without a required key."""
    with within(path):
        require(
            isinstance(section, dict),
            f"`{name}` is {section!r}, and a section is wanted. Begin it with [{name}].",
        )
    kinds = SECTIONS.get(name, dict.fromkeys(section, BY_NAME.get(name, TEXT)))
    with within(path, name):
        require_known("key", section, kinds)
        for key in REQUIRED_KEYS.get(name, ()):
            words, example = kinds[key].words, kinds[key].example
            require(
                key in section,
                f"the key {key!r} is missing. Give {words}, such as {key} = {example}.",
            )
    for key, value in section.items():
        _require_kind(path, name, key, value, kinds[key])


def _require_kind(path: Path, section: str, key: str, value: Any, kind: Kind) -> None:
    with within(path, section, key):
        require(
            kind.fits(value),
            f"found {value!r}, and {kind.words} is wanted, such as {key} = {kind.example}.",
        )


class _Records(NamedTuple):
    """Records of a study file.

    Attributes:
        train: training records.
        check: records that decide, None if the file names none.
        test: records that are reported, by name of set, None if the file names none.
    """

    train: tuple[Record, ...]
    check: tuple[Record, ...] | None
    test: dict[str, tuple[Record, ...]] | None
    files: tuple[Path, ...]


def _records(path: Path, section: Mapping[str, Any]) -> _Records:
    """The training, check and test records."""
    test = section.get("test")
    tests = {"test": test} if isinstance(test, list) else test or {}
    parts = {
        "train": section["train"],
        "check": section.get("check", []),
        **{f"test {n}": f for n, f in tests.items()},
    }
    _require_apart(path, parts)
    names = list(itertools.chain.from_iterable(parts.values()))
    _check_layouts(path, section, names)
    read = {name: _read(path, name, files, section) for name, files in parts.items()}
    reported = {name: read[f"test {name}"] for name in tests}
    every = tuple(path.parent / file for file in names)
    return _Records(read["train"], read["check"] or None, reported or None, every)


def _require_apart(path: Path, parts: Mapping[str, Sequence[str]]) -> None:
    """Refuse a file with two parts: a record used for fitting is no test of prediction."""
    part_of: dict[Path, str] = {}
    for name, files in parts.items():
        for file in files:
            where = (path.parent / file).resolve()
            with within(path, "records", name.split()[0]):
                require(
                    where not in part_of,
                    f"{file!r} is already in {part_of.get(where)!r}. Give each record one part: a "
                    "record used for fitting is no test of prediction.",
                )
            part_of[where] = name


def _read(
    path: Path, name: str, files: Sequence[str], section: Mapping[str, Any]
) -> tuple[Record, ...]:
    """The records of one part, with the requested derivatives and cut into segments."""
    with within(path, "records", name.split()[0]):
        try:
            records = [_read_file(path.parent, file, section) for file in files]
        except UnclearUnitError as error:
            raise error.in_toml() from error
    derivatives = section.get("derivatives")
    if derivatives:
        with within(path, "records", "derivatives"):
            records = [differentiate(record, derivatives, Fourier()) for record in records]
    if "cut" in section:
        with within(path, "records", "cut"):
            records = [piece for record in records for piece in segment(record, section["cut"])]
    return tuple(records)


def _check_layouts(path: Path, section: Mapping[str, Any], files: Sequence[str]) -> None:
    """Refuse a layout of a file that is none of the records, or that is a MATLAB file.

    A layout for all files holds for the CSV files among them.
    """
    matlab = [file for file in files if _is_matlab(file)]
    for key in (key for key in (*LAYOUT, "units_row") if key in section):
        given = section[key]
        for_all = files if len(matlab) == len(files) else ()
        with within(path, "records", key):
            if isinstance(given, dict):
                require_known("file of the records", given, files)
            concerned = given if isinstance(given, dict) else for_all
            without = [file for file in concerned if file in matlab]
            require(
                not without,
                f"{', '.join(without)}: a MATLAB file has variables, and no such layout. "
                "Leave the key out.",
            )


def _is_matlab(file: str) -> bool:
    return Path(file).suffix.lower() == ".mat"


def _layout(file: str, section: Mapping[str, Any]) -> dict[str, Any]:
    """The layout of a file: values for all files, and those in tables by file."""
    given = {key: section[key] for key in LAYOUT if key in section}
    tables = {key: value for key, value in given.items() if isinstance(value, dict)}
    own = {key: value[file] for key, value in tables.items() if file in value}
    return {key: value for key, value in given.items() if key not in tables} | own


def _read_file(folder: Path, file: str, section: Mapping[str, Any]) -> Record:
    """The record of a CSV file, or of a MATLAB file by its ending."""
    options = {key: section[key] for key in READING if key in section}
    if not _is_matlab(file):
        return read_csv(folder / file, **options, **_layout(file, section))
    options.pop("units_row", None)
    if "sample_time" not in options:
        options.setdefault("time", TIME)
    return read_mat(folder / file, **options)
