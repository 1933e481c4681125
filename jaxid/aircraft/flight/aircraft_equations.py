"""Equations of a rigid aircraft: flow, forces, accelerations and their signals."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp

from ..._foundation.types import Array, Float
from ..air.atmosphere import GRAVITY, AbstractAtmosphere
from ..air.turbulence import GUSTS
from ..air.wind import AbstractWind
from ..physics.frames import air_angle_rates, euler_of
from ..physics.rigid_body import accelerations, specific_force
from ..vehicle.aerodynamics import COEFFICIENTS
from ..vehicle.air_relative import flow
from ..vehicle.airframe import Airframe, aerodynamic_loads
from ..vehicle.engine import Engine, loads
from ..vehicle.force_derivatives import AFFECTED_STATES, effectiveness

RIGID = ("u", "v", "w", "p", "q", "r", "e0", "e1", "e2", "e3", "north", "east", "altitude")
# m^2/s^2; chosen: keeps the derivative of gamma finite in vertical flight
MIN_SPEED_SQUARED = 1e-12

Signals = dict[str, Float[Array, ""]]


class AircraftState(NamedTuple):
    """State of an aircraft, separated.

    Attributes:
        rigid: of the rigid body.
        controls: of the control system.
        engines: of each engine.
    """

    rigid: Float[Array, " state"]
    controls: Float[Array, " state"]
    engines: list[Float[Array, " state"]]


class AircraftInput(NamedTuple):
    """Input of an aircraft, separated.

    Attributes:
        pilot: commands of the three surfaces.
        engines: inputs of each engine.
        disturbances: by name.
    """

    pilot: Float[Array, " input"]
    engines: list[Float[Array, " input"]]
    disturbances: dict[str, Float[Array, ""]]


def flow_signals(
    airframe: Airframe,
    atmosphere: AbstractAtmosphere,
    wind: AbstractWind,
    rigid: Float[Array, "13"],
    T: Float[Array, "3 3"],
    disturbances: Signals,
) -> Signals:
    """Return motion relative to ground and air, and the pressures of the flow, by name.

    Args:
        airframe: size of the aircraft.
        atmosphere: properties of the air at an altitude.
        wind: velocity of the air over ground.
        rigid: states in the order of `RIGID` [SI].
        T: rotation from earth to body axes.
        disturbances: gusts [m/s, rad/s] and buffet by name.
    """
    altitude = rigid[12]
    air_velocity = (
        rigid[:3] - T @ wind.velocity(altitude) - jnp.stack([disturbances[g] for g in GUSTS[:3]])
    )
    air_omega = rigid[3:6] - jnp.stack([disturbances[g] for g in GUSTS[3:]])
    phi, pitch, psi = euler_of(T)
    climb = -(T.T @ rigid[:3])[2]
    horizontal = jnp.sqrt(jnp.maximum(jnp.dot(rigid[:3], rigid[:3]) - climb**2, MIN_SPEED_SQUARED))
    return disturbances | {
        **dict(zip(("u", "v", "w", "p", "q", "r"), rigid[:6], strict=True)),
        **flow(airframe, atmosphere.air(altitude), air_velocity, air_omega),
        **{"phi": phi, "pitch": pitch, "psi": psi, "altitude": altitude},
        **{"gamma": jnp.arctan2(climb, horizontal)},
    }


def body_accelerations(
    airframe: Airframe,
    engines: Sequence[Engine],
    thrusts: Sequence[Float[Array, ""]],
    rigid: Float[Array, "13"],
    T: Float[Array, "3 3"],
    signals: Signals,
) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Return the rates of velocity [m/s^2] and angular rate [rad/s^2] in body axes.

    Args:
        airframe: mass, inertia and size.
        engines: engines.
        thrusts: thrust of each engine [N].
        rigid: states in the order of `RIGID` [SI].
        T: rotation from earth to body axes.
        signals: `qbar` [Pa] and the six coefficients.
    """
    mass = airframe.mass_properties
    coefficients = jnp.stack([signals[name] for name in COEFFICIENTS])
    force, moment = aerodynamic_loads(airframe, signals["qbar"], coefficients)
    engine_force, engine_moment, momentum = loads(engines, thrusts)
    force = force + engine_force + mass.mass * GRAVITY * T[:, 2]
    moment = moment + engine_moment
    return accelerations(mass.mass, mass.inertia(), rigid[:3], rigid[3:6], force, moment, momentum)


def inertial_signals(
    rigid: Float[Array, "13"],
    T: Float[Array, "3 3"],
    vdot: Float[Array, "3"],
    omegadot: Float[Array, "3"],
) -> Signals:
    """Return specific force at the centre of gravity and angular acceleration by name.

    Args:
        rigid: states in the order of `RIGID` [SI].
        T: rotation from earth to body axes.
        vdot: rate of the velocity in body axes [m/s^2].
        omegadot: angular acceleration [rad/s^2].
    """
    force = specific_force(vdot, rigid[:3], rigid[3:6], GRAVITY * T[:, 2])
    values = jnp.concatenate([force, omegadot])
    return dict(zip(("ax", "ay", "az", "pdot", "qdot", "rdot"), values, strict=True))


def coefficient_derivatives(airframe: Airframe, qbar: Float[Array, ""]) -> Signals:
    """Return the derivatives of the state rates by each coefficient, `p_per_Cl` and so on.

    Inertial coupling is included.

    Args:
        airframe: mass, inertia and size.
        qbar: dynamic pressure [Pa].
    """
    slopes = effectiveness(airframe, qbar, airframe.mass_properties.inertia())
    return {
        f"{state}_per_{coefficient}": slopes[COEFFICIENTS.index(coefficient), RIGID.index(state)]
        for coefficient, states in AFFECTED_STATES.items()
        for state in states
    }


def reduced_angle_rates(
    airframe: Airframe, rigid: Float[Array, "13"], vdot: Float[Array, "3"], signals: Signals
) -> Signals:
    """Return the reduced rates of alpha and beta in air that moves steadily over ground [rad].

    Args:
        airframe: mean chord and span.
        rigid: states in the order of `RIGID` [SI].
        vdot: rate of the velocity in body axes [m/s^2].
        signals: velocity relative to the air, `u_air v_air w_air`, and `V` [m/s].
    """
    velocity = jnp.stack([signals[name] for name in ("u_air", "v_air", "w_air")])
    # a steady wind rotates relative to the body axes
    change = vdot + jnp.cross(rigid[3:6], rigid[:3] - velocity)
    alphadot, betadot = air_angle_rates(velocity, change)
    reduced = 1.0 / (2.0 * signals["V"])
    return {
        "alphadot_hat": alphadot * airframe.cbar * reduced,
        "betadot_hat": betadot * airframe.b * reduced,
    }
