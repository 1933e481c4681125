"""Reading of records and variables from MATLAB files."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..._foundation.checks import InputError, require, require_known
from ..build import TIME
from ..record import Record
from .assemble import assemble, clock, existing


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
    """Read one record from the variables of a MATLAB file (up to version 7).

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
            of version 7.3, neither or both of `time` and `sample_time` are given, or `record`
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
        path: the file, of version 4 to 7.

    Returns:
        Its variables, as arrays with two axes.

    Raises:
        InputError: when the file does not exist, is of version 7.3 or is not a MATLAB file.
    """
    from scipy.io import loadmat  # imported here because it is slow to import

    path = existing(path)
    try:
        return {k: v for k, v in loadmat(path).items() if not k.startswith("__")}
    except NotImplementedError as error:
        raise InputError(
            f"{path.name} is a MATLAB file of version 7.3, which is HDF5 and not supported. In "
            f"MATLAB: load it, then save('{path.name}', '-v7')."
        ) from error
    except (ValueError, TypeError, OSError) as error:
        raise InputError(
            f"{path.name} is not a MATLAB file: {error}. Export it again, or read it as CSV."
        ) from error


def _vector(values: np.ndarray, name: str, path: Path) -> np.ndarray:
    """A MATLAB vector as an array with one axis."""
    require(
        values.ndim == 2 and min(values.shape) == 1,
        f"{path.name}: variable {name!r} has shape {values.shape}, and a channel is a vector. Save "
        "each column as a variable.",
    )
    return values.reshape(-1)
