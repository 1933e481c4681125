"""Histories of a record for an identification model, and the record to fit."""

from typing import TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import InputError, require, require_known
from ..._foundation.host import as_columns, columns_at, to_device
from ..._foundation.types import Array, Float
from ...data.arguments import OTHER_NAMES
from ...data.record import Record
from ...models.base import AbstractModel
from ...models.free import with_values
from ...models.names import parameter_names
from ..instruments.channels import ANGULAR, CHANNEL_TABLE
from ..records.air_data import density_of, has_pressure
from .channels import LATERAL_STATES, Channels
from .readings import AIR_DATA, Readings, Signals
from .units import SIGNALS

Histories = dict[str, Float[Array, " time"]]
Model = TypeVar("Model", bound=AbstractModel)

SOURCES = (
    "is computed from V, alpha and beta, and from the rates for a vane off the centre of gravity, "
    "unless the record has it"
)
LATERAL = (*LATERAL_STATES, "phi", "aileron", "rudder")  # zero in symmetric flight
REMEDIES = {
    **{
        name: f"Derive it from the rate: `differentiate(record, {{'{name[0]}': '{name}'}}, "
        f"Fourier())`"
        for name in ANGULAR
    },
    "density": "Give qbar and the true airspeed V, which determine it, hold it, or leave it to "
    "the altitude",
}


def at_constants(model: Model, record: Record) -> Model:
    """Return the model with the record's constants as values of the parameters of the same names.

    Args:
        model: a model; constants that are none of its parameters are ignored.
        record: a single record.

    Raises:
        InputError: for a stack of records.
    """
    require(
        not record.is_stack,
        "This is a stack of records. Take them one by one: `[model.prepared(record) for record in "
        "stack]`.",
    )
    names = [name for name in record.constants if name in parameter_names(model)]
    if not names:
        return model
    changed = with_values(model, names, jnp.stack([record.constants[name] for name in names]))
    return cast(Model, changed)


def prepared(readings: Readings, record: Record) -> Record:
    """Return the record with the inputs of a model and unchanged outputs.

    This implements `IdentificationModel.prepared`.

    Args:
        readings: instruments and channels of the model.
        record: a single record.

    Raises:
        InputError: if a channel is missing, or an input has invalid samples.
    """
    inputs = readings.channels.inputs
    known = readings.channels.outputs
    require_known("channel (needed as output)", known, record.outputs, OTHER_NAMES)
    motions = _motions(readings, *histories(readings, record))
    lacking = tuple(name for name in inputs if name not in motions)
    if lacking:
        raise missing(record, readings.channels, lacking, "as an input")
    _require_complete(inputs, motions, record)
    columns = tuple(k for k, name in enumerate(record.outputs) if name not in inputs)
    return Record(
        t=record.t,
        u=as_columns([motions[name] for name in inputs], shape=record.t.shape),
        z=columns_at(record.z, at=columns),
        mask=columns_at(record.mask, at=columns),
        constants=_first_values_of_hidden_states(readings, motions) | record.constants,
        inputs=inputs,
        outputs=tuple(record.outputs[k] for k in columns),
        input_units=tuple(SIGNALS[name] for name in inputs),
        output_units=tuple(record.output_units[k] for k in columns),
        names=record.names,
    )


def _require_complete(inputs: tuple[str, ...], motions: Histories, record: Record) -> None:
    """Refuse an input with missing samples."""
    for name in inputs:
        gaps = int(np.sum(~np.isfinite(np.asarray(motions[name]))))
        require(
            gaps == 0,
            f"Record {record.names[0]!r}: the model takes {name!r} as an input, and {gaps} of its "
            f"samples are missing{f' ({SOURCES})' if name in AIR_DATA else ''}. Fill the gaps "
            "first, or propagate it.",
        )


def histories(readings: Readings, record: Record) -> tuple[Histories, Histories]:
    """Return histories of a record's outputs and inputs, without the constants of the model.

    Args:
        readings: instruments and channels of the model.
        record: a single record.

    Returns:
        Readings by channel, NaN where a sample is missing [its unit]; and the known signals:
        inputs, a measured density, and the dynamic pressure that determines it [SI].
    """
    held = readings.held
    known = {
        name: record.channel(name) for name in record.inputs if name in SIGNALS and name not in held
    }
    if "density" in readings.channels.measured:
        density = density_of(record, readings.airspeed)
        known |= {} if density is None else {"density": density}
        if has_pressure(record, readings.airspeed):
            known["qbar"] = record.channel("qbar")
    taken = (*known, *held)
    measured = {
        name: record.channel(name)
        for name in record.outputs
        if name in CHANNEL_TABLE and name not in taken
    }
    return measured, known


def missing(
    record: Record, channels: Channels, lacking: tuple[str, ...], purpose: str
) -> InputError:
    """Return the error for a record that lacks channels: the first of them that is not zero in
    symmetric flight, or the first.

    Args:
        record: the record.
        channels: channels of the model.
        lacking: names of the channels.
        purpose: purpose of the channels in the model, for the message.
    """
    has = (*record.inputs, *record.outputs)
    symmetric = not {*LATERAL_STATES} & {*channels.states}
    name = next((name for name in lacking if name not in LATERAL), lacking[0])
    source = f", which {SOURCES}" if name in AIR_DATA else ""
    remedy = REMEDIES.get(name, "Measure it, hold it at a constant (`held`), or propagate it")
    if symmetric and name in LATERAL:
        zero = ", ".join(
            f"{each!r}: 0.0"
            for each in LATERAL
            if each in channels.inputs and not {each, AIR_DATA.get(each, each)} & {*has}
        )
        remedy += (
            f". In symmetric flight hold `held={{{zero}}}`; "
            "`model_of(record, states='longitudinal')` does so by itself"
        )
    return InputError(
        f"Record {record.names[0]!r}: the model needs {name!r} {purpose}{source}, and the record "
        f"has {', '.join(has)}. {remedy}."
    )


@eqx.filter_jit
def _motions(readings: Readings, measured: Histories, known: Histories) -> Histories:
    """Return the motion at each sample, with u, v and w over ground."""

    def at(measured: Signals, known: Signals) -> Signals:
        true = readings.motion(measured, known)
        return true | readings.over_ground(true)

    return jax.vmap(at)(measured, known)


def _first_values_of_hidden_states(
    readings: Readings, motions: Histories
) -> dict[str, Float[Array, ""]]:
    """Return the first measured values of states without an output, such as the heading."""
    first = {}
    for name in readings.channels.states:
        finite = np.isfinite(np.asarray(motions[name])) if name in motions else np.zeros(1, bool)
        if finite.any() and AIR_DATA.get(name, name) not in readings.channels.outputs:
            first[name] = to_device(np.asarray(motions[name])[int(np.argmax(finite))])
    return first
