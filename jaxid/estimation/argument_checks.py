"""Checks of the arguments of `estimate`, `predict` and `close_loop`, before any computation."""

from collections.abc import Sequence
from typing import Any

from .._foundation.checks import require
from ..data.record import Record
from ..data.units import are_equal, is_unit
from ..models.base import AbstractModel
from ..models.equation_shapes import check_names
from ..models.free import Free
from .likelihoods import AbstractLikelihood

MOST_SHOWN = 60  # characters of a refused argument in its message (chosen)


def check_arguments(model: Any, records: Record, likelihood: Any) -> None:
    """Refuse a class in place of a model or a likelihood, and channels in other units.

    Args:
        model: the model.
        records: a stack.
        likelihood: the likelihood.

    Raises:
        InputError: with the argument or the channel, and the remedy.
    """
    check_model(model)
    require(
        isinstance(likelihood, AbstractLikelihood),
        f"The likelihood is {_shown(likelihood)}. Give an object, such as `jaxid.OutputError()`.",
    )
    declared, channels = model.units(), (*records.inputs, *records.outputs)
    for name, unit in zip(channels, (*records.input_units, *records.output_units), strict=True):
        _require_unit(name, unit, declared.get(name, ""))


def check_model(model: Any) -> None:
    """Refuse a class in place of a model, and a text in place of the names of its channels.

    Raises:
        InputError: with the argument or the attribute, and the remedy.
    """
    require(
        isinstance(model, AbstractModel),
        f"The model is {_shown(model)}. Give an object with starting values, such as "
        "Spring(k=1.0, c=0.1).",
    )
    check_names(model)


def check_free(free: Any) -> None:
    """Refuse names in place of the selection of the free parameters.

    Raises:
        InputError: with the remedy.
    """
    require(
        isinstance(free, Free),
        f"The free parameters are {_shown(free)}. Give `jaxid.free(model, ...)` with their names.",
    )


def require_no_shooting(likelihood: AbstractLikelihood, function: str) -> None:
    """Refuse multiple shooting in a function that simulates each record as a whole.

    Raises:
        InputError: with the function.
    """
    require(
        getattr(likelihood, "shooting", None) is None,
        f"`shooting` is an option of `estimate` and `identify`; `{function}` simulates each record "
        "as a whole. Leave it out, and start from the model of an estimate with it.",
    )


def require_records(records: Any) -> None:
    """Refuse anything but a sequence of records, such as the name of a file.

    Raises:
        InputError: with the argument.
    """
    require(
        isinstance(records, Sequence)
        and not isinstance(records, str)
        and all(isinstance(record, Record) for record in records),
        f"Records are needed, and this is {_shown(records)}. Make them with `jaxid.record(...)` or "
        "`jaxid.read_csv(...)`.",
    )


def _require_unit(name: str, recorded: str, declared: str) -> None:
    """Refuse a channel in another unit than the model's; unknown units are not compared."""
    require(
        not (recorded and is_unit(declared)) or are_equal(recorded, declared),
        f"{name!r} is in [{recorded}] in the records and in [{declared}] in the model. Records are "
        "in SI units, with angles in radians. Give the unit of the recorded numbers in `units`, "
        "such as 'rpm' for revolutions per minute, and write the model and its method `units` for "
        "the units of the records.",
    )


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."
