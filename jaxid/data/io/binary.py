"""Reading of records from HDF5 and Parquet files, and of MATLAB files of version 7.3 (HDF5)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..._foundation.checks import InputError, require, require_known
from ..build import TIME
from ..record import Record
from .assemble import assemble, clock, existing, library


def read_hdf5(
    path: str | Path,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    group: str = "/",
    time: str | None = None,
    sample_time: float | int | None = None,
    units: Mapping[str, str] | None = None,
    name: str | None = None,
    constants: Mapping[str, Any] | None = None,
) -> Record:
    """Read one record from the datasets of a group of an HDF5 file (h5py, `jaxid[files]`).

    The attribute `units` of a dataset is its unit, unless `units` gives another.

    Args:
        path: the file.
        inputs, outputs: names of the datasets, each with one number per sample.
        group: path of the group in the file.
        time: name of the dataset of time; give either `time` or `sample_time`.
        sample_time: time between samples [s].
        units: unit by name of dataset or constant.
        name: name of the record; the stem of the file when left out.
        constants: known quantities that are constant over the record [`units`, else SI].

    Returns:
        The record, in SI units.

    Raises:
        InputError: when the file, the group or a dataset is missing, the file is not HDF5, a
            dataset is not a vector of numbers, h5py is not installed, or `record` refuses the
            values.
    """
    path = existing(path)
    wanted = _wanted(path, inputs, outputs, time, sample_time)
    columns, file_units = {}, {}
    h5py = library("h5py", path, extra="files")
    try:
        with h5py.File(path, "r") as file:
            require_known(f"group in {path.name}", [group], _groups(file, group))
            members = file[group]
            datasets = [str(key) for key in members if isinstance(members[key], h5py.Dataset)]
            require_known(f"dataset in {path.name}", wanted, datasets)
            for key in wanted:
                columns[key] = _vector(np.asarray(members[key]), key, path)
                if "units" in members[key].attrs:
                    unit = members[key].attrs["units"]
                    file_units[key] = unit.decode() if isinstance(unit, bytes) else str(unit)
    except (OSError, KeyError, RuntimeError, UnicodeError) as error:
        raise InputError(
            f"{path.name} cannot be read as HDF5: {error}. Export it again, or as CSV."
        ) from error
    return _record(
        columns, path, inputs, outputs, time, sample_time, file_units, units, name, constants
    )


def read_parquet(
    path: str | Path,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    time: str | None = None,
    sample_time: float | int | None = None,
    units: Mapping[str, str] | None = None,
    name: str | None = None,
    constants: Mapping[str, Any] | None = None,
) -> Record:
    """Read one record from the columns of a Parquet file (pyarrow, `jaxid[files]`).

    Args:
        path: the file.
        inputs, outputs: names of the columns; a null in an output is a missing sample.
        time: name of the column of time; give either `time` or `sample_time`. Dates become seconds
            from the first row.
        sample_time: time between samples [s].
        units: unit by name of column or constant.
        name: name of the record; the stem of the file when left out.
        constants: known quantities that are constant over the record [`units`, else SI].

    Returns:
        The record, in SI units.

    Raises:
        InputError: when the file or a column is missing, the file is not Parquet, a column has no
            numbers, pyarrow is not installed, or `record` refuses the values.
    """
    path = existing(path)
    wanted = _wanted(path, inputs, outputs, time, sample_time)
    library("pyarrow", path, extra="files")
    import pyarrow.parquet as parquet
    from pyarrow import ArrowException

    try:
        names = parquet.read_schema(path).names
        require_known(f"column in {path.name}", wanted, names)
        table = parquet.read_table(path, columns=list(dict.fromkeys(wanted)))
        columns = {key: _vector(_numbers(table[key].to_numpy()), key, path) for key in wanted}
    except (ArrowException, OSError) as error:
        words = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"{path.name} cannot be read as Parquet: {words}. Export it again, or as CSV."
        ) from error
    return _record(columns, path, inputs, outputs, time, sample_time, {}, units, name, constants)


def mat73_variables(path: Path) -> dict[str, np.ndarray]:
    """The numeric variables of a MATLAB file of version 7.3 by name, with MATLAB's axes.

    Raises:
        InputError: when h5py is not installed, or the file is damaged.
    """
    try:
        import h5py
    except ImportError as error:
        raise InputError(
            f"{path.name} is a MATLAB file of version 7.3, which is HDF5 and needs h5py: "
            'pip install "jaxid[files]". '
            f"Or in MATLAB: load it, then save('{path.name}', '-v7')."
        ) from error
    try:
        with h5py.File(path, "r") as file:
            datasets = {str(key): file[key] for key in file}
            return {
                key: np.asarray(data).T
                for key, data in datasets.items()
                if isinstance(data, h5py.Dataset) and data.dtype.kind in "biuf"
            }
    except (OSError, KeyError, RuntimeError, UnicodeError) as error:
        raise InputError(
            f"{path.name} is a MATLAB file of version 7.3 that cannot be read: {error}. In MATLAB: "
            f"load it, then save('{path.name}', '-v7')."
        ) from error


def _wanted(
    path: Path,
    inputs: Sequence[str],
    outputs: Sequence[str],
    time: str | None,
    sample_time: float | int | None,
) -> tuple[str, ...]:
    """Return the names to read; either time or sample time must be given."""
    require(
        (time is None) != (sample_time is None),
        f"{path.name}: give `time` (a name in the file) or `sample_time` [s], one of the two.",
    )
    for argument, names in (("inputs", inputs), ("outputs", outputs)):
        require(
            not isinstance(names, str),
            f"{path.name}: `{argument}` is the string {names!r}. Give a tuple of names, such as "
            f"({names!r},).",
        )
    return (*inputs, *outputs) if time is None else (time, *inputs, *outputs)


def _groups(file: Any, group: str) -> list[str]:
    """Return the group if the file has it, else the groups that it has."""
    if group in file and hasattr(file[group], "keys"):
        return [group]
    names = ["/"]
    file.visititems(lambda name, item: names.append(name) if hasattr(item, "keys") else None)
    return names


def _numbers(values: np.ndarray) -> np.ndarray:
    """Return dates as seconds from the first one, other values unchanged."""
    if np.issubdtype(values.dtype, np.datetime64):
        return (values - values[:1]) / np.timedelta64(1, "s")
    return values


def _vector(values: np.ndarray, name: str, path: Path) -> np.ndarray:
    """Return a vector of numbers, also one with a second axis of length one."""
    require(
        values.dtype.kind in "biuf" and values.size == max(values.shape, default=0),
        f"{path.name}: {name!r} has shape {values.shape} and type {values.dtype}, and a channel is "
        "a vector of numbers. Save each column under a name of its own.",
    )
    return values.reshape(-1)


def _record(columns, path, inputs, outputs, time, sample_time, file_units, units, name, constants):
    """Return the record of columns of a file."""
    if time is None:
        time = TIME
        columns[TIME] = clock(sample_time, max(map(len, columns.values()), default=0), path)
    title = path.stem if name is None else name
    return assemble(columns, time, inputs, outputs, file_units, units, title, constants)
