"""`Aircraft`: the six-degree-of-freedom simulation model (chapter II, Table 2.1, Appendix D)."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.checks import require, require_known
from ..._foundation.types import Array, Float
from ...data.record import Record
from ...models.base import AbstractModel, canonical
from ...models.names import parameter_names
from ..air.atmosphere import GRAVITY, AbstractAtmosphere, StandardAtmosphere, true_airspeed
from ..air.buffet import Buffet
from ..air.turbulence import GUSTS
from ..air.wind import AbstractWind, Wind
from ..effects.coefficient_term import absent_terms
from ..effects.library import default_effects
from ..instruments.instruments import Instruments
from ..physics.frames import quaternion, quaternion_rate, rotation, velocity
from ..records.initial_channels import initial_channels
from ..vehicle.aerodynamics import COEFFICIENTS
from ..vehicle.airframe import Airframe
from ..vehicle.controls import SURFACES, AbstractControls, ControlSystem, standard_actuators
from ..vehicle.engine import ConstantThrust, Engine
from ..vehicle.force_derivatives import AFFECTED_STATES
from .aircraft_equations import (
    RIGID,
    AircraftInput,
    AircraftState,
    body_accelerations,
    coefficient_derivatives,
    flow_signals,
    inertial_signals,
    reduced_angle_rates,
)

DISTURBANCES = (*GUSTS, "buffet")
# channels that determine an initial state
INITIAL_CHANNELS = ("V", "alpha", "beta", "phi", "pitch", "psi", "p", "q", "r", "altitude")

Signals = dict[str, Float[Array, ""]]


class Aircraft(AbstractModel):
    r"""Rigid aircraft with aerodynamics, engines, control system, moving air and instruments.

        vdot = F/m - omega x v,         I omegadot = M - omega x (I omega + h)
        edot = E(omega) e,              position' = T' v
        F = qbar S (CX, CY, CZ) + thrust + weight
        M = qbar S (b Cl, cbar Cm, b Cn) + r_ref x F_aero + engines

    The aerodynamics depend on the velocity and the rotation relative to the air, which includes
    wind and gusts. States are those of the rigid body (`u v w p q r e0 e1 e2 e3 north east
    altitude`), of the control system and of the engines. Inputs are the pilot's
    (`pilot_stabilator`, `pilot_aileron`, `pilot_rudder`, added to the trim), the engine levers, and
    the chosen disturbances. Outputs are the channels of the instruments. Every number is an array
    leaf with a dotted name: `mass`, `Cm.alpha`, `controls.augmentation.yaw_gain`,
    `instruments.bias.q`.

    Args:
        airframe: mass, size and aerodynamics.
        engines: one or more engines; by default one of constant zero thrust, which `trims` sets.
        controls: trim, feedback and actuators, or `MeasuredSurfaces`; by default no feedback and
            first-order actuators.
        instruments: by default error-free ones at the centre of gravity.
        atmosphere: the standard atmosphere by default.
        wind: velocity of the air over ground; none by default.
        buffet: random normal force at high angle of attack; none by default.
        disturbances: inputs among `gust_u` to `gust_w` [m/s], `gust_p` to `gust_r` [rad/s] and
            `buffet`; the others are zero. None by default, because they are not recorded.

    Raises:
        InputError: without an engine, or for an unknown disturbance.

    Source: report App. D.1 with the corrections of its misprints (z moment, products of inertia).
    """

    airframe: Airframe
    engines: tuple[Engine, ...]
    controls: AbstractControls
    instruments: Instruments
    atmosphere: AbstractAtmosphere
    wind: AbstractWind
    buffet: Buffet
    disturbances: tuple[str, ...] = eqx.field(static=True)

    transparent: ClassVar[tuple[str, ...]] = ("airframe",)

    def __init__(
        self,
        airframe: Airframe,
        *,
        engines: tuple[Engine, ...] | None = None,
        controls: AbstractControls | None = None,
        instruments: Instruments | None = None,
        atmosphere: AbstractAtmosphere | None = None,
        wind: AbstractWind | None = None,
        buffet: Buffet | None = None,
        disturbances: Sequence[str] = (),
    ):
        require(
            engines is None or len(engines) > 0,
            "An aircraft has at least one engine; give one of zero thrust.",
        )
        require(
            controls is not None or bool(airframe.limits),
            f"Airframe {airframe.name!r} has no limits of its surfaces, which the standard "
            "actuators need. Give it `limits`, or controls such as `MeasuredSurfaces()`.",
        )
        self.airframe = airframe
        self.engines = (Engine(ConstantThrust(0.0)),) if engines is None else engines
        self.controls = (
            ControlSystem(standard_actuators(airframe.limits)) if controls is None else controls
        )
        self.instruments = Instruments() if instruments is None else instruments
        self.atmosphere = StandardAtmosphere() if atmosphere is None else atmosphere
        self.wind = Wind() if wind is None else wind
        self.buffet = Buffet() if buffet is None else buffet
        require_known("disturbance", disturbances, DISTURBANCES)
        self.disturbances = tuple(disturbances)

    @property
    def states(self) -> tuple[str, ...]:
        return RIGID + self.controls.states + self._of_engines("states")

    @property
    def inputs(self) -> tuple[str, ...]:
        return self.controls.inputs + self._of_engines("inputs") + self.disturbances

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.instruments.channels

    # The model ------------------------------------------------------------------------------------

    def rhs(self, t, x, u):
        return self.rhs_and_signals(t, x, u)[0]

    def signals(self, t, x, u):
        """Return all signals on which an instrument, coefficient or effect may depend, by name.

        Returns:
            Inputs and states; the signals of `air_relative.flow` (`alpha`, `beta`, `V`, `mach`,
            `qbar`, `phat`, `qhat`, `rhat` and others); surfaces [rad]; `thrust` [N]; the six
            coefficients with all contributions; the accelerations; the derivatives of the state
            rates by the coefficients in `AFFECTED_STATES`, `p_per_Cl` and so on; and `alphadot_hat`
            and `betadot_hat`, the rates of alpha and beta by these equations times `cbar/2V` and
            `b/2V`, with constant gusts [rad].
        """
        return self.rhs_and_signals(t, x, u)[1]

    def immediate_signals(self, t, x, u):
        """Return inputs, states, signals of the flow, and surfaces."""
        return self._immediate(x, u, rotation(self._split_state(x)[0][6:10]))

    def rhs_and_signals(self, t, x, u):
        rigid, control_states, engine_states = self._split_state(x)
        pilot, levers, _ = self._split_input(u)
        T = rotation(rigid[6:10])
        signals = self._immediate(x, u, T)
        thrusts = self._thrusts(engine_states, signals)
        signals |= {"thrust": jnp.sum(jnp.stack(thrusts))}
        signals |= dict(zip(COEFFICIENTS, self._coefficients(signals), strict=True))
        vdot, omegadot = body_accelerations(self.airframe, self.engines, thrusts, rigid, T, signals)
        signals |= inertial_signals(rigid, T, vdot, omegadot)
        signals |= coefficient_derivatives(self.airframe, signals["qbar"])
        signals |= reduced_angle_rates(self.airframe, rigid, vdot, signals)
        control_rates = self.controls.rates(t, control_states, pilot, signals)
        engine_rates = [
            engine.source.rates(states, lever, signals)
            for engine, states, lever in zip(self.engines, engine_states, levers, strict=True)
        ]
        attitude_rate = quaternion_rate(rigid[6:10], rigid[3:6])
        over_ground = T.T @ rigid[:3] * jnp.array([1.0, 1.0, -1.0])
        rates = [vdot, omegadot, attitude_rate, over_ground, control_rates, *engine_rates]
        return jnp.concatenate(rates), signals

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))

    def output_given(self, t, x, u, dx):
        rigid, _, engine_states = self._split_state(x)
        T = rotation(rigid[6:10])
        signals = self._immediate(x, u, T)
        signals |= {"thrust": jnp.sum(jnp.stack(self._thrusts(engine_states, signals)))}
        return self.instruments.read(signals | inertial_signals(rigid, T, dx[:3], dx[3:6]))

    def observe(self, t, y):
        return self.instruments.observe(t, y)

    def initial_state(self, record: Record) -> Float[Array, " state"]:
        """Return the state at the first valid samples, with controls and engines at rest in trim.

        A channel that the record lacks is taken from the record's constant of the same name, or is
        zero if there is no such constant. The speed must not be zero: in place of zero it is the
        speed at which a force coefficient of one carries the weight. The reading of the sideslip
        vane, `atan2(v, u)`, is converted to `asin(v/V)`. Errors of the instruments are ignored,
        because the estimation accounts for them.

        Args:
            record: record with this model's outputs.
        """
        measured = initial_channels(record)
        values = {
            name: jnp.asarray(measured.get(name, record.constants.get(name, 0.0)), float)
            for name in INITIAL_CHANNELS
        }
        air = self.atmosphere.air(values["altitude"])
        weight = self.airframe.mass_properties.mass * GRAVITY
        known = "V" in measured or "V" in record.constants
        default = jnp.sqrt(2.0 * weight / (air.density * self.airframe.S))
        V = true_airspeed(values["V"], air) if known else default
        e = quaternion(values["phi"], values["pitch"], values["psi"])
        beta = jnp.arctan(jnp.cos(values["alpha"]) * jnp.tan(values["beta"]))
        ground = velocity(V, values["alpha"], beta) + rotation(e) @ self.wind.velocity(
            values["altitude"]
        )
        position = jnp.stack([jnp.zeros(()), jnp.zeros(()), values["altitude"]])
        return self.flight_state(
            ground, jnp.stack([values["p"], values["q"], values["r"]]), e, position
        )

    def with_disturbance_inputs(self):
        """Return the aircraft with all three velocities of the air among its inputs."""
        added = (gust for gust in GUSTS[:3] if gust not in self.disturbances)
        return self.disturbed(*self.disturbances, *added)

    def effects(self):
        """Return the default candidate effects of an aircraft.

        These are terms that the coefficients do not have yet, `beta^2 in Cm` and so on, unsteady
        and separated flow, mass, thrust, wind, and positions of instruments. `aircraft_effects`
        returns all effects.
        """
        terms = absent_terms(self.airframe.aerodynamics.terms, AFFECTED_STATES)
        model = canonical(self)
        return (
            *terms,
            *default_effects(model, AFFECTED_STATES, parameter_names(model)),
        )

    def equations_with_terms(self):
        """Return no equations: terms that an equation of motion lacks belong to a coefficient."""
        return ()

    def units(self):
        names = {"u": "m/s", "v": "m/s", "w": "m/s", "p": "rad/s", "q": "rad/s", "r": "rad/s"}
        names |= {"north": "m", "east": "m", "altitude": "m"} | {
            f"pilot_{surface}": "rad" for surface in SURFACES
        }
        names |= {gust: "rad/s" if gust[-1] in "pqr" else "m/s" for gust in GUSTS}
        errors = self.instruments.parameter_units().items()
        parameters = {f"instruments.{name}": unit for name, unit in errors}
        return names | self.instruments.units() | parameters

    # Trim and start -------------------------------------------------------------------------------

    def steady_rates(
        self,
        velocity: Float[Array, "3"],
        omega: Float[Array, "3"],
        e: Float[Array, "4"],
        altitude: Float[Array, ""],
        surfaces: Mapping[str, Float[Array, ""]],
        setting: Float[Array, ""],
    ) -> Float[Array, "6"]:
        """Return the accelerations at fixed surfaces and engine setting, the residual of a trim.

        Feedback and actuators are out of the loop.

        Args:
            velocity: velocity over ground, body axes [m/s].
            omega: angular rate [rad/s].
            e: attitude, a unit quaternion.
            altitude: altitude [m].
            surfaces: stabilator, aileron and rudder [rad].
            setting: setting of every engine (the thrust [N] of a constant thrust).

        Returns:
            (udot, vdot, wdot) [m/s^2] and (pdot, qdot, rdot) [rad/s^2].
        """
        held = self.trimmed(surfaces, setting)
        position = jnp.stack([jnp.zeros(()), jnp.zeros(()), jnp.asarray(altitude, float)])
        return held.rhs(
            jnp.zeros(()),
            held.flight_state(velocity, omega, e, position),
            jnp.zeros(len(self.inputs)),
        )[:6]

    def trimmed(
        self, surfaces: Mapping[str, Float[Array, ""]], setting: Float[Array, ""]
    ) -> "Aircraft":
        """Return the aircraft with other trim settings.

        Args:
            surfaces: stabilator, aileron and rudder [rad].
            setting: setting of every engine (the thrust [N] of a constant thrust).
        """
        settings = jnp.stack([jnp.asarray(surfaces[name], float) for name in SURFACES])
        engines = tuple(
            eqx.tree_at(
                lambda e: e.source, engine, engine.source.trimmed(jnp.asarray(setting, float))
            )
            for engine in self.engines
        )
        return eqx.tree_at(lambda a: (a.controls.trim, a.engines), self, (settings, engines))

    @eqx.filter_jit
    def flight_state(
        self,
        velocity: Float[Array, "3"],
        omega: Float[Array, "3"],
        e: Float[Array, "4"],
        position: Float[Array, "3"],
    ) -> Float[Array, " state"]:
        """Return a state in flight with control system and engines at rest in their trim settings.

        Args:
            velocity: velocity over ground, body axes [m/s].
            omega: angular rate [rad/s].
            e: attitude, a unit quaternion.
            position: north, east and altitude [m].
        """
        return self._assemble(jnp.concatenate([velocity, omega, e, position]))

    def disturbed(self, *names: str) -> "Aircraft":
        """Return the aircraft with these disturbances as its disturbance inputs.

        Args:
            names: names among `DISTURBANCES`.
        """
        parts = {
            name: getattr(self, name)
            for name in ("engines", "controls", "instruments", "atmosphere", "wind", "buffet")
        }
        return Aircraft(self.airframe, **parts, disturbances=names)

    # Parts ----------------------------------------------------------------------------------------

    def _immediate(self, x, u, T: Float[Array, "3 3"]) -> Signals:
        """Return inputs, states, flow and surfaces; T is the rotation into body axes."""
        rigid, control_states, _ = self._split_state(x)
        pilot, _, disturbances = self._split_input(u)
        signals = dict(zip(self.states + self.inputs, jnp.concatenate([x, u]), strict=True))
        flow = flow_signals(self.airframe, self.atmosphere, self.wind, rigid, T, disturbances)
        return signals | flow | self.controls.positions(control_states, pilot)

    def _thrusts(self, engine_states, signals: Signals) -> list[Float[Array, ""]]:
        """Return the thrust of each engine [N]."""
        return [
            engine.thrust(states, signals)
            for engine, states in zip(self.engines, engine_states, strict=True)
        ]

    def _coefficients(self, signals: Signals) -> Float[Array, " coefficient"]:
        """Return the six coefficients, buffet included."""
        coefficients = self.airframe.aerodynamics.coefficients(signals)
        return coefficients.at[2].add(self.buffet.coefficient(signals))

    def _assemble(self, rigid: Float[Array, "13"]) -> Float[Array, " state"]:
        return jnp.concatenate(
            [rigid, self.controls.resting(), *(engine.source.resting() for engine in self.engines)]
        )

    def _of_engines(self, kind: str) -> tuple[str, ...]:
        """Return names of the engines' states or inputs, numbered if there is more than one."""
        numbered = len(self.engines) > 1
        return tuple(
            f"{name}_{i + 1}" if numbered else name
            for i, engine in enumerate(self.engines)
            for name in getattr(engine.source, kind)
        )

    def _split_state(self, x):
        """Return the states of the rigid body, of the control system, and of each engine."""
        first = len(RIGID)
        last = first + len(self.controls.states)
        return AircraftState(x[:first], x[first:last], self._by_engine(x[last:], "states"))

    def _split_input(self, u):
        """Return the pilot's three inputs, the inputs of each engine, and disturbances by name."""
        first, last = len(SURFACES), len(self.inputs) - len(self.disturbances)
        disturbances = dict.fromkeys(DISTURBANCES, jnp.zeros(())) | dict(
            zip(self.disturbances, u[last:], strict=True)
        )
        return AircraftInput(u[:first], self._by_engine(u[first:last], "inputs"), disturbances)

    def _by_engine(self, values, kind: str):
        parts, at = [], 0
        for engine in self.engines:
            count = len(getattr(engine.source, kind))
            parts.append(values[at : at + count])
            at += count
        return parts
