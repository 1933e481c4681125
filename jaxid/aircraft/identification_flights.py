"""From a simulated flight to what a flight-test engineer has of it: the record, and a model of known mass and size."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from .._foundation.checks import require_known
from ..data.record import Record
from .aerodynamics_polynomial import PolynomialAerodynamics
from .aircraft import Aircraft
from .controls import SURFACES
from .fly import Flight
from .identification import IdentificationModel


def from_aircraft(aircraft: Aircraft, **options: Any) -> IdentificationModel:
    """An identification model with mass, size, engines and instruments of an aircraft, and empty polynomials.

    The instruments are taken as they are, their errors included: as far as those are not known, give others. The altitude is
    measured, unless `options` say otherwise, and so is the thrust of engines that are not of constant thrust; `flight_record`
    has both. Wind, buffet and control system have no place in the model.

    Args:
        aircraft: such as the one that a `Flight` carries.
        options: as `IdentificationModel` takes them.

    Raises:
        InputError: as `IdentificationModel`.
    """
    airframe = eqx.tree_at(lambda one: one.aerodynamics, aircraft.airframe, PolynomialAerodynamics({}))
    given = {"engines": aircraft.engines, "instruments": aircraft.instruments, "atmosphere": aircraft.atmosphere}
    placed = {*options.get("held", {}), *options.get("states", ()), *options.get("measured", ())}
    measured = tuple(name for name in _beside(aircraft) if name not in placed)
    options = options | {"measured": (*options.get("measured", ()), *measured)}
    return IdentificationModel(airframe, **(given | options))


def flight_record(flight: Flight, also: Sequence[str] | None = None) -> Record:
    """The record of a flight with measured surfaces as inputs, in the place of what the pilot commanded.

    Outputs are the channels of the instruments. A surface, the altitude or the thrust that no instrument records is taken
    from the truth and stands among the inputs, free of noise; one that is recorded stands among the outputs, as it was
    recorded.

    Args:
        flight: as `fly` or `flights.flight` make it.
        also: what else is needed of the truth's outputs, beside the surfaces; by default the altitude, and the thrust of
            engines that are not of constant thrust.

    Raises:
        InputError: when the truth has no such channel.
    """
    also = _beside(flight.aircraft) if also is None else tuple(also)
    require_known("channel of the truth", also, flight.truth.outputs)
    recorded, truth = flight.record, flight.truth
    true = tuple(name for name in (*SURFACES, *also) if name not in recorded.outputs)
    units = dict(zip(truth.outputs, truth.output_units, strict=True))
    fields = {name: getattr(recorded, name) for name in Record.__dataclass_fields__}
    u = [truth.channel(name) for name in true]
    own = {
        "u": jnp.stack(u, axis=-1) if u else jnp.zeros((*recorded.t.shape, 0)),
        "inputs": true,
        "input_units": tuple(units[name] for name in true),
    }
    return Record(**(fields | own))


def _beside(aircraft: Aircraft) -> tuple[str, ...]:
    """What a model cannot know of this aircraft without measuring it."""
    constant = all(engine.source.states == () == engine.source.inputs for engine in aircraft.engines)
    return ("altitude",) if constant else ("altitude", "thrust")
