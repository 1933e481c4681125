"""Trim: surfaces, engine setting and attitude of steady level flight, climb, turn and pull-up."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from ..._foundation.checks import InputError, require
from ..._foundation.traced_checks import require_value
from ..._foundation.types import Array, Float
from ...simulation.trim import Trim, solve_equilibrium
from ..air.atmosphere import GRAVITY
from ..physics.frames import quaternion, rotation, velocity
from ..vehicle.controls import SURFACES, ControlSystem
from ..vehicle.engine import ConstantThrust
from .aircraft import Aircraft

Scalar = Float[Array, ""] | float

ACCELERATIONS = {
    **dict.fromkeys(("udot", "vdot", "wdot"), "m/s^2"),
    **dict.fromkeys(("pdot", "qdot", "rdot"), "rad/s^2"),
}
EQUATION_UNITS = {**ACCELERATIONS, "ay": "m/s^2"}
ANGLE_LIMITS = {  # chosen: range of the search [rad, rad/s]
    "alpha": (np.radians(-20.0), np.radians(90.0)),
    "beta": (np.radians(-30.0), np.radians(30.0)),
    "phi": (np.radians(-89.0), np.radians(89.0)),
    "pitch": (np.radians(-89.0), np.radians(89.0)),
    "turn_rate": (-2.0, 2.0),
}
STARTS_DEG = (6.0, 20.0, 40.0, 1.0)  # chosen: initial angles of attack, one after the other
# chosen, times the weight: upper limit of the thrust of an engine without limits
MAX_THRUST = 2.0
TRIM_TOLERANCE = 1e-9  # m/s^2 and rad/s^2; far above rounding
# chosen: small scales, so that a failed trim satisfies these and shows the unbalanced acceleration
KINEMATIC_SCALES = {"climb": 0.01, "ay": 0.1}
TRIM_REMEDY = (
    "Choose another speed or altitude, or less bank, climb or load factor, or give the aircraft "
    "more thrust, control travel or lift there."
)


class Trimmed(NamedTuple):
    """Aircraft in steady flight.

    Attributes:
        aircraft: aircraft with surfaces and engines set; without input it stays in steady flight
            from `state`.
        state: full state, control system and engines at rest.
        trim: the unknowns by name (`alpha`, `pitch`, `stabilator`, `setting` ...), the residual of
            the equations, and the status.
    """

    aircraft: Aircraft
    state: Float[Array, "*case state"]
    trim: Trim


def level(
    aircraft: Aircraft, V: Scalar, altitude: Scalar, *, beta: Scalar | None = 0.0, **options: Any
) -> Trimmed:
    """Trim for straight and level flight: `climb` at a flight path angle of zero.

    Args:
        aircraft: aircraft to trim; its feedback is out of the loop.
        V: true airspeed [m/s].
        altitude: altitude [m].
        beta: sideslip [rad]; None solves for the sideslip without side force.
        options: `setting_limits`, `heading` and `throw` of `climb`.

    Returns:
        Aircraft, state and trim.

    Raises:
        InputError: as `climb`.
    """
    return climb(aircraft, V, altitude, 0.0, beta=beta, **options)


def climb(
    aircraft: Aircraft,
    V: Scalar,
    altitude: Scalar,
    gamma: Scalar,
    *,
    beta: Scalar | None = 0.0,
    **options: Any,
) -> Trimmed:
    """Trim for a steady straight climb or descent.

        udot = vdot = wdot = pdot = qdot = rdot = 0,    p = q = r = 0,    climb rate = V sin(gamma)

    The unknowns are alpha, pitch, phi, the three surfaces and the engines' setting (phi is not zero
    if sideslip is given and the aircraft is asymmetric). The density is constant, at this altitude.

    Args:
        aircraft: aircraft to trim; its feedback is out of the loop.
        V: true airspeed [m/s].
        altitude: altitude [m].
        gamma: flight path angle relative to the air [rad].
        beta: sideslip [rad]; None solves for the sideslip without side force.
        options: `setting_limits`, lower and upper limit of the engines' setting, by default the
            limits of the engine or, for a setting that is a thrust [N], zero to twice the weight;
            `heading` [rad], zero by default; `throw`, True by default, to raise an error for a
            failed trim (outside of `jit` and `vmap`).

    Returns:
        Aircraft, state and trim. Works under `jit`, `vmap` and `jacfwd`; in a batch a failed case
        does not affect the others.

    Raises:
        InputError: if the flight cannot be trimmed, with the equation that is out of balance and
            the unknown at its limit; or if V is not positive.
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

        (p, q, r) = psidot (-sin(pitch), sin(phi) cos(pitch), cos(phi) cos(pitch))
        climb rate = V sin(gamma)
        udot = vdot = wdot = pdot = qdot = rdot = 0
        ay = r u - p w - g sin(phi) cos(pitch) = 0    in a coordinated turn

    The unknowns are alpha, beta, pitch, the bank or the turn rate (the one that is not given),
    surfaces and setting.

    Args:
        aircraft: aircraft to trim; its feedback is out of the loop.
        V: true airspeed [m/s].
        altitude: altitude [m].
        bank: phi, positive to the right [rad]; or
        turn_rate: psidot, positive to the right [rad/s].
        gamma: flight path angle relative to the air [rad].
        beta: sideslip [rad]; by default the sideslip of a coordinated turn, without side force.
        options: as in `climb`.

    Returns:
        Aircraft, state and trim.

    Raises:
        InputError: if both or neither of bank and turn rate are given, and as `climb`.

    Source: B. L. Stevens, F. L. Lewis, Aircraft Control and Simulation, 2nd ed., Wiley 2003,
    section 3.6 (constraints).
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
    """Trim for an instant of a wings-level pull-up (or push-over) with constant speed and alpha.

        Vdot = alphadot = betadot = pdot = qdot = rdot = 0
        at q = g (n - cos(gamma))/V,  p = r = phi = 0

    In body axes this is `udot = vdot = wdot = 0`. The unknowns are alpha, beta, pitch, surfaces and
    setting.

    Args:
        aircraft: aircraft to trim; its feedback is out of the loop.
        V: true airspeed [m/s].
        altitude: altitude [m].
        load_factor: n, load factor normal to the flight path, one in level flight; or
        pitch_rate: q [rad/s].
        gamma: flight path angle at this instant [rad].
        options: as in `climb`.

    Returns:
        Aircraft, state and trim; the flight path rotates with q, so the flight is steady at this
        instant only.

    Raises:
        InputError: if both or neither of load factor and pitch rate are given, and as `climb`.
    """
    require(
        (load_factor is None) != (pitch_rate is None),
        "Give a pull-up either its load factor or its pitch rate.",
    )
    q = (
        GRAVITY * (load_factor - jnp.cos(jnp.asarray(gamma, float))) / V
        if load_factor is not None
        else pitch_rate
    )
    given = {"V": V, "altitude": altitude, "gamma": gamma, "turn_rate": 0.0, "pull": q, "phi": 0.0}
    return _trim("a pull-up", aircraft, given, {"beta": 0.0}, None, **options)


class _Motion(NamedTuple):
    """Motion of a steady flight in body axes.

    Attributes:
        ground: velocity over ground [m/s].
        omega: angular rate [rad/s].
        attitude: quaternion of the attitude.
        through_air: velocity relative to the air [m/s].
        wind: velocity of the wind [m/s].
    """

    ground: Float[Array, "3"]
    omega: Float[Array, "3"]
    attitude: Float[Array, "4"]
    through_air: Float[Array, "3"]
    wind: Float[Array, "3"]


class _SteadyFlight(eqx.Module):
    """A steady flight: given values, names of the unknowns, and names of the equations."""

    aircraft: Aircraft
    given: dict[str, Float[Array, ""]]
    unknown: tuple[str, ...] = eqx.field(static=True)
    equations: tuple[str, ...] = eqx.field(static=True)

    def at(self, values: Float[Array, " unknown"]) -> dict[str, Float[Array, ""]]:
        """Return all variables of the flight, given and unknown, by name."""
        return self.given | dict(zip(self.unknown, values, strict=True))

    def motion(self, flight) -> _Motion:
        """Return ground velocity, angular rate, attitude, airspeed and wind in body axes."""
        e = quaternion(flight["phi"], flight["pitch"], flight["heading"])
        T = rotation(e)
        through_air = velocity(flight["V"], flight["alpha"], flight["beta"])
        wind = T @ self.aircraft.wind.velocity(flight["altitude"])
        omega = flight["turn_rate"] * T[:, 2] + flight["pull"] * jnp.array([0.0, 1.0, 0.0])
        return _Motion(through_air + wind, omega, e, through_air, wind)

    def residual(self, values: Float[Array, " unknown"]) -> Float[Array, " equation"]:
        flight = self.at(values)
        ground, omega, e, through_air, wind = self.motion(flight)
        surfaces = {name: flight[name] for name in SURFACES}
        rates = self.aircraft.steady_rates(
            ground, omega, e, flight["altitude"], surfaces, flight["setting"]
        )
        down = rotation(e)[:, 2]
        # The motion relative to the air is steady; a constant wind rotates in body axes.
        air_acceleration = rates[:3] + jnp.cross(omega, wind)
        values = jnp.concatenate([air_acceleration, rates[3:]])
        residuals = dict(zip(ACCELERATIONS, values, strict=True))
        residuals["climb"] = jnp.dot(through_air, down) / flight["V"] + jnp.sin(flight["gamma"])
        residuals["ay"] = (jnp.cross(omega, through_air) - GRAVITY * down)[1]
        return jnp.stack([residuals[name] for name in self.equations])


def _residual(values, flight: _SteadyFlight):
    return flight.residual(values)


def _trim(
    kind, aircraft, given, guess, beta, *, setting_limits=None, heading=0.0, throw=True
) -> Trimmed:
    """Trim a flight from different initial angles of attack.

    `guess` has the unknowns in addition to alpha, pitch, surfaces and setting.
    """
    given = given | {"heading": heading}
    given = {name: jnp.asarray(value, float) for name, value in given.items()}
    require_value(given["V"], lambda V: V > 0, "The speed is {} m/s; it must be positive.")
    equations = (*ACCELERATIONS, "climb")
    if "beta" not in guess and beta is not None:
        given["beta"] = jnp.asarray(beta, float)
    elif "beta" not in guess:
        guess, equations = guess | {"beta": 0.0}, (*equations, "ay")
    limits = _limits(aircraft, setting_limits)
    low, high = limits["setting"]
    guess = {
        "alpha": 0.0,
        "pitch": 0.0,
        **guess,
        **dict.fromkeys(SURFACES, 0.0),
        "setting": low + 0.15 * (high - low),
    }
    flight = _SteadyFlight(aircraft, given, tuple(guess), equations)
    trim = solve_equilibrium(
        _residual,
        _starts(given, guess),
        flight,
        names=flight.unknown,
        units=_units(flight),
        equations=equations,
        equation_units=[EQUATION_UNITS.get(name, "") for name in equations],
        equation_scale=jnp.array([KINEMATIC_SCALES.get(name, 1.0) for name in equations]),
        lower=jnp.stack([jnp.asarray(limits[name][0], float) for name in flight.unknown]),
        upper=jnp.stack([jnp.asarray(limits[name][1], float) for name in flight.unknown]),
        tolerance=TRIM_TOLERANCE,
        remedy=TRIM_REMEDY,
        throw=False,
    )
    if throw:
        _require_balanced(trim, kind, given)
    return _set(flight, trim)


def _starts(given, guess) -> Float[Array, "start unknown"]:
    """Return the initial guesses, one row for each angle of attack."""
    bank = jnp.cos(given.get("phi", jnp.zeros(())))
    starts = [
        guess | {"alpha": alpha, "pitch": alpha * bank + given["gamma"]}
        for alpha in np.radians(STARTS_DEG)
    ]
    return jnp.stack(
        [jnp.stack([jnp.asarray(value, float) for value in start.values()]) for start in starts]
    )


def _units(flight: _SteadyFlight) -> list[str]:
    """Return the units of the unknowns: all are angles except the turn rate and the setting."""
    is_force = isinstance(flight.aircraft.engines[0].source, ConstantThrust)
    units = {"turn_rate": "rad/s", "setting": "N" if is_force else ""}
    return [units.get(name, "rad") for name in flight.unknown]


def _require_balanced(trim: Trim, kind: str, given) -> None:
    """Refuse a failed trim; inside a transformation the values are not known."""
    if not isinstance(trim.values, Tracer) and not bool(trim.successful):
        condition = (
            f"V = {float(given['V']):.4g} m/s and an altitude of {float(given['altitude']):.4g} m"
        )
        raise InputError(
            f"The aircraft cannot be trimmed for {kind} at {condition}: {trim.explain()}"
        )


def _set(flight: _SteadyFlight, trim: Trim) -> Trimmed:
    """Return the aircraft with the settings of a trim, and its state."""
    values = flight.at(trim.values)
    aircraft = flight.aircraft.trimmed({name: values[name] for name in SURFACES}, values["setting"])
    ground, omega, e, *_ = flight.motion(values)
    position = jnp.stack([jnp.zeros(()), jnp.zeros(()), values["altitude"]])
    return Trimmed(aircraft, aircraft.flight_state(ground, omega, e, position), trim)


def _limits(aircraft: Aircraft, setting_limits) -> dict:
    """Return lower and upper limits of all unknowns: surfaces, engine setting and angles."""
    stops = dict.fromkeys(SURFACES, (-np.pi / 2, np.pi / 2)) | aircraft.airframe.limits
    if isinstance(aircraft.controls, ControlSystem):
        actuators = zip(SURFACES, aircraft.controls.actuators, strict=True)
        stops = {name: (actuator.lower, actuator.upper) for name, actuator in actuators}
    if setting_limits is None:
        largest = MAX_THRUST * aircraft.airframe.mass_properties.mass * GRAVITY
        setting_limits = getattr(aircraft.engines[0].source, "limits", (0.0, largest))
    low, high = setting_limits
    return ANGLE_LIMITS | stops | {"setting": (jnp.asarray(low, float), jnp.asarray(high, float))}
