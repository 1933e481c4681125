"""Study files: a TOML file that names a model, its free parameters, CSV records, and how a loop shall decide."""

import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from .._foundation.checks import InputError, require, require_known
from .io import existing
from .io_csv import read_csv
from .record import Record
from .smoothing import differentiate
from .smoothing_fourier import Fourier
from .stack import cut


class StudyFile(NamedTuple):
    """What a study file says; every key is known and of its kind, and the records are read.

    Attributes:
        path: the file.
        title: of the report.
        model: the section [model]: what to use, its parameters or settings.
        free: the section [free].
        train: records to fit.
        check: records that decide; None where the file names none.
        test: records that are reported, by name of set; None likewise.
        noise: known standard deviations by output, numbers in SI or texts such as "0.05 deg".
        loop: the section [loop].
        library: the section [library].
    """

    path: Path
    title: str
    model: dict[str, Any]
    free: dict[str, Any]
    train: tuple[Record, ...]
    check: tuple[Record, ...] | None
    test: dict[str, tuple[Record, ...]] | None
    noise: dict[str, float | str]
    loop: dict[str, Any]
    library: dict[str, Any]

    def at(self, section: str, key: str = ""):
        """A context whose refusals name this file, the section and the key."""
        return within(self.path, section, key)


class Kind(NamedTuple):
    """What may stand in a place: in words, as an example, and as a test."""

    words: str
    example: str
    fits: Callable[[Any], bool]


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _list_of(fits: Callable[[Any], bool], count: int | None = None) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, list) and all(map(fits, value)) and count in (None, len(value))


def _table_of(fits: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, dict) and all(map(fits, value.values()))


TEXT = Kind("a text", '"x"', _is_text)
TEXTS = Kind("a list of texts", '["x", "y"]', _list_of(_is_text))
FILES = Kind("a list of files", '["first.csv", "second.csv"]', lambda value: TEXTS.fits(value) and len(value) > 0)
SETS = Kind(
    "a list of files, or a table of such lists",
    '{ slow = ["first.csv"], fast = ["second.csv"] }',
    lambda value: FILES.fits(value) or (_table_of(FILES.fits)(value) and len(value) > 0),
)
TEXT_BY_NAME = Kind("a table of texts", '{ x = "mm" }', _table_of(_is_text))
TEXTS_BY_NAME = Kind("a table of lists of texts", '{ Cm = ["alpha", "qhat"] }', _table_of(TEXTS.fits))
NUMBER = Kind("a number", "0.5", _is_number)
COUNT = Kind("a whole number, at least 1", "2", lambda value: type(value) is int and value >= 1)
NUMBERS_BY_NAME = Kind("a table of numbers", "{ mass = 12.0 }", _table_of(_is_number))
BOUNDS = Kind("a table of pairs", "{ k = [0.0, inf] }", _table_of(_list_of(_is_number, 2)))
SWITCH = Kind("true or false", "true", lambda value: isinstance(value, bool))
TABLE = Kind("a table", "{ k = 1.0 }", lambda value: isinstance(value, dict))
DEVIATION = Kind(
    "a number in SI, or a number with its unit",
    '"0.05 deg"',
    lambda value: _is_number(value) or (_is_text(value) and len(value.split(maxsplit=1)) == 2),
)

SECTIONS: dict[str, dict[str, Kind]] = {
    "model": {"use": TEXT, "parameters": TABLE, "aircraft": TABLE, "terms": TEXTS_BY_NAME, "substeps": COUNT},
    "free": {"parameters": TEXTS, "per_record": TEXTS, "bounds": BOUNDS},
    "records": {
        **{"train": FILES, "check": FILES, "test": SETS, "inputs": TEXTS, "outputs": TEXTS},
        **{"time": TEXT, "sample_time": NUMBER, "units": TEXT_BY_NAME, "units_row": SWITCH, "delimiter": TEXT},
        **{"constants": NUMBERS_BY_NAME, "derivatives": TEXT_BY_NAME, "cut": NUMBER},
    },
    "library": {"effects": TEXTS, "leave_out": TEXTS, "general": SWITCH},
}
BY_NAME = {"noise": DEVIATION, "loop": NUMBER}  # sections whose keys are names that are checked where they are known
NEEDED = {"model": ("use",), "records": ("train", "inputs", "outputs")}
READING = ("inputs", "outputs", "time", "sample_time", "units", "units_row", "delimiter", "constants")


def read_study(path: str | Path) -> StudyFile:
    """Read a study file and its records.

    The guide, docs/study_file.md, has every key. Names that only the model knows (parameters, options of the loop, candidates)
    are checked where the model is made.

    Args:
        path: the TOML file; the records' paths in it are relative to its folder.

    Returns:
        What it says, with the records in SI units.

    Raises:
        InputError: when the file is missing or no TOML, a section or key is unknown, missing, or not of its kind, a record
            stands in two places, or `read_csv` refuses one; file, section and key are named.
    """
    path = existing(path)
    said = _toml(path)
    title = said.pop("title", path.stem)
    _require_kind(path, "", "title", title, TEXT)
    with within(path):
        require_known("section", said, (*SECTIONS, *BY_NAME))
    sections = {name: said.get(name, {}) for name in (*SECTIONS, *BY_NAME)}
    for name, section in sections.items():
        _check_section(path, name, section)
    train, check, test = _records(path, sections.pop("records"))
    return StudyFile(path, title, train=train, check=check, test=test, **sections)


@contextmanager
def within(path: Path, section: str = "", key: str = "") -> Iterator[None]:
    """What is refused inside is told with the file, the section and the key before it."""
    try:
        yield
    except InputError as error:
        place = " ".join(part for part in (section and f"[{section}]", key) if part)
        raise InputError(f"{path.name}{place and ', '}{place}: {error}") from error


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path.name} is no TOML file: {error}. Correct it there.") from error


def _check_section(path: Path, name: str, section: Any) -> None:
    """Every key is known, of its kind, and there if it must be."""
    with within(path):
        require(isinstance(section, dict), f"`{name}` is {section!r}, and a section is wanted. Begin it by [{name}].")
    kinds = SECTIONS.get(name, dict.fromkeys(section, BY_NAME.get(name, TEXT)))
    with within(path, name):
        require_known("key", section, kinds)
        for key in NEEDED.get(name, ()):
            words, example = kinds[key].words, kinds[key].example
            require(key in section, f"the key {key!r} is missing. Give {words}, such as {key} = {example}.")
    for key, value in section.items():
        _require_kind(path, name, key, value, kinds[key])


def _require_kind(path: Path, section: str, key: str, value: Any, kind: Kind) -> None:
    with within(path, section, key):
        require(kind.fits(value), f"found {value!r}, and {kind.words} is wanted, such as {key} = {kind.example}.")


def _records(path: Path, section: Mapping[str, Any]):
    """The three parts: records to fit, to decide, to report."""
    test = section.get("test")
    tests = {"test": test} if isinstance(test, list) else test or {}
    parts = {"train": section["train"], "check": section.get("check", []), **{f"test {n}": f for n, f in tests.items()}}
    _require_apart(path, parts)
    read = {name: _read(path, name, files, section) for name, files in parts.items()}
    reported = {name: read[f"test {name}"] for name in tests}
    return read["train"], read["check"] or None, reported or None


def _require_apart(path: Path, parts: Mapping[str, Sequence[str]]) -> None:
    """A record that is fitted tells nothing of prediction: each file has one part."""
    seen: dict[Path, str] = {}
    for name, files in parts.items():
        for file in files:
            where = (path.parent / file).resolve()
            with within(path, "records", name.split()[0]):
                require(
                    where not in seen,
                    f"{file!r} stands in {seen.get(where)!r} already. Give each record one part: what is fitted cannot judge.",
                )
            seen[where] = name


def _read(path: Path, name: str, files: Sequence[str], section: Mapping[str, Any]) -> tuple[Record, ...]:
    """The records of one part, with the derivatives and in the pieces that are asked for."""
    options = {key: section[key] for key in READING if key in section}
    with within(path, "records", name.split()[0]):
        records = [read_csv(path.parent / file, **options) for file in files]
    derivatives = section.get("derivatives")
    if derivatives:
        with within(path, "records", "derivatives"):
            records = [differentiate(record, derivatives, Fourier()) for record in records]
    if "cut" in section:
        with within(path, "records", "cut"):
            records = [piece for record in records for piece in cut(record, section["cut"])]
    return tuple(records)
