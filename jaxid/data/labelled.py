"""Conversion of records to and from xarray datasets."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .._foundation.checks import require, require_known
from .build import record
from .record import Record
from .stack import stack

if TYPE_CHECKING:
    import xarray as xr

# Names of the dimensions and coordinates of the dataset: no channel may have one of them.
_RESERVED = ("t", "case", "row", "name")


def to_xarray(record: Record) -> "xr.Dataset":
    """Return a dataset with one variable per channel and constant, with its unit and its role.

    A single record has the dimension `t` [s]; a stack has `case`, labelled by name, and `row`, with
    the time of each row as the coordinate `t` (case, row). Where the mask is False the value is
    NaN.

    Args:
        record: a record, or a stack with one case axis.

    Returns:
        The dataset; `attrs["units"]` of a variable is its unit, `attrs["role"]` is input, output or
        constant.

    Raises:
        InputError: when a channel or constant has the name of a dimension.
    """
    import xarray as xr  # imported here because it is slow to import

    channels = (*record.inputs, *record.outputs)
    for name in (*channels, *record.constants):
        require(
            name not in _RESERVED,
            f"Channel {name!r} has the name of a dimension of the dataset. Rename it.",
        )
    cases, rows = (("case",), ("row",)) if record.is_stack else ((), ("t",))
    roles = ["input"] * len(record.inputs) + ["output"] * len(record.outputs)
    units = (*record.input_units, *record.output_units)
    variables: dict[str, Any] = {
        name: ((*cases, *rows), np.asarray(record.channel(name)), {"units": unit, "role": role})
        for name, unit, role in zip(channels, units, roles, strict=True)
    }
    variables |= {
        k: (cases, np.asarray(v), {"role": "constant"}) for k, v in record.constants.items()
    }
    time = ((*cases, *rows), np.asarray(record.t), {"units": "s"})
    labels = {"case": list(record.names)} if record.is_stack else {}
    return xr.Dataset(
        variables,
        coords={"t": time, **labels},
        attrs={} if record.is_stack else {"name": record.names[0]},
    )


def from_xarray(
    dataset: "xr.Dataset", inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
) -> Record:
    """Return the record of a dataset, the exact inverse of `to_xarray`, with all checks of
    `record`.

    One of these checks refuses an output without a valid sample, in a single record or in a case of
    a stack. A window of a record may have such an output; `to_xarray` converts it, and this
    function refuses its dataset.

    Args:
        dataset: variables over `t` [s] (a single record) or over `case` and `row` with the
            coordinate `t` (a stack); `attrs["units"]` of a variable is read, also of `t`, and NaN
            in an output is a missing sample.
        inputs: names of the inputs; the variables whose `attrs["role"]` is "input" when left out.
        outputs: names of the outputs; the variables whose `attrs["role"]` is "output" when left
            out.

    Returns:
        The record or stack; variables with the role "constant" become its constants.

    Raises:
        InputError: when there is no time, a channel is missing or has other dimensions, or `record`
            refuses the values.
    """
    require(
        "t" in dataset.coords,
        "The dataset has no coordinate 't' (time). Rename yours: dataset.rename(time='t').",
    )
    is_stack = dataset["t"].ndim == 2
    dimensions = dataset["t"].dims
    chosen_in = _by_role(dataset, "input") if inputs is None else tuple(inputs)
    chosen_out = _by_role(dataset, "output") if outputs is None else tuple(outputs)
    require(
        len(chosen_out) > 0,
        "No variable of the dataset has the role 'output'. Name the channels: from_xarray(dataset, "
        "inputs, outputs).",
    )
    require_known("variable", (*chosen_in, *chosen_out), map(str, dataset.data_vars))
    for name in (*chosen_in, *chosen_out):
        channel_dims = dataset[name].dims
        require(
            set(channel_dims) == set(dimensions),
            f"Channel {name!r} has the dimensions {channel_dims}, and time 't' has "
            f"{dimensions}. Bring it onto the same axes.",
        )
    if not is_stack:
        return _single_record(dataset, chosen_in, chosen_out, str(dataset.attrs.get("name", "")))
    case, row = dimensions if dimensions[1] != "case" else dimensions[::-1]
    names = (
        [str(n) for n in dataset[case].values]
        if case in dataset.coords
        else [""] * dataset.sizes[case]
    )
    parts = [
        _single_record(_unpadded(dataset.isel({case: i}), row), chosen_in, chosen_out, name)
        for i, name in enumerate(names)
    ]
    return stack(parts, pad_to=dataset.sizes[row])


def _by_role(dataset: "xr.Dataset", role: str) -> tuple[str, ...]:
    """Names of the variables with a role, in the order of the dataset."""
    return tuple(
        str(name)
        for name, variable in dataset.data_vars.items()
        if variable.attrs.get("role") == role
    )


def _unpadded(dataset: "xr.Dataset", row: Any) -> "xr.Dataset":
    """One case without its padding: the rows at its end that repeat the last time."""
    t = dataset["t"].values
    rising = np.flatnonzero(np.diff(t) != 0)
    return dataset.isel({row: slice(0, rising[-1] + 2 if rising.size else 1)})


def _single_record(
    dataset: "xr.Dataset", inputs: tuple[str, ...], outputs: tuple[str, ...], name: str
) -> Record:
    """The record of a dataset with one case, checked."""
    constants = _by_role(dataset, "constant")
    units = {
        n: str(dataset[n].attrs.get("units", "")) for n in ("t", *inputs, *outputs, *constants)
    }
    return record(
        dataset["t"].values,
        np.stack([dataset[n].values for n in inputs], axis=1) if inputs else None,
        np.stack([dataset[n].values for n in outputs], axis=1),
        inputs=inputs,
        outputs=outputs,
        units=units,
        name=name,
        constants={n: dataset[n].values for n in constants},
    )
