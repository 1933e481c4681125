"""Steady flight: surfaces, engine setting and attitude at which an aircraft flies level, climbs, turns or pulls up."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._foundation.checks import InputError, require
from .._foundation.concrete import require_value
from .._foundation.types import Array, Float
from ..simulation.trim import Trim, balance
from .aircraft import Aircraft
from .atmosphere import GRAVITY
from .controls import SURFACES, ControlSystem
from .engine import ConstantThrust
from .frames import quaternion, rotation, velocity

Scalar = Float[Array, ""] | float

ACCELERATIONS = {
    **dict.fromkeys(("udot", "vdot", "wdot"), "m/s^2"),
    **dict.fromkeys(("pdot", "qdot", "rdot"), "rad/s^2"),
}
ANGLES = {  # limits of our choice: where a search may look [rad, rad/s]
    "alpha": (np.radians(-20.0), np.radians(90.0)),
    "beta": (np.radians(-30.0), np.radians(30.0)),
    "phi": (np.radians(-89.0), np.radians(89.0)),
    "pitch": (np.radians(-89.0), np.radians(89.0)),
    "turn_rate": (-2.0, 2.0),
}
STARTS_DEG = (6.0, 20.0, 40.0, 1.0)  # angles of attack from which the search begins, in turn
MOST_THRUST = 2.0  # of the weight: upper limit of an engine whose setting is its push and that states none
TOLERANCE = 1e-9  # m/s^2 and rad/s^2
KINEMATIC = {
    "climb": 0.01,
    "ay": 0.1,
}  # scales: small, so that a failed trim keeps these and shows which acceleration is left
REMEDY = (
    "Ask for another speed or altitude, for less bank, climb or load factor, or give the aircraft what it lacks there "
    "(thrust, control travel, lift)."
)


class Trimmed(NamedTuple):
    """An aircraft in steady flight.

    Attributes:
        aircraft: with surfaces and engines set; it flies on steadily from `state` without input.
        state: full state, control system and engines at rest.
        trim: the unknowns by name (`alpha`, `pitch`, `stabilator`, `setting` ...), what is left of the equations, and the status.
    """

    aircraft: Aircraft
    state: Float[Array, "*case state"]
    trim: Trim


def level(aircraft: Aircraft, V: Scalar, altitude: Scalar, *, beta: Scalar | None = 0.0, **options: Any) -> Trimmed:
    """Trim for straight and level flight: `climb` at a flight path angle of zero.

    Args:
        aircraft: whose trim settings are sought; its feedback is out of the loop.
        V: true airspeed [m/s].
        altitude: [m].
        beta: sideslip [rad]; None seeks that without side force.
        options: `setting_limits`, `heading` and `throw` of `climb`.

    Returns:
        Aircraft, state and trim.

    Raises:
        InputError: as `climb`.
    """
    return climb(aircraft, V, altitude, 0.0, beta=beta, **options)


def climb(
    aircraft: Aircraft, V: Scalar, altitude: Scalar, gamma: Scalar, *, beta: Scalar | None = 0.0, **options: Any
) -> Trimmed:
    """Trim for a steady straight climb or descent.

        udot = vdot = wdot = pdot = qdot = rdot = 0,    p = q = r = 0,    climb rate = V sin(gamma)

    Unknown are alpha, pitch, phi, the three surfaces and the engines' setting (phi is not zero where sideslip is given and
    the aircraft is not symmetric). The density is held at this altitude.

    Args:
        aircraft: whose trim settings are sought; its feedback is out of the loop.
        V: true airspeed [m/s].
        altitude: [m].
        gamma: flight path angle relative to the air [rad].
        beta: sideslip [rad]; None seeks that without side force.
        options: `setting_limits`, lower and upper limit of the engines' setting, by default the engine's own or, for a setting
            that is a thrust [N], zero to twice the weight; `heading` [rad], zero by default; `throw`, whether to raise where it
            fails (outside of `jit` and `vmap`), True by default.

    Returns:
        Aircraft, state and trim. Works under `jit`, `vmap` and `jacfwd`, and a case that fails fails alone.

    Raises:
        InputError: when there is no such flight: which equation is out of balance by how much, and which unknown stands at
            its limit; or when V is not positive.
    """
    given = {"V": V, "altitude": altitude, "gamma": gamma, "turn_rate": 0.0, "pull": 0.0}
    guess = {"phi": 0.0}
    return _trim("straight flight", aircraft, given, guess, beta, **options)


def turn(
    aircraft: Aircraft,
    V: Scalar,
    altitude: Scalar,
    *,
    bank: Scalar | None = None,
    turn_rate: Scalar | None = None,
    gamma: Scalar = 0.0,
    beta: Scalar | None = None,
    **options: Any,
) -> Trimmed:
    """Trim for a steady turn, level or along a helix.

        (p, q, r) = psidot (-sin(pitch), sin(phi) cos(pitch), cos(phi) cos(pitch)),    climb rate = V sin(gamma)
        udot = vdot = wdot = pdot = qdot = rdot = 0,    ay = r u - p w - g sin(phi) cos(pitch) = 0 where coordinated

    Unknown are alpha, beta, pitch, the bank or the turn rate (whichever is not given), surfaces and setting.

    Args:
        aircraft: whose trim settings are sought; its feedback is out of the loop.
        V: true airspeed [m/s].
        altitude: [m].
        bank: phi, positive to the right [rad]; or
        turn_rate: psidot, positive to the right [rad/s].
        gamma: flight path angle relative to the air [rad].
        beta: sideslip [rad]; by default that of a coordinated turn, without side force.
        options: as in `climb`.

    Returns:
        Aircraft, state and trim.

    Raises:
        InputError: when both or neither of bank and turn rate are given, and as `climb`.

    Source: B. L. Stevens, F. L. Lewis, Aircraft Control and Simulation, 2nd ed., Wiley 2003, section 3.6 (constraints).
    """
    require((bank is None) != (turn_rate is None), "Give a turn either its bank or its turn rate.")
    given = {"V": V, "altitude": altitude, "gamma": gamma, "pull": 0.0}
    if bank is not None:
        given["phi"] = bank
        guess = {"turn_rate": GRAVITY * jnp.tan(jnp.asarray(bank, float)) / V}
    else:
        given["turn_rate"] = turn_rate
        guess = {"phi": jnp.arctan(V * jnp.asarray(turn_rate, float) / GRAVITY)}
    return _trim("a turn", aircraft, given, guess, beta, **options)


def pull_up(
    aircraft: Aircraft,
    V: Scalar,
    altitude: Scalar,
    *,
    load_factor: Scalar | None = None,
    pitch_rate: Scalar | None = None,
    gamma: Scalar = 0.0,
    **options: Any,
) -> Trimmed:
    """Trim for the instant of a wings-level pull-up (or push-over) in which speed and angle of attack stand still.

        Vdot = alphadot = betadot = pdot = qdot = rdot = 0    at q = g (n - cos(gamma))/V,  p = r = phi = 0

    which in body axes is `udot = vdot = wdot = 0`. Unknown are alpha, beta, pitch, surfaces and setting.

    Args:
        aircraft: whose trim settings are sought; its feedback is out of the loop.
        V: true airspeed [m/s].
        altitude: [m].
        load_factor: n, of the force normal to the flight path, one in level flight; or
        pitch_rate: q [rad/s].
        gamma: flight path angle at this instant [rad].
        options: as in `climb`.

    Returns:
        Aircraft, state and trim; the flight path turns up with q, so that it is steady at this instant only.

    Raises:
        InputError: when both or neither of load factor and pitch rate are given, and as `climb`.
    """
    require((load_factor is None) != (pitch_rate is None), "Give a pull-up either its load factor or its pitch rate.")
    q = GRAVITY * (load_factor - jnp.cos(jnp.asarray(gamma, float))) / V if load_factor is not None else pitch_rate
    given = {"V": V, "altitude": altitude, "gamma": gamma, "turn_rate": 0.0, "pull": q, "phi": 0.0}
    return _trim("a pull-up", aircraft, given, {"beta": 0.0}, None, **options)


class _Flight(eqx.Module):
    """A steady flight: what is given, and the names of what is unknown and of what must vanish."""

    aircraft: Aircraft
    given: dict[str, Float[Array, ""]]
    unknown: tuple[str, ...] = eqx.field(static=True)
    equations: tuple[str, ...] = eqx.field(static=True)

    def at(self, values: Float[Array, " unknown"]) -> dict[str, Float[Array, ""]]:
        """All that describes the flight, given and unknown."""
        return self.given | dict(zip(self.unknown, values, strict=True))

    def motion(self, flight):
        """Velocity over ground, angular rate, attitude, and velocities of aircraft and wind, in body axes."""
        e = quaternion(flight["phi"], flight["pitch"], flight["heading"])
        T = rotation(e)
        through_air = velocity(flight["V"], flight["alpha"], flight["beta"])
        wind = T @ self.aircraft.wind.velocity(flight["altitude"])
        omega = flight["turn_rate"] * T[:, 2] + flight["pull"] * jnp.array([0.0, 1.0, 0.0])
        return through_air + wind, omega, e, through_air, wind

    def residual(self, values: Float[Array, " unknown"]) -> Float[Array, " equation"]:
        flight = self.at(values)
        ground, omega, e, through_air, wind = self.motion(flight)
        surfaces = {name: flight[name] for name in SURFACES}
        rates = self.aircraft.steady_rates(ground, omega, e, flight["altitude"], surfaces, flight["setting"])
        down = rotation(e)[:, 2]
        # Steady is the motion relative to the air; a constant wind turns with the body axes.
        of_air = rates[:3] + jnp.cross(omega, wind)
        left = dict(zip(ACCELERATIONS, jnp.concatenate([of_air, rates[3:]]), strict=True))
        left["climb"] = jnp.dot(through_air, down) / flight["V"] + jnp.sin(flight["gamma"])
        left["ay"] = (jnp.cross(omega, through_air) - GRAVITY * down)[1]
        return jnp.stack([left[name] for name in self.equations])


def _residual(values, flight: _Flight):
    return flight.residual(values)


def _trim(what, aircraft, given, guess, beta, *, setting_limits=None, heading=0.0, throw=True) -> Trimmed:
    """Balance the flight that is given, from several angles of attack; `guess` holds unknowns beside the usual ones."""
    given = given | {"heading": heading}
    given = {name: jnp.asarray(value, float) for name, value in given.items()}
    require_value(given["V"], lambda V: V > 0, "The speed is {} m/s; a trim needs one above zero.")
    equations = (*ACCELERATIONS, "climb")
    if "beta" not in guess and beta is not None:
        given["beta"] = jnp.asarray(beta, float)
    elif "beta" not in guess:
        guess, equations = guess | {"beta": 0.0}, (*equations, "ay")
    units = {"turn_rate": "rad/s", "setting": "N" if isinstance(aircraft.engines[0].source, ConstantThrust) else ""}
    limits = _limits(aircraft, setting_limits)
    low, high = limits["setting"]
    guess = {"alpha": 0.0, "pitch": 0.0, **guess, **dict.fromkeys(SURFACES, 0.0), "setting": low + 0.15 * (high - low)}
    flight = _Flight(aircraft, given, tuple(guess), equations)
    starts = [
        guess | {"alpha": alpha, "pitch": alpha * jnp.cos(given.get("phi", jnp.zeros(()))) + given["gamma"]}
        for alpha in np.radians(STARTS_DEG)
    ]
    found = balance(
        _residual,
        jnp.stack([jnp.stack([jnp.asarray(value, float) for value in start.values()]) for start in starts]),
        flight,
        names=flight.unknown,
        units=[units.get(name, "rad") for name in flight.unknown],
        equations=equations,
        equation_units=[{**ACCELERATIONS, "ay": "m/s^2"}.get(name, "") for name in equations],
        equation_scale=jnp.array([KINEMATIC.get(name, 1.0) for name in equations]),
        lower=jnp.stack([jnp.asarray(limits[name][0], float) for name in flight.unknown]),
        upper=jnp.stack([jnp.asarray(limits[name][1], float) for name in flight.unknown]),
        tolerance=TOLERANCE,
        remedy=REMEDY,
        throw=False,
    )
    if throw and not isinstance(found.values, Tracer) and not bool(found.successful):
        where = f"V = {float(given['V']):.4g} m/s and an altitude of {float(given['altitude']):.4g} m"
        raise InputError(f"The aircraft cannot be trimmed for {what} at {where}: {found.explain()}")
    return _set(flight, found)


def _set(flight: _Flight, found: Trim) -> Trimmed:
    """The aircraft with the settings that were found, and its state."""
    values = flight.at(found.values)
    aircraft = flight.aircraft.trimmed({name: values[name] for name in SURFACES}, values["setting"])
    ground, omega, e, *_ = flight.motion(values)
    place = jnp.stack([jnp.zeros(()), jnp.zeros(()), values["altitude"]])
    return Trimmed(aircraft, aircraft.flight_state(ground, omega, e, place), found)


def _limits(aircraft: Aircraft, setting_limits) -> dict:
    """Lower and upper limit of every unknown: the stops of the surfaces, the engine's setting, and angles."""
    stops = dict(aircraft.airframe.limits)
    if isinstance(aircraft.controls, ControlSystem):
        actuators = zip(SURFACES, aircraft.controls.actuators, strict=True)
        stops = {name: (actuator.lower, actuator.upper) for name, actuator in actuators}
    if setting_limits is None:
        most = MOST_THRUST * aircraft.airframe.mass_properties.mass * GRAVITY
        setting_limits = getattr(aircraft.engines[0].source, "limits", (0.0, most))
    low, high = setting_limits
    return ANGLES | stops | {"setting": (jnp.asarray(low, float), jnp.asarray(high, float))}
