"""What an identification model takes from a record: a first state, histories in the place of states, coefficients."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require, require_known
from .._foundation.types import Array, Float
from ..data.record import Record
from ..models.free import with_values
from ..models.names import parameter_names
from ..models.pseudo import PseudoMeasurements
from .aerodynamics import COEFFICIENTS
from .atmosphere import GRAVITY
from .controls import SURFACES
from .engine import loads
from .first_samples import first_samples
from .flow import flow
from .identification_units import SIGNALS
from .instrument_channels import ANGULAR, FORCE, RATES, TABLE
from .instruments_inverse import air_of, motion
from .record_air import density_of

if TYPE_CHECKING:
    from .identification import IdentificationModel

Histories = dict[str, Float[Array, " time"]]
AIR_DATA = {"u": "V", "V": "V", "v": "beta", "beta": "beta", "w": "alpha", "alpha": "alpha"}
SOURCES = "follows from V, alpha and beta where it is not given itself"
FACTORS = (  # what the terms of a regression may be made of
    *("alpha", "beta", "V", "mach", "qbar", "density", "phat", "qhat", "rhat", "u", "v", "w"),
    *(*RATES, *SURFACES, "thrust", "altitude"),
)
WHAT_TO_DO = {
    **{
        name: f"Derive it from the rate: `differentiate(record, {{'{name[0]}': '{name}'}}, Fourier())`"
        for name in ANGULAR
    },
    "density": "Give qbar and the true airspeed V, from which it follows, hold it, or leave it to the altitude",
}


def initial_state(model: "IdentificationModel", record: Record) -> Float[Array, " state"]:
    """A state from the first valid samples (see `IdentificationModel.initial_state`)."""
    return _first_state(model, record.anonymous())


@eqx.filter_jit
def _first_state(model: "IdentificationModel", record: Record) -> Float[Array, " state"]:
    seen = first_samples(record)
    known = dict(zip(record.inputs, record.u[0], strict=True)) if record.inputs else {}
    known = {name: value for name, value in known.items() if name in SIGNALS} | dict(model.held)
    constants = {name: value for name, value in record.constants.items() if name in SIGNALS}
    known = {name: value for name, value in constants.items() if name not in seen} | known
    zero = jnp.zeros(())
    for name in (*RATES, "phi", "pitch", "psi", "altitude"):
        if name not in seen:
            known.setdefault(name, zero)
    for name in ("v", "w"):
        if not {AIR_DATA[name], name} & {*seen, *known}:
            known[name] = zero
    if not {"V", "u"} & {*seen, *known}:
        frame = model.airframe
        density = air_of(model.atmosphere, {"altitude": seen.get("altitude", zero)} | known).density
        known["V"] = jnp.sqrt(2.0 * frame.mass_properties.mass * GRAVITY / (density * frame.S))
    true = motion(model.instruments, seen, known, model.atmosphere, model.airspeed, model.beta)
    velocity = jnp.stack([true[name] for name in "uvw"])
    true |= dict(zip(model.translation.names, model.translation.states(velocity), strict=True))
    return jnp.stack([true[name] for name in model.states])


def prepared(model: "IdentificationModel", record: Record) -> Record:
    """The record with the model's inputs among its inputs and its outputs unchanged (`IdentificationModel.prepared`)."""
    _require_single(record)
    model = at_constants(model, record)
    require_known("channel (needed as output)", model.outputs, record.outputs)
    found = _motions(model, *_histories(model, record))
    for name in model.inputs:
        if name not in found:
            raise InputError(_lacks(record, name, "as an input"))
        gaps = int(jnp.sum(~jnp.isfinite(found[name])))
        require(
            gaps == 0,
            f"Record {record.names[0]!r}: the model takes {name!r} as an input, and {gaps} of its samples are missing"
            f"{f' ({SOURCES})' if name in AIR_DATA else ''}. Fill the gaps before, or propagate it.",
        )
    columns = [k for k, name in enumerate(record.outputs) if name not in model.inputs]
    return Record(
        t=record.t,
        u=jnp.stack([found[name] for name in model.inputs], axis=-1),
        z=record.z[:, np.array(columns, int)],
        mask=record.mask[:, np.array(columns, int)],
        constants=_unseen(model, found) | record.constants,
        inputs=model.inputs,
        outputs=tuple(record.outputs[k] for k in columns),
        input_units=tuple(SIGNALS[name] for name in model.inputs),
        output_units=tuple(record.output_units[k] for k in columns),
        names=record.names,
    )


def _unseen(model: "IdentificationModel", found: Histories) -> dict[str, Float[Array, ""]]:
    """Where states begin that no output shows, such as the heading: what was measured of them all the same."""
    begin = {}
    for name in model.states:
        finite = np.isfinite(np.asarray(found[name])) if name in found else np.zeros(1, bool)
        if finite.any() and AIR_DATA.get(name, name) not in model.outputs:
            begin[name] = found[name][int(np.argmax(finite))]
    return begin


def pseudo_measurements(model: "IdentificationModel", record: Record) -> PseudoMeasurements:
    """What a regression explains (`IdentificationModel.pseudo_measurements`)."""
    _require_single(record)
    model = at_constants(model, record)
    shown, known = _histories(model, record)
    _require_all(model, record, (*shown, *known))
    responses, signals = _coefficients(model, shown, known)
    responses = {name: responses[name] for name in model.responses}
    signals = {name: signals[name] for name in FACTORS}
    valid = jnp.all(jnp.isfinite(jnp.stack([*responses.values(), *signals.values()])), axis=0)
    candidates = dict(model.candidates)
    return PseudoMeasurements(
        t=record.t,
        responses={name: jnp.where(valid, value, 0.0) for name, value in responses.items()},
        signals={name: jnp.where(valid, value, 0.0) for name, value in signals.items()},
        valid=valid,
        candidates=tuple((name, candidates.get(name, ())) for name in responses),
        centred=("alpha", "beta"),
    )


def at_constants(model: "IdentificationModel", record: Record) -> "IdentificationModel":
    """The model with the record's constants in the place of parameters of their names, as an estimate takes them."""
    names = [name for name in record.constants if name in parameter_names(model)]
    if not names:
        return model
    changed = with_values(model, names, jnp.stack([record.constants[name] for name in names]))
    return cast("IdentificationModel", changed)


def _histories(model: "IdentificationModel", record: Record) -> tuple[Histories, Histories]:
    """Readings by channel, NaN where one is missing; and what is known, of a record's inputs."""
    known = {name: record.channel(name) for name in record.inputs if name in SIGNALS and name not in model.held}
    density = density_of(record, model.airspeed) if "density" in model.channels.measured else None
    if density is not None:
        known["density"] = density
    taken = (*known, *model.held)
    return {name: record.channel(name) for name in record.outputs if name in TABLE and name not in taken}, known


@eqx.filter_jit
def _motions(model: "IdentificationModel", shown: Histories, known: Histories) -> Histories:
    """What is true at each sample."""
    return jax.vmap(lambda shown, known: _motion(model, shown, known))(shown, known)


def _motion(model: "IdentificationModel", shown: Mapping, known: Mapping) -> dict[str, Float[Array, ""]]:
    known = dict(known) | dict(model.held)
    true = motion(model.instruments, shown, known, model.atmosphere, model.airspeed, model.beta)
    if {*"uvw"} <= set(true):
        states = model.translation.states(jnp.stack([true[name] for name in "uvw"]))
        true = dict(zip(model.translation.names, states, strict=True)) | true
    return true


@eqx.filter_jit
def _coefficients(model: "IdentificationModel", shown: Histories, known: Histories) -> tuple[Histories, Histories]:
    """The six coefficients and all signals at each sample."""
    return jax.vmap(lambda shown, known: _solved(model, shown, known))(shown, known)


def _solved(model: "IdentificationModel", shown: Mapping, known: Mapping):
    """The equations of motion at an instant, solved for the coefficients."""
    true = _motion(model, shown, known)
    frame, mass = model.airframe, model.airframe.mass_properties
    velocity, omega, omegadot = (jnp.stack([true[name] for name in names]) for names in ("uvw", RATES, ANGULAR))
    signals = true | flow(frame, air_of(model.atmosphere, true), velocity, omega)
    pushes = model.pushes(signals)
    signals |= {"thrust": jnp.sum(jnp.stack(pushes))}
    push, turning, momentum = loads(model.engines, pushes)
    felt = jnp.stack([true.get(name, jnp.zeros(())) for name in FORCE])
    force = mass.mass * felt - push
    inertia = mass.inertia()
    moment = inertia @ omegadot + jnp.cross(omega, inertia @ omega + momentum) - turning
    moment = moment - jnp.cross(frame.reference, force)
    pressure_area = signals["qbar"] * frame.S
    values = jnp.concatenate([force, moment / frame.lengths]) / pressure_area
    return {name: values[k] for k, name in enumerate(COEFFICIENTS)}, signals


def _require_all(model: "IdentificationModel", record: Record, has: tuple[str, ...]) -> None:
    """Refuse a record from which the coefficients of the equations that are propagated do not follow."""
    has = (*has, *model.held)
    felt = [name for force, name in zip(("CX", "CY", "CZ"), FORCE, strict=True) if force in model.responses]
    if bool(np.any(np.asarray(model.airframe.reference) != 0.0)):  # forces then make moments
        felt = list(FORCE)
    wanted = [*RATES, *ANGULAR, *felt, *SURFACES, *(name for name in model.channels.measured if name not in ANGULAR)]
    wanted += ["altitude"] if "altitude" in model.states else []
    for name in wanted:
        if name not in has:
            raise InputError(_lacks(record, name, "for the coefficients"))
    for name in ("u", "v", "w"):
        if not {name, AIR_DATA[name]} & set(has):
            raise InputError(_lacks(record, name, "for the coefficients"))


def _lacks(record: Record, name: str, why: str) -> str:
    """The refusal of a record without a channel."""
    source = f", which {SOURCES}" if name in AIR_DATA else ""
    what = WHAT_TO_DO.get(name, "Measure it, hold it at a constant (`held`), or propagate it")
    has = ", ".join((*record.inputs, *record.outputs))
    return f"Record {record.names[0]!r}: the model needs {name!r} {why}{source}, and the record has {has}. {what}."


def _require_single(record: Record) -> None:
    require(
        not record.is_stack,
        "This is a stack of records. Take them one by one: `[model.prepared(one) for one in stack]`.",
    )
