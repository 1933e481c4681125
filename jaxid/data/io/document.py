"""JSON documents: an object with the name and the version of its format."""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..._foundation.checks import InputError, require
from .assemble import existing

# JSON has no numbers for these.
NOT_FINITE = {"inf": math.inf, "-inf": -math.inf, "nan": math.nan}


def write_document(
    path: str | Path, content: Mapping[str, Any], *, kind: str, version: int
) -> Path:
    """Write a new JSON file; numbers are read back bit for bit.

    The file is written under a temporary name and renamed when complete, so that no incomplete file
    remains.

    Args:
        path: path of the new file, in an existing folder.
        content: numbers, texts, lists and dictionaries.
        kind: name of the format.
        version: version of the format.

    Returns:
        The path.

    Raises:
        InputError: when the file exists, the folder does not, or it cannot be written to.
    """
    document = {"format": kind, "version": version, **_encoded(content)}
    return write_new(path, json.dumps(document, indent=2, allow_nan=False) + "\n")


def write_new(path: str | Path, text: str) -> Path:
    """Write a new file under a temporary name, and rename it when it is complete.

    Args:
        path: path of the new file, in an existing folder.
        text: its content.

    Returns:
        The path.

    Raises:
        InputError: when the file exists, the folder does not, or it cannot be written to.
    """
    path = Path(path)
    require(
        not path.exists(),
        f"{path} exists already and is not overwritten. Choose another name, or remove it.",
    )
    require(path.parent.is_dir(), f"The folder {path.parent} does not exist. Create it first.")
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with temporary.open("x", encoding="utf-8") as file:
            file.write(text)
        temporary.rename(path)
    except OSError as error:
        if not isinstance(error, FileExistsError):  # else the temporary file is another writer's
            temporary.unlink(missing_ok=True)
        raise InputError(
            f"{path} cannot be written: {error.strerror}. Choose another folder, or free space."
        ) from error
    return path


def read_document(path: str | Path, *, kind: str, version: int) -> dict[str, Any]:
    """Return the content of a JSON file of `write_document`.

    Args:
        path: the file.
        kind: name of the format.
        version: newest version of the format that is understood.

    Raises:
        InputError: when the file is missing, is no JSON or of another format, is of a newer
            version, or names an entry twice.
    """
    path = existing(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:  # UnicodeDecodeError is a ValueError
        raise InputError(f"{path.name} is not a JSON file: {error}. Write it again.") from error
    require(
        isinstance(content, dict) and content.get("format") == kind,
        f"{path.name} is not a file of the format {kind!r}. Give a file that was written as such.",
    )
    written = content.get("version")
    if not isinstance(written, int) or isinstance(written, bool) or written < 1:
        raise InputError(
            f"{path.name}: the version is {written!r}, not a whole number from 1. Write it again."
        )
    require(
        written <= version,
        f"{path.name} has version {written} of its format, and this jaxid reads up to {version}. "
        "Install a newer jaxid.",
    )
    return content


def number(value: Any, where: str) -> float:
    """Return a number of a document, which may be infinite or NaN.

    Args:
        value: the value in the file.
        where: its file and name, for the message.

    Raises:
        InputError: when it is no number.
    """
    if isinstance(value, str) and value in NOT_FINITE:
        return NOT_FINITE[value]
    require(
        isinstance(value, int | float) and not isinstance(value, bool) and _fits(value),
        f"{where} is {value!r}, which is not a number. Correct the file.",
    )
    return float(value)


def names_of(content: Mapping[str, Any], key: str, where: str) -> tuple[str, ...]:
    """Return a list of names of a document.

    Args:
        content: the object with the list.
        key: its name there.
        where: file and object, for the message.

    Raises:
        InputError: when the list is missing, or an entry is no text.
    """
    names = content.get(key)
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f"{where}: {key!r} is missing or no list of names. Write it again.")
    return tuple(names)


def _fits(value: int | float) -> bool:
    """True if a number is within the range of floats."""
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _encoded(value: Any) -> Any:
    """Return a value with texts in place of numbers that JSON does not have."""
    if isinstance(value, Mapping):
        return {str(key): _encoded(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_encoded(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else "inf" if value > 0 else "-inf"
    return value


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of the file; a name that occurs twice is refused."""
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"{twice!r} occurs twice")
    return content
