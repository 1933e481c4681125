"""What the loaders share: the set as a thing, where its files are looked for, and the proof that they are right."""

import os
from pathlib import Path
from typing import NamedTuple

from ..._foundation.checks import InputError, require
from ..io import sha256
from ..record import Record

ENVIRONMENT = "JAXID_DATA"


class DataSet(NamedTuple):
    """A measured set with its official split.

    Args:
        name: name of the set.
        train: records to fit.
        test: records to score, by name.
        window: number of samples at the start of each test record on which an initial state is fitted and which the
            score leaves out; None where the simulation starts at rest at the first measured output and all count.
        citation: who measured it.
    """

    name: str
    train: tuple[Record, ...]
    test: dict[str, Record]
    window: dict[str, int | None]
    citation: str


def locate(path: str | Path | None, folder: str, file: str, digest: str, offered: str) -> Path:
    """Find a file of a set and prove by its SHA-256 that it is the one the split was made for.

    Args:
        path: the file, a folder that holds it, or a folder that holds `folder`; `JAXID_DATA` when left out.
        folder: name of the folder of the set.
        file: name of the file.
        digest: SHA-256 it must have.
        offered: where its makers offer it.

    Returns:
        The path of the file.

    Raises:
        InputError: when there is no such file, or it is another one.
    """
    given = path if path is not None else os.environ.get(ENVIRONMENT)
    if not given:
        raise InputError(
            f"Where is {file}? Give `path` (the file or its folder), or set the environment variable {ENVIRONMENT} to "
            f"a folder that holds {folder}/{file}. {offered}"
        )
    base = Path(given)
    places = [base / folder / file, base / file, *([base] if base.is_file() else [])]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise InputError(f"There is no {file} in {base} nor in {base / folder}. {offered}")
    actual = sha256(found)
    require(
        actual == digest,
        f"{found} is not the file that the split of {folder!r} was made for: its SHA-256 is {actual}, expected "
        f"{digest}. Fetch it anew. {offered}",
    )
    return found
