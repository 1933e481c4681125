"""Columns of a table with named columns, such as a pandas DataFrame, as arrays."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._foundation.checks import require, require_known, require_unique


def is_frame(value: Any) -> bool:
    """Return True for a table with named columns; pandas need not be installed."""
    return hasattr(value, "columns") and hasattr(value, "index") and hasattr(value, "loc")


def columns_of(
    frame: Any, time: str, inputs: Sequence[str], outputs: Sequence[str]
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Return time, inputs and outputs of a table.

    Args:
        frame: the table.
        time: name of the column of time, or of the index.
        inputs: columns that are inputs.
        outputs: columns that are outputs.

    Returns:
        Times of shape (time,), [s] from the first sample where they are dates; inputs and outputs
        of shape (time, channel), None if there are none.

    Raises:
        InputError: when a column is missing or occurs twice.
    """
    names = [str(name) for name in frame.columns]
    require_known("column of the DataFrame", (*inputs, *outputs), names)
    wanted = {*inputs, *outputs, time}
    require_unique("column of the DataFrame", [name for name in names if name in wanted])
    t = _times(frame, time, names)
    u, z = (
        np.stack([np.asarray(frame[name]) for name in group], axis=1) if group else None
        for group in (list(inputs), list(outputs))
    )
    return t, u, z


def _times(frame: Any, time: str, names: Sequence[str]) -> np.ndarray:
    """Return the times of a table, from its column or its index; dates in seconds."""
    by_index = time not in names and (frame.index.name == time or _is_dated(frame.index))
    require(
        time in names or by_index,
        f"The DataFrame has no column {time!r} of time. Its columns are: {', '.join(names)}. Give "
        "`time`, or name the index so.",
    )
    t = np.asarray(frame.index if by_index else frame[time])
    if np.issubdtype(t.dtype, np.datetime64):
        return (t - t[:1]) / np.timedelta64(1, "s")
    return t / np.timedelta64(1, "s") if np.issubdtype(t.dtype, np.timedelta64) else t


def _is_dated(index: Any) -> bool:
    return np.issubdtype(np.asarray(index).dtype, np.datetime64)
