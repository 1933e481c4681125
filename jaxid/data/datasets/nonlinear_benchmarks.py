"""`from_benchmarks`: sets of the package nonlinear_benchmarks, which downloads them, as a
`DataSet`.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ..._foundation.checks import InputError, require
from ..build import record
from ..record import Record
from .base import DataSet


@runtime_checkable
class BenchmarkRecord(Protocol):
    """One record of the package (`Input_output_data`)."""

    u: Any
    y: Any
    sampling_time: float | None
    name: str
    state_initialization_window_length: int | None


def from_benchmarks(
    train: BenchmarkRecord | Sequence[BenchmarkRecord],
    test: BenchmarkRecord | Sequence[BenchmarkRecord],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    units: Mapping[str, str] | None = None,
    citation: str = "",
) -> DataSet:
    """Return a set of the package nonlinear_benchmarks with its official split and windows.

        train, test = nonlinear_benchmarks.ParWH()
        jaxid.data.from_benchmarks(train, test, inputs=("u",), outputs=("y",))

    Args:
        train, test: the two results of a function of the package.
        inputs, outputs: names for the columns of `u` and `y`.
        units: unit by name of channel.
        citation: publication of the data.

    Raises:
        InputError: when a record has no sample time, or another number of channels than names.
    """
    channels = {"inputs": tuple(inputs), "outputs": tuple(outputs), "units": dict(units or {})}
    trains, tests = (
        [
            _record(one, f"{kind} {number}", channels)
            for number, one in enumerate(_as_sequence(given))
        ]
        for kind, given in (("train", train), ("test", test))
    )
    windows = [one.state_initialization_window_length for one in _as_sequence(test)]
    names = [one.names[0] for one in tests]
    require(
        len(set(names)) == len(names),
        f"Two test records have the same name ({', '.join(names)}). Rename them.",
    )
    return DataSet(
        names[0] if names else "",
        tuple(trains),
        dict(zip(names, tests, strict=True)),
        dict(zip(names, windows, strict=True)),
        citation,
    )


def _as_sequence(given: Any) -> Sequence[BenchmarkRecord]:
    """Return one record as a sequence; a record of the package is itself a pair (u, y)."""
    return given if isinstance(given, tuple | list) else (given,)


def _record(one: BenchmarkRecord, otherwise: str, channels: dict[str, Any]) -> Record:
    """Return one record of the package; without a name it gets another one."""
    name = one.name or otherwise
    if one.sampling_time is None:
        raise InputError(f"{name} has no sample time. Set its `sampling_time` [s].")
    u, y = np.asarray(one.u, float), np.asarray(one.y, float)
    time = float(one.sampling_time) * np.arange(len(y))
    return record(time, u, y, **channels, name=name)
