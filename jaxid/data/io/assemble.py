"""Functions that all file readers use. A reader takes named columns from a file, and `assemble`
makes the record.
"""

import hashlib
import importlib
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..._foundation.checks import InputError, require
from ..arguments import text, texts_by_name
from ..build import TIME, record
from ..record import Record
from ..titles import units_of_titles


def existing(path: str | Path) -> Path:
    """Return the path of a file; a missing file is refused."""
    path = Path(path)
    require(path.is_file(), f"There is no file {path}. Check the folder and the name.")
    return path


def library(name: str, path: Path, *, extra: str) -> Any:
    """Return an optional library that reads a file; without it, its installation is named.

    Args:
        name: name of the library.
        path: the file.
        extra: the extra of jaxid that installs it.

    Raises:
        InputError: if it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            f'{path.name}: reading it needs {name}. Install it: pip install "jaxid[{extra}]".'
        ) from error


def parse_number(text: str) -> float:
    """Return the number that a text holds, written in ASCII digits without separators.

    Python's `float` also reads `1_000` and digits of other scripts; both are refused.

    Args:
        text: the text of a cell.

    Raises:
        ValueError: when the text is not such a number.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is not a number in ASCII digits")
    return float(text)


def sha256(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def time_column(time: str | None, sample_time: float | int | None, path: Path) -> str | None:
    """Return the name of the time column; None where a sample time replaces it.

    Raises:
        InputError: when both are given.
    """
    if time is None:
        return TIME if sample_time is None else None
    require(
        sample_time is None,
        f"{path.name}: `time` is {time!r} and `sample_time` is {sample_time}. Give the name of a "
        "column or the time between rows [s], one of the two.",
    )
    return text(time, "time", path.name)


def clock(sample_time: float | int, samples: int, path: Path) -> np.ndarray:
    """Time from zero at a constant rate [s]."""
    is_number = isinstance(sample_time, int | float | np.number)
    require(
        is_number and not isinstance(sample_time, bool) and _is_positive(sample_time),
        f"{path.name}: `sample_time` is {repr(sample_time)[:60]}. Give a positive number [s].",
    )
    return sample_time * np.arange(samples)


def _is_positive(number: Any) -> bool:
    """True for a positive number within the range of floats."""
    try:
        return 0 < float(number) <= sys.float_info.max
    except (OverflowError, TypeError):
        return False


def assemble(
    columns: Mapping[str, np.ndarray],
    time: str,
    inputs: Sequence[str],
    outputs: Sequence[str],
    file_units: Mapping[str, str],
    units: Mapping[str, str] | None,
    name: str,
    constants: Mapping[str, Any] | None,
) -> Record:
    """Return the record of columns of one length.

    Units given in the call (`units`) take precedence over the units of the file (`file_units`), and
    these over a unit in the name of a column.
    """
    for n in (*inputs, *outputs):
        require(
            len(columns[n]) == len(columns[time]),
            f"Record {name!r}: channel {n!r} has {len(columns[n])} samples and time "
            f"{len(columns[time])}. Resample them to the same times.",
        )
    return record(
        columns[time],
        np.stack([columns[n] for n in inputs], axis=1) if inputs else None,
        np.stack([columns[n] for n in outputs], axis=1) if outputs else None,
        inputs=inputs,
        outputs=outputs,
        units=_units_by_channel(columns, time, file_units, units, f"Record {name!r}"),
        name=name,
        constants=constants,
    )


def _units_by_channel(
    columns: Mapping[str, np.ndarray],
    time: str,
    file_units: Mapping[str, str],
    units: Mapping[str, str] | None,
    where: str,
) -> dict[str, str]:
    """Return the units by channel and constant, of the time as `TIME`."""
    of_columns = {n: unit for n, unit in file_units.items() if n in columns}
    chosen = of_columns | texts_by_name(units, "units", where)
    if time in chosen:
        chosen[TIME] = chosen.pop(time)
    titles = {n: n for n in columns if n != time} | {TIME: time}
    return chosen | units_of_titles(titles, chosen, where)
