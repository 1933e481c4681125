"""Checks of units: those of the record against the model's, angles in degrees."""

from collections.abc import Iterator

import numpy as np

from ...data.units import are_equal
from .channels import Measured
from .findings import Finding, FindingKind
from .response import Response
from .thresholds import DEGREES_RATIO, REVOLUTION

ANGLES = ("rad", "rad/s", "rad/s^2")


def units_of_channels(
    record: Measured, declared: dict[str, str], model: Response
) -> Iterator[Finding]:
    """Findings on channels with another unit than the model's, and on angles in degrees.

    An input is an angle in degrees if it exceeds a revolution. An output may turn further: its size
    is compared with the simulation at the present values.

    Args:
        record: the record.
        declared: units of the model by name.
        model: its response.
    """
    for name in (*record.inputs, *record.outputs):
        unit, expected = record.units[name], declared.get(name, "")
        if unit and expected and not are_equal(unit, expected):
            yield Finding(FindingKind.UNIT, record.name, (name,), {}, (unit, expected))
        elif (unit or expected) in ANGLES:
            yield from degrees(record, name, unit or expected, model)


def degrees(record: Measured, name: str, unit: str, model: Response) -> Iterator[Finding]:
    """Finding on an angle, or its rate, that looks as if it were in degrees."""
    if name in record.inputs:
        values = record.u[:, record.inputs.index(name)]
        wrong, ratio = unit == "rad" and np.max(np.abs(values)) > REVOLUTION, np.nan
    else:
        column = record.outputs.index(name)
        values = record.z[:, column]
        with np.errstate(over="ignore", invalid="ignore"):  # a simulation that diverges
            simulated = np.nanstd(model.y[:, column])
        ratio = np.nanstd(values) / simulated if simulated > 0 else np.nan
        low, high = DEGREES_RATIO
        wrong = low < ratio < high and np.nanmax(np.abs(values)) > 1.0
    if wrong:
        numbers = {"largest": float(np.nanmax(np.abs(values))), "ratio": float(ratio)}
        yield Finding(FindingKind.DEGREES, record.name, (name,), numbers, (unit,))
