"""Data set type, and the search for and verification of files, for all loaders."""

import os
from pathlib import Path
from typing import NamedTuple

from ..._foundation.checks import InputError, require
from ..io.assemble import sha256
from ..record import Record

ENVIRONMENT = "JAXID_DATA"


class DataSet(NamedTuple):
    """A measured set with its official split.

    Args:
        name: name of the set.
        train: records to fit.
        test: records to score, by name.
        window: number of samples at the start of each test record that are used to fit the initial
            state and excluded from the score; None if the simulation starts at rest at the first
            measured output and all samples are scored.
        citation: publication of the data.
    """

    name: str
    train: tuple[Record, ...]
    test: dict[str, Record]
    window: dict[str, int | None]
    citation: str


def locate(
    path: str | Path | None,
    folder: str,
    file: str,
    source: str,
    *,
    digest: str | None = None,
    size: int | None = None,
) -> Path:
    """Return the path of a file of a set, after a check of its SHA-256 or, if none is published, of
    its size.

    Args:
        path: the file, a folder that holds it, or a folder that holds `folder`; `JAXID_DATA` when
            left out.
        folder: name of the folder of the set.
        file: name of the file.
        source: sentence on the source of the file, for error messages.
        digest: required SHA-256, if it is known.
        size: required size, if it is known [bytes].

    Returns:
        The path of the file.

    Raises:
        InputError: when there is no such file, or its SHA-256 or size differs.
    """
    given = path if path is not None else os.environ.get(ENVIRONMENT)
    if not given:
        raise InputError(
            f"The location of {file} is not given. Give `path` (the file or its folder), or set "
            f"the environment variable {ENVIRONMENT} to a folder that holds {folder}/{file}. "
            f"{source}"
        )
    base = Path(given)
    candidates = [base / folder / file, base / file, *([base] if base.is_file() else [])]
    located = next((candidate for candidate in candidates if candidate.is_file()), None)
    if located is None:
        raise InputError(f"There is no {file} in {base} nor in {base / folder}. {source}")
    checks = (
        ("SHA-256", digest, lambda: sha256(located)),
        ("size in bytes", size, lambda: located.stat().st_size),
    )
    for quantity, expected, measure in checks:
        actual = None if expected is None else measure()
        require(
            actual == expected,
            f"{located} is not the file that the split of {folder!r} was made for: its {quantity} "
            f"is {actual}, expected {expected}. Download it again. {source}",
        )
    return located
