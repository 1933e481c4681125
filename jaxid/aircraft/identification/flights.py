"""Record and identification model of a simulated flight, as available in a flight test."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx

from ..._foundation.checks import require_known
from ..._foundation.host import as_columns
from ...data.record import Record
from ..flight.aircraft import Aircraft
from ..flight.simulate_flight import Flight
from ..vehicle.aerodynamics_lift_drag import without_terms
from ..vehicle.controls import SURFACES
from .model import IdentificationModel


def from_aircraft(
    aircraft: Aircraft, *, force_axes: str = "body", **options: Any
) -> IdentificationModel:
    """Return an identification model of an aircraft with empty polynomials.

    Mass, size, engines and instruments are taken from the aircraft. The instruments keep their
    errors; give other instruments if their errors are unknown. V is the indicated airspeed and beta
    the flank angle of a vane, as simulated instruments measure them. By default the altitude is
    measured, and so is the thrust of engines without constant thrust; `flight_record` has both.
    Wind, buffet and control system are not modelled.

    Args:
        aircraft: an aircraft, such as `Flight.aircraft`.
        force_axes: "body", "stability" or "wind", see `model_of`.
        options: options of `IdentificationModel`.

    Raises:
        InputError: as `IdentificationModel`.
    """
    airframe = eqx.tree_at(
        lambda frame: frame.aerodynamics, aircraft.airframe, without_terms(force_axes)
    )
    given = {
        "engines": aircraft.engines,
        "instruments": aircraft.instruments,
        "atmosphere": aircraft.atmosphere,
        "airspeed": "indicated",
        "beta": "vane",
    }
    placed = {*options.get("held", {}), *options.get("states", ()), *options.get("measured", ())}
    measured = tuple(name for name in _unmodelled_channels(aircraft) if name not in placed)
    options = options | {"measured": (*options.get("measured", ()), *measured)}
    return IdentificationModel(airframe, **(given | options))


def flight_record(flight: Flight, also: Sequence[str] | None = None) -> Record:
    """Return the record of a flight with the surface positions in place of the pilot commands.

    Outputs are the channels of the instruments. A surface, altitude or thrust that no instrument
    records is taken from the truth and becomes an input without noise; a recorded one is an output
    with its measurement errors.

    Args:
        flight: result of `simulate_flight` or `report_flight`.
        also: outputs of the truth to add to the surfaces; by default the altitude, and the thrust
            of engines without constant thrust.

    Raises:
        InputError: if the truth lacks a channel.
    """
    also = _unmodelled_channels(flight.aircraft) if also is None else tuple(also)
    require_known("channel of the truth", also, flight.truth.outputs)
    recorded, truth = flight.record, flight.truth
    true = tuple(name for name in (*SURFACES, *also) if name not in recorded.outputs)
    units = dict(zip(truth.outputs, truth.output_units, strict=True))
    fields = {name: getattr(recorded, name) for name in Record.__dataclass_fields__}
    u = [truth.channel(name) for name in true]
    inputs = {
        "u": as_columns(u, shape=recorded.t.shape),
        "inputs": true,
        "input_units": tuple(units[name] for name in true),
    }
    return Record(**(fields | inputs))


def _unmodelled_channels(aircraft: Aircraft) -> tuple[str, ...]:
    """Return the channels that an identification model of this aircraft needs as measurements."""
    constant = all(
        engine.source.states == () == engine.source.inputs for engine in aircraft.engines
    )
    return ("altitude",) if constant else ("altitude", "thrust")
