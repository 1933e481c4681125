"""Reading of records and variables from MATLAB files."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..._foundation.checks import InputError, require, require_known
from ..build import TIME
from ..record import Record
from ..titles import units_of_titles
from .assemble import assemble, clock, existing
from .binary import mat73_variables
from .by_channel import columns_by_channel, signs_by_channel, units_by_channel
from .mat_structure import require_intact


def read_mat(
    path: str | Path,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    columns: Mapping[str, str] | None = None,
    time: str | None = None,
    sample_time: float | int | None = None,
    units: Mapping[str, str] | None = None,
    signs: Mapping[str, int] | None = None,
    name: str | None = None,
    constants: Mapping[str, Any] | None = None,
) -> Record:
    """Read one record from the variables of a MATLAB file; version 7.3 needs h5py (`jaxid[files]`).

    Args:
        path: the file.
        inputs: names of the inputs, which are variables (vectors) unless `columns` names others.
        outputs: names of the measured outputs, by the same rule.
        columns: the file's variable by channel, where the two names differ, such as
            `{"alpha": "AOA_1"}`.
        time: name of the time variable; give either `time` or `sample_time`.
        sample_time: time between samples [s], for a file without a time variable.
        units: unit by name of channel, variable or constant.
        signs: 1 or -1 by channel, such as `{"az": -1}` for one recorded positive up; 1 for the
            other channels.
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
    variable_of = columns_by_channel(columns, wanted, path)
    remedy = "`columns` names the variable of a channel with another name."
    require_known(f"variable in {path.name}", variable_of.values(), variables, remedy)
    given = units_by_channel(units, variable_of, path)
    file_units = _units_of_names(variable_of, given, time, path)
    sign_of = signs_by_channel(signs, (*inputs, *outputs), path)
    values = {n: sign_of.get(n, 1) * _vector(variables[v], v, path) for n, v in variable_of.items()}
    if sample_time is not None:
        rows = max(map(len, values.values()), default=0)
        time, values[TIME] = TIME, clock(sample_time, rows, path)
    return assemble(
        values,
        str(time),
        inputs,
        outputs,
        file_units,
        given,
        path.stem if name is None else name,
        constants,
    )


def _units_of_names(
    variable_of: Mapping[str, str], given: Mapping[str, str], time: str | None, path: Path
) -> dict[str, str]:
    """Units by channel in the names of variables; a name whose unit is not given is refused."""
    known = {variable_of.get(name, "") for name in given}
    if time is not None and TIME in given:
        known.add(variable_of[time])
    units = units_of_titles({name: name for name in variable_of.values()}, known, path.name)
    return {name: units[v] for name, v in variable_of.items() if v in units}


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
