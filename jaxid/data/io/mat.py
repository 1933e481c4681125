"""Reading of records and variables from MATLAB files."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..._foundation.checks import InputError, require, require_known
from ..build import TIME
from ..record import Record
from .assemble import assemble, clock, existing
from .binary import mat73_variables
from .mat_structure import require_intact


def read_mat(
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
    """Read one record from the variables of a MATLAB file; version 7.3 needs h5py (`jaxid[files]`).

    Args:
        path: the file.
        inputs: variables that are inputs, each a vector.
        outputs: variables that are measured outputs, each a vector.
        time: name of the time variable; give either `time` or `sample_time`.
        sample_time: time between samples [s], for a file without a time variable.
        units: unit by name of variable or constant.
        name: name of the record; the stem of the file when left out.
        constants: known quantities that are constant over the record [`units`, else SI].

    Returns:
        The record, in SI units.

    Raises:
        InputError: when the file or a variable is missing, a variable is not a vector, the file is
            damaged, neither or both of `time` and `sample_time` are given, or `record`
            refuses the values.
    """
    path = existing(path)
    require(
        (time is None) != (sample_time is None),
        f"{path.name}: give `time` (the name of a variable) or `sample_time` [s], one of the two.",
    )
    variables = mat_variables(path)
    wanted = (*inputs, *outputs) if time is None else (time, *inputs, *outputs)
    require_known(f"variable in {path.name}", wanted, variables)
    columns = {n: _vector(variables[n], n, path) for n in wanted}
    if sample_time is not None:
        time, columns[TIME] = (
            TIME,
            clock(sample_time, max(map(len, columns.values()), default=0), path),
        )
    return assemble(
        columns,
        str(time),
        inputs,
        outputs,
        {},
        units,
        path.stem if name is None else name,
        constants,
    )


def mat_variables(path: str | Path) -> dict[str, np.ndarray]:
    """The variables of a MATLAB file by name.

    Args:
        path: the file, of version 4 to 7.3.

    Returns:
        Its variables, as arrays with two axes.

    Raises:
        InputError: when the file does not exist, is not a MATLAB file or is damaged.
    """
    from scipy.io import loadmat  # imported here because it is slow to import

    path = existing(path)
    require_intact(path.read_bytes(), path.name)
    try:
        return {k: v for k, v in loadmat(path).items() if not k.startswith("__")}
    except NotImplementedError:
        return mat73_variables(path)
    except MemoryError as error:
        raise InputError(
            f"{path.name} is damaged: it names an array that does not fit the memory. Export it "
            "again, or as CSV."
        ) from error
    except Exception as error:  # a damaged file makes the reader fail in many ways
        raise InputError(
            f"{path.name} is not a MATLAB file, or is damaged: {error}. Export it again, or read "
            "it as CSV."
        ) from error


def _vector(values: np.ndarray, name: str, path: Path) -> np.ndarray:
    """A MATLAB vector as an array with one axis."""
    require(
        np.ndim(values) == 2 and min(values.shape) == 1 and values.dtype.kind in "biuf",
        f"{path.name}: variable {name!r} has shape {np.shape(values)}, and a channel is a vector "
        "of numbers. Save each column as a variable.",
    )
    return values.reshape(-1)
