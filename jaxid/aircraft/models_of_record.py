"""Models of the aircraft that made a record: what is known of it comes from the record's constants and channels."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._foundation.checks import InputError, require, require_known
from ..data.record import Record
from .aerodynamics_polynomial import PolynomialAerodynamics
from .airframe import Airframe
from .controls import SURFACES
from .identification import IdentificationModel
from .identification_channels import GROUPS, IN_AIR, owners
from .instrument_channels import ANGULAR, CHANNELS
from .instruments import Instruments
from .kinematics import SHOWN, Kinematics
from .mass import MassProperties
from .record_air import air_known
from .record_plausible import require_plausible

NEEDED = ("mass", "Ix", "Iy", "Iz", "S", "b", "cbar")
UNITS = {"mass": "kg", "S": "m^2", "b": "m", "cbar": "m"}  # kg m^2 for the others
ALONG, ACROSS = ("u", "w", "q", "V", "alpha"), ("v", "p", "r", "beta")  # states of longitudinal and of lateral motion
MOVES = {"stabilator": ALONG, "aileron": ACROSS, "rudder": ACROSS}
WIDEST = np.pi / 2  # rad, stops of surfaces whose stops nobody asks for


def model_of(
    record: Record,
    *,
    mass: float | None = None,
    Ix: float | None = None,
    Iy: float | None = None,
    Iz: float | None = None,
    Ixz: float | None = None,
    S: float | None = None,
    b: float | None = None,
    cbar: float | None = None,
    reference: tuple[float, float, float] = (0.0, 0.0, 0.0),
    check: bool = True,
    **options: Any,
) -> IdentificationModel:
    """An identification model, with empty polynomials, of the aircraft that made a record.

        record = read_sidpac("flight.mat")
        model = model_of(record)                                          # what the record's constants say
        model = model_of(record, mass=7472.0, Iy=91420.0, ..., states="longitudinal")     # what it lacks

    **Mass and size** are constants of the record, or arguments. `Ixz` is zero where neither says it. A longitudinal model
    does without `Ix` and `Iz`: they are then put equal, and roll and yaw do not couple into pitch.

    **The air.** Density is the record's channel `density`; else it follows from `qbar` and V, with the altitude; else it is a
    constant `density`; else it is the standard atmosphere's at that altitude. The altitude says the speed of sound beside it;
    where it is not recorded it is the one that has this density in the standard atmosphere.

    **Thrust** is measured where it is a channel, held where it is a constant. Where it is neither, CX is that of air
    and engines together.

    **States** are all nine; `psi` only where it is measured. Equations of which the flight says nothing are left out by
    `identify`. A longitudinal model holds at zero what the record lacks of the lateral motion (symmetric flight), and a
    surface that moves no equation; another surface that is not recorded is refused.

    **Outputs** are the channels of the record that tell of a state, without pdot, qdot and rdot: they are derivatives of
    the rates, more often than not, and would count the same measurement twice. Name them by `outputs` where they are
    measured.

    Args:
        record: a single one.
        mass: [kg].
        Ix, Iy, Iz, Ixz: moments and product of inertia [kg m^2].
        S: reference area [m^2].
        b: span [m].
        cbar: mean chord [m].
        reference: where the coefficients' moments are taken, seen from the centre of gravity, body axes [m].
        check: refuse a record whose magnitudes tell of another unit or sign (`require_plausible`).
        options: as `IdentificationModel` takes them; what is given here goes before what the record says. The instruments
            are faultless and at the centre of gravity, V is the true airspeed and beta the sideslip, if not said otherwise.

    Raises:
        InputError: for a stack; when mass or size is not known, or an argument and the record's constant differ; when a surface
            or the air is not known; when magnitudes are not plausible; as `IdentificationModel`.
    """
    require(not record.is_stack, "This is a stack of records. Make the model of one of them: `model_of(stack[0])`.")
    chosen: dict[str, Any] = {"airspeed": "true", "beta": "sideslip", "instruments": Instruments(), "frame": "body"}
    chosen.update(options)
    states = chosen["states"] = _states(record, chosen.get("states", "coupled"), chosen["frame"])
    given = {"mass": mass, "Ix": Ix, "Iy": Iy, "Iz": Iz, "Ixz": Ixz, "S": S, "b": b, "cbar": cbar}
    known = _constants(record, given, across=bool({*ACROSS} & {*states}))
    body = {name: known[name] for name in ("mass", "Ix", "Iy", "Iz", "Ixz")}
    airframe = Airframe(
        name=record.names[0],
        mass_properties=MassProperties(**body),
        S=known["S"],
        b=known["b"],
        cbar=known["cbar"],
        aerodynamics=PolynomialAerodynamics({}),
        limits=dict.fromkeys(SURFACES, (-WIDEST, WIDEST)),
        reference=reference,
    )
    if check:
        require_plausible(record, mass=body["mass"], S=known["S"], airspeed=chosen["airspeed"])
    chosen["held"] = _held(record, states, chosen.get("held", {}))
    measured, held = _beside(record, {*chosen["held"], *states, *chosen.get("measured", ())}, chosen["airspeed"])
    chosen["held"] |= held
    chosen["measured"] = (*chosen.get("measured", ()), *measured)
    chosen.setdefault("outputs", _outputs(record, states, chosen["frame"], chosen["instruments"].channels))
    return IdentificationModel(airframe, **chosen)


def kinematics_of(record: Record, **options: Any) -> Kinematics:
    """The kinematic model of a record, for `jaxid.consistency`: its outputs are those that the record has.

    Args:
        record: one or a stack.
        options: as `Kinematics` takes them; V is the true airspeed and beta the sideslip, if not said otherwise.

    Raises:
        InputError: when none of V, alpha, beta, phi, pitch, psi, altitude is an output of the record; as `Kinematics`.
    """
    shown = tuple(name for name in SHOWN if name in record.outputs)
    require(
        len(shown) > 0,
        f"Record {record.names[0]!r} has none of {', '.join(SHOWN)} among its outputs, so that accelerations and rates have "
        "nothing to agree with.",
    )
    chosen: dict[str, Any] = {"instruments": Instruments(shown), "beta": "sideslip"}
    chosen.update(options)
    return Kinematics(**chosen)


def _states(record: Record, states: Any, frame: str) -> tuple[str, ...]:
    """The states by name; the heading of a group only where it is measured, as nothing depends on it."""
    if not isinstance(states, str):
        return tuple(states)
    require_known("group of states", [states], GROUPS)
    names = [name for name in GROUPS[states] if name != "psi" or "psi" in record.outputs]
    return tuple((IN_AIR.get(name) or name) if frame == "air path" else name for name in names)


def _constants(record: Record, given: Mapping[str, float | None], across: bool) -> dict[str, float]:
    """Mass and size, from arguments and the record's constants."""
    said = {name: float(record.constants[name]) for name in given if name in record.constants}
    known = said | {name: float(value) for name, value in given.items() if value is not None}
    for name, value in said.items():
        require(
            bool(np.isclose(known[name], value, rtol=1e-6, atol=0.0)),
            f"Record {record.names[0]!r} says {name} = {value:.6g}, and the argument {known[name]:.6g}. The constants of a "
            "record go before a model's numbers: leave the argument out, or change the record by "
            f"`dataclasses.replace(record, constants={{**record.constants, {name!r}: jnp.asarray(...)}})`.",
        )
    known.setdefault("Ixz", 0.0)
    if not across and "Iy" in known:  # (Iz - Ix) p r vanishes, and no body is refused
        known.setdefault("Ix", known.get("Iz", known["Iy"]))
        known.setdefault("Iz", known["Ix"])
    lacks = [name for name in NEEDED if name not in known]
    require(
        not lacks,
        f"Record {record.names[0]!r} does not say {', '.join(lacks)}. Give the numbers: `model_of(record, "
        + ", ".join(f"{name}=..." for name in lacks)
        + f")` in {', '.join(dict.fromkeys(UNITS.get(name, 'kg m^2') for name in lacks))}. "
        f"Its constants are {', '.join(record.constants) or 'none'}.",
    )
    return known


def _held(record: Record, states: tuple[str, ...], held: Mapping[str, Any]) -> dict[str, Any]:
    """What stays at a constant: as told, surfaces that move nothing, and what symmetric flight lacks."""
    held, has = dict(held), {*record.inputs, *record.outputs, *held}
    for name in SURFACES:
        if name not in has:
            moved = [state for state in MOVES[name] if state in states]
            if moved:
                raise InputError(
                    f"Record {record.names[0]!r} has no {name}, and it moves the equations of {', '.join(moved)}. Read it as "
                    f"an input, hold it where it did not move (`held={{{name!r}: 0.0}}`), or leave those states out."
                )
            held[name] = 0.0
    if not {*ACROSS} & {*states}:
        sideways = "beta" if {"V", "alpha"} & {*states} else "v"
        has = has | ({sideways} if "beta" in has else set())
        held |= {name: 0.0 for name in (sideways, "p", "r", "phi") if name not in has and name not in states}
    return held


def _beside(record: Record, placed: set[str], airspeed: str) -> tuple[tuple[str, ...], dict[str, float]]:
    """What is measured and what is held of thrust, density and altitude, unless that is said already."""
    measured, held = [], {}
    if "thrust" not in placed:
        if "thrust" in (*record.inputs, *record.outputs):
            measured.append("thrust")
        elif "thrust" in record.constants:
            held["thrust"] = float(record.constants["thrust"])
    more, constant = air_known(record, placed, airspeed)
    return (*measured, *more), held | constant


def _outputs(record: Record, states: tuple[str, ...], frame: str, instruments: tuple[str, ...]) -> tuple[str, ...]:
    """Channels of the record that tell of a state."""
    owner = owners(frame)
    return tuple(
        name
        for name in CHANNELS
        if name in instruments and name in record.outputs and name not in ANGULAR and owner.get(name) in states
    )
