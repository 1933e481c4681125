"""Models of an aircraft from the constants and channels of its record."""

import inspect
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..._foundation.checks import require, require_known
from ...data.record import Record
from ..instruments.channels import ANGULAR, CHANNELS
from ..instruments.instruments import Instruments
from ..physics.mass import MassProperties
from ..reconstruction.kinematics import KINEMATIC_OUTPUTS, LONGITUDINAL_OUTPUTS, Kinematics
from ..records.air_data import air_known
from ..records.plausibility import require_plausible
from ..vehicle.aerodynamics_lift_drag import without_terms
from ..vehicle.airframe import Airframe
from ..vehicle.controls import SURFACES
from .channels import LATERAL_STATES, group_states, owners
from .model import IdentificationModel

REQUIRED_CONSTANTS = ("mass", "Ix", "Iy", "Iz", "S", "b", "cbar")
CONSTANT_UNITS = {"mass": "kg", "S": "m^2", "b": "m", "cbar": "m"}  # kg m^2 for the others
LONGITUDINAL_STATES = ("u", "w", "q", "V", "alpha")
AFFECTED_BY_SURFACE = {
    "stabilator": LONGITUDINAL_STATES,
    "aileron": LATERAL_STATES,
    "rudder": LATERAL_STATES,
}


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
    force_axes: str = "body",
    check: bool = True,
    **options: Any,
) -> IdentificationModel:
    """Return an identification model with empty polynomials for the aircraft of a record.

        record = read_sidpac("flight.mat")
        model = model_of(record)               # mass and size are constants of the record
        model = model_of(record, mass=7472.0, Iy=91420.0, ..., states="longitudinal")

    **Channels** are known by these names, with units in SI and axes x forward, y right, z down:

        inputs   stabilator (the elevator) aileron rudder: positive pitches the nose down, rolls to
                 the left, yaws to the left [rad]; thrust [N]
        outputs  V [m/s], alpha beta [rad]; p q r [rad/s]; phi pitch psi [rad]; altitude [m];
                 ax ay az: specific force, az about -9.8 in level flight [m/s^2];
                 pdot qdot rdot [rad/s^2], by `differentiate` where they are not measured

    A longitudinal model needs V, alpha, q, pitch, ax, az, qdot and the stabilator. `columns` and
    `signs` of `jaxid.read_csv` rename and reverse the columns of a log.

    **Mass and size** are constants of the record, or arguments. The default of `Ixz` is zero. A
    longitudinal model needs no `Ix` and `Iz`: they are then set equal, and roll and yaw do not
    couple into pitch.

    **The air.** The first of these sources that exists gives the density: `qbar` and V, with the
    altitude; the record's channel `density`; a constant `density`; the standard atmosphere at the
    altitude. The altitude determines the speed of sound; if it is not recorded, it is the altitude
    that has this density in the standard atmosphere.

    **Thrust** is measured if it is a channel, and held if it is a constant. Otherwise CX contains
    air and engines together.

    **States** are all nine, with `psi` only if it is measured. `identify` leaves out equations that
    the flight does not excite. In a longitudinal model, lateral variables that the record lacks are
    held at zero (symmetric flight), and so is a surface that affects no equation; any other surface
    that is not recorded is refused.

    **Outputs** are the channels of the record that depend on a state, without pdot, qdot and rdot:
    these are mostly derivatives of the rates, and would count the same measurement twice. Name them
    in `outputs` if they are measured.

    Args:
        record: a single record.
        mass: mass [kg].
        Ix, Iy, Iz, Ixz: moments and product of inertia [kg m^2].
        S: reference area [m^2].
        b: span [m].
        cbar: mean chord [m].
        reference: reference point of the moment coefficients relative to the centre of gravity,
            body axes [m].
        force_axes: "body" for CX, CY, CZ; "stability" or "wind" for drag, side force and lift
            (`LiftDragAerodynamics`).
        check: refuse a record whose magnitudes indicate another unit or sign (`require_plausible`).
        options: options of `IdentificationModel`; they take precedence over the record. By default
            the instruments are error-free and at the centre of gravity, V is the true airspeed and
            beta the sideslip. `instruments` may be the arguments of `Instruments`, as a study file
            has them: `{"position": {"alpha": [13.0, 0.0, 0.0]}}`.

    Raises:
        InputError: for a stack; if mass or size is not known, or an argument differs from the
            record's constant; if a surface or the air is not known; if magnitudes are not
            plausible; as `IdentificationModel`.
    """
    require(
        not record.is_stack,
        "This is a stack of records. Make the model of one of them: `model_of(stack[0])`.",
    )
    chosen: dict[str, Any] = {"airspeed": "true", "instruments": Instruments(), "frame": "body"}
    chosen.update(options)
    chosen["instruments"] = _instruments(chosen["instruments"])
    states = chosen["states"] = _states(record, chosen.get("states", "coupled"), chosen["frame"])
    given = {"mass": mass, "Ix": Ix, "Iy": Iy, "Iz": Iz, "Ixz": Ixz, "S": S, "b": b, "cbar": cbar}
    known = _constants(record, given, across=bool({*LATERAL_STATES} & {*states}))
    body = {name: known[name] for name in ("mass", "Ix", "Iy", "Iz", "Ixz")}
    airframe = Airframe(
        name=record.names[0],
        mass_properties=MassProperties(**body),
        S=known["S"],
        b=known["b"],
        cbar=known["cbar"],
        aerodynamics=without_terms(force_axes),
        reference=reference,
    )
    if check:
        require_plausible(record, mass=body["mass"], S=known["S"], airspeed=chosen["airspeed"])
    chosen["held"] = _held(record, states, chosen.get("held", {}))
    measured, held = _thrust_and_air(
        record, {*chosen["held"], *states, *chosen.get("measured", ())}, chosen["airspeed"]
    )
    chosen["held"] |= held
    chosen["measured"] = (*chosen.get("measured", ()), *measured)
    chosen.setdefault(
        "outputs", _outputs(record, states, chosen["frame"], chosen["instruments"].channels)
    )
    return IdentificationModel(airframe, **chosen)


def kinematics_of(record: Record, **options: Any) -> Kinematics:
    """Return the kinematic model of a record, for `jaxid.consistency`.

    Its outputs are the kinematic outputs that the record has. A record without ay, p and r is one
    of symmetric flight (`longitudinal=True`), which has no sideslip, bank and heading.

    Args:
        record: a record or a stack.
        options: options of `Kinematics`; by default V is the true airspeed and beta the sideslip.

    Raises:
        InputError: if none of V, alpha, beta, phi, pitch, psi, altitude is an output of the record;
            if it has some of beta, phi, psi but none of ay, p, r, and neither `longitudinal` nor
            `instruments` is given; as `Kinematics`.
    """
    symmetric = not {"ay", "p", "r"} & {*record.inputs, *record.outputs}
    longitudinal = bool(options.get("longitudinal", symmetric))
    possible = LONGITUDINAL_OUTPUTS if longitudinal else KINEMATIC_OUTPUTS
    outputs = tuple(name for name in possible if name in record.outputs)
    unused = [name for name in KINEMATIC_OUTPUTS if name in record.outputs and name not in outputs]
    require(
        not unused or bool({"longitudinal", "instruments"} & options.keys()),
        f"Record {record.names[0]!r} has {', '.join(unused)}, but none of ay, p and r, from which "
        "they follow. Add those channels, or give `longitudinal=True` to leave out the lateral "
        "outputs.",
    )
    require(
        len(outputs) > 0,
        f"Record {record.names[0]!r} has none of {', '.join(possible)} among its "
        "outputs, so that accelerations and rates have nothing to agree with. Measure one of them.",
    )
    chosen: dict[str, Any] = {"instruments": Instruments(outputs), "longitudinal": longitudinal}
    chosen.update(options)
    return Kinematics(**chosen)


def _instruments(given: Instruments | Mapping[str, Any]) -> Instruments:
    """Return instruments, also from their arguments."""
    if isinstance(given, Instruments):
        return given
    known = tuple(inspect.signature(Instruments).parameters)
    require_known("argument of `Instruments`", given, known)
    return Instruments(**given)


def _states(record: Record, states: Any, frame: str) -> tuple[str, ...]:
    """Return the states by name.

    A group has the heading only if it is measured, because no other equation depends on it.
    """
    if not isinstance(states, str):
        return tuple(states)
    return tuple(
        name for name in group_states(states, frame) if name != "psi" or "psi" in record.outputs
    )


def _constants(record: Record, given: Mapping[str, float | None], across: bool) -> dict[str, float]:
    """Return mass and size from arguments and the record's constants."""
    recorded = {name: float(record.constants[name]) for name in given if name in record.constants}
    known = recorded | {name: float(value) for name, value in given.items() if value is not None}
    _require_same(record, recorded, known)
    known.setdefault("Ixz", 0.0)
    if not across and "Iy" in known:  # (Iz - Ix) p r vanishes, and the body is plausible
        known.setdefault("Ix", known.get("Iz", known["Iy"]))
        known.setdefault("Iz", known["Ix"])
    _require_needed(record, known)
    return known


def _require_same(
    record: Record, recorded: Mapping[str, float], known: Mapping[str, float]
) -> None:
    """Refuse an argument that differs from the record's constant."""
    for name, value in recorded.items():
        require(
            bool(np.isclose(known[name], value, rtol=1e-6, atol=0.0)),
            f"Record {record.names[0]!r} has {name} = {value:.6g}, and the argument is "
            f"{known[name]:.6g}. The constants of a record take precedence: leave the argument "
            "out, or change the record by `dataclasses.replace(record, "
            f"constants={{**record.constants, {name!r}: jnp.asarray(...)}})`.",
        )


def _require_needed(record: Record, known: Mapping[str, float]) -> None:
    """Refuse a record without mass or size if no argument gives them."""
    lacks = [name for name in REQUIRED_CONSTANTS if name not in known]
    units = dict.fromkeys(CONSTANT_UNITS.get(name, "kg m^2") for name in lacks)
    require(
        not lacks,
        f"Record {record.names[0]!r} lacks {', '.join(lacks)}. Give the numbers: "
        "`model_of(record, "
        + ", ".join(f"{name}=..." for name in lacks)
        + f")` in {', '.join(units)}. "
        f"Its constants are {', '.join(record.constants) or 'none'}.",
    )


def _held(record: Record, states: tuple[str, ...], held: Mapping[str, Any]) -> dict[str, Any]:
    """Return the held constants.

    These are the given ones, surfaces that move no equation, and the lateral variables of symmetric
    flight.
    """
    held, has = dict(held), {*record.inputs, *record.outputs, *held}
    for name in SURFACES:
        if name not in has:
            _require_no_influence(record, name, states)
            held[name] = 0.0
    if not {*LATERAL_STATES} & {*states}:
        sideways = "beta" if {"V", "alpha"} & {*states} else "v"
        has = has | ({sideways} if "beta" in has else set())
        held |= {
            name: 0.0
            for name in (sideways, "p", "r", "phi")
            if name not in has and name not in states
        }
    return held


def _require_no_influence(record: Record, surface: str, states: tuple[str, ...]) -> None:
    """Refuse a record without a surface that affects an equation."""
    affected = [state for state in AFFECTED_BY_SURFACE[surface] if state in states]
    require(
        not affected,
        f"Record {record.names[0]!r} has no {surface}, and it affects the equations of "
        f"{', '.join(affected)}. Read it as an input, hold it if it did not move "
        f"(`held={{{surface!r}: 0.0}}`), or leave those states out.",
    )


def _thrust_and_air(
    record: Record, placed: set[str], airspeed: str
) -> tuple[tuple[str, ...], dict[str, float]]:
    """Return which of thrust, density and altitude are measured, and the held values.

    Names that have a role already are left out.
    """
    measured, held = [], {}
    if "thrust" not in placed:
        if "thrust" in (*record.inputs, *record.outputs):
            measured.append("thrust")
        elif "thrust" in record.constants:
            held["thrust"] = float(record.constants["thrust"])
    more, constant = air_known(record, placed, airspeed)
    return (*measured, *more), held | constant


def _outputs(
    record: Record, states: tuple[str, ...], frame: str, instruments: tuple[str, ...]
) -> tuple[str, ...]:
    """Return the channels of the record that depend on a state."""
    owner = owners(frame)
    return tuple(
        name
        for name in CHANNELS
        if name in instruments
        and name in record.outputs
        and name not in ANGULAR
        and owner.get(name) in states
    )
