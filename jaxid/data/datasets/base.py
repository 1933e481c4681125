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


def locate(path: str | Path | None, folder: str, file: str, digest: str, source: str) -> Path:
    """Return the path of a file of a set, after a check of its SHA-256.

    Args:
        path: the file, a folder that holds it, or a folder that holds `folder`; `JAXID_DATA` when
            left out.
        folder: name of the folder of the set.
        file: name of the file.
        digest: required SHA-256.
        source: sentence on the source of the file, for error messages.

    Returns:
        The path of the file.

    Raises:
        InputError: when there is no such file, or its SHA-256 differs.
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
    actual = sha256(located)
    require(
        actual == digest,
        f"{located} is not the file that the split of {folder!r} was made for: its SHA-256 is "
        f"{actual}, expected {digest}. Download it again. {source}",
    )
    return located
