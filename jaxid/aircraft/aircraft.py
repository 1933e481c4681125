"""`Aircraft`: the six-degree-of-freedom simulation model (chapter II, Table 2.1, Appendix D)."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from .._foundation.checks import require, require_known
from .._foundation.types import Array, Float
from ..data.record import Record
from ..models.base import AbstractModel, canonical
from ..models.names import parameter_names
from .aerodynamics import COEFFICIENTS
from .airframe import Airframe, aerodynamic_loads
from .atmosphere import GRAVITY, AbstractAtmosphere, StandardAtmosphere, true_airspeed
from .buffet import Buffet
from .controls import SURFACES, AbstractControls, ControlSystem, standard_actuators
from .effectiveness import MOVED, effectiveness
from .effects import lacking_terms
from .effects_library import signals_of, usual_effects
from .engine import ConstantThrust, Engine, loads
from .first_samples import first_samples
from .flow import flow
from .frames import air_angle_rates, euler_of, quaternion, quaternion_rate, rotation, velocity
from .instruments import Instruments
from .rigid_body import accelerations, specific_force
from .turbulence import GUSTS
from .wind import AbstractWind, Wind

RIGID = ("u", "v", "w", "p", "q", "r", "e0", "e1", "e2", "e3", "north", "east", "altitude")
DISTURBANCES = (*GUSTS, "buffet")
FIRST = ("V", "alpha", "beta", "phi", "pitch", "psi", "p", "q", "r", "altitude")  # what a first state is made of

Signals = dict[str, Float[Array, ""]]


class Aircraft(AbstractModel):
    r"""A rigid aircraft with table look-up aerodynamics, engines, control system, moving air and instruments.

        vdot = F/m - omega x v,    I omegadot = M - omega x (I omega + h),    edot = E(omega) e,    position' = T' v
        F = qbar S (CX, CY, CZ) + thrust + weight,    M = qbar S (b Cl, cbar Cm, b Cn) + r_ref x F_aero + engines

    The aerodynamics see the velocity and the rotation relative to the air, which wind and gusts move. States are the
    rigid body's (`u v w p q r e0 e1 e2 e3 north east altitude`), the control system's and the engines'; inputs are the
    pilot's (`pilot_stabilator`, `pilot_aileron`, `pilot_rudder`, added to the trim), the engines' levers, and those
    disturbances that are asked for. Outputs are the channels of the instruments. Every number is an array
    leaf with a dotted name: `mass`, `Cm.alpha`, `controls.augmentation.yaw_gain`, `instruments.bias.q`.

    Args:
        airframe: mass, size and aerodynamics.
        engines: one or more; one of constant thrust and none of it by default, for `trims` to set.
        controls: trim, feedback and actuators, or `MeasuredSurfaces`; no feedback and first-order actuators by default.
        instruments: faultless ones at the centre of gravity by default.
        atmosphere: the standard one by default.
        wind: of steady air over ground; none by default.
        buffet: random normal force at high angle of attack; none by default.
        disturbances: which of `gust_u` to `gust_w` [m/s], `gust_p` to `gust_r` [rad/s] and `buffet` are inputs; the others
            are zero. None by default: nobody records them.

    Raises:
        InputError: when there is no engine, or no such disturbance.

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
        require(engines is None or len(engines) > 0, "An aircraft has at least one engine; give one of no thrust.")
        self.airframe = airframe
        self.engines = (Engine(ConstantThrust(0.0)),) if engines is None else engines
        self.controls = ControlSystem(standard_actuators(airframe.limits)) if controls is None else controls
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

    # The model ------------------------------------------------------------------------------------------------------------

    def rhs(self, t, x, u):
        return self.rhs_and_signals(t, x, u)[0]

    def signals(self, t, x, u):
        """Everything that an instrument, a coefficient or an effect may depend on, by name.

        Returns:
            Inputs and states, the flow (`alpha`, `beta`, `V`, `mach`, `qbar`, `phat`, `qhat`, `rhat` and the rest),
            surfaces [rad], `thrust` [N], the six coefficients with all that acts on them, the accelerations, by how much
            the rate of a state grows with a coefficient, `p_per_Cl` and so on, for those in `MOVED`, and `alphadot_hat` and
            `betadot_hat`, the rates of alpha and beta by these equations times `cbar/2V` and `b/2V`, gusts taken as steady [rad].
        """
        return self.rhs_and_signals(t, x, u)[1]

    def immediate_signals(self, t, x, u):
        """Inputs, states, the flow and the surfaces."""
        return self._immediate(x, u, rotation(self._split_state(x)[0][6:10]))

    def rhs_and_signals(self, t, x, u):
        rigid, control_states, engine_states = self._split_state(x)
        pilot, levers, _ = self._split_input(u)
        T = rotation(rigid[6:10])
        signals = self._immediate(x, u, T)
        signals |= self._propulsion(engine_states, signals)
        signals |= dict(zip(COEFFICIENTS, self._coefficients(signals), strict=True))
        vdot, omegadot = self._accelerations(rigid, T, engine_states, signals)
        signals |= self._felt(rigid, T, vdot, omegadot) | self._effectiveness(signals)
        signals |= self._rates_of_angles(rigid, vdot, signals)
        moving = self.controls.rates(t, control_states, pilot, signals)
        pushing = [
            engine.source.rates(own, lever, signals)
            for engine, own, lever in zip(self.engines, engine_states, levers, strict=True)
        ]
        attitude_rate = quaternion_rate(rigid[6:10], rigid[3:6])
        over_ground = T.T @ rigid[:3] * jnp.array([1.0, 1.0, -1.0])
        return jnp.concatenate([vdot, omegadot, attitude_rate, over_ground, moving, *pushing]), signals

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))

    def output_given(self, t, x, u, dx):
        rigid, _, engine_states = self._split_state(x)
        T = rotation(rigid[6:10])
        signals = self._immediate(x, u, T)
        signals |= self._propulsion(engine_states, signals)
        return self.instruments.read(signals | self._felt(rigid, T, dx[:3], dx[3:6]))

    def observe(self, t, y):
        return self.instruments.observe(t, y)

    def initial_state(self, record: Record) -> Float[Array, " state"]:
        """The state from the first valid sample of each channel, with controls and engines at rest in trim.

        A channel that the record lacks is taken from its constant of the same name, else as zero; the speed, which must
        not be zero, then as that at which the weight is carried by a force coefficient of one. The sideslip vane shows
        `atan2(v, u)`, which is turned into `asin(v/V)`; errors of the instruments are left to the estimation.

        Args:
            record: of this model's outputs.
        """
        seen = first_samples(record)
        at = {name: jnp.asarray(seen.get(name, record.constants.get(name, 0.0)), float) for name in FIRST}
        air = self.atmosphere.air(at["altitude"])
        weight = self.airframe.mass_properties.mass * GRAVITY
        slowest = jnp.sqrt(2.0 * weight / (air.density * self.airframe.S))
        V = true_airspeed(at["V"], air) if "V" in seen or "V" in record.constants else slowest
        e = quaternion(at["phi"], at["pitch"], at["psi"])
        beta = jnp.arctan(jnp.cos(at["alpha"]) * jnp.tan(at["beta"]))
        ground = velocity(V, at["alpha"], beta) + rotation(e) @ self.wind.velocity(at["altitude"])
        place = jnp.stack([jnp.zeros(()), jnp.zeros(()), at["altitude"]])
        return self.flight_state(ground, jnp.stack([at["p"], at["q"], at["r"]]), e, place)

    def gusty(self):
        """The same aircraft with the three velocities of the air that are not yet among its inputs."""
        return self.disturbed(*self.disturbances, *(gust for gust in GUSTS[:3] if gust not in self.disturbances))

    def effects(self):
        """Terms that the coefficients may lack beside what the airframe has, `beta^2 in Cm` and so on, and what else an
        aircraft lacks most often: unsteady and separated flow, mass, thrust, wind, places of instruments. `aircraft_effects`
        knows more."""
        terms = lacking_terms(self.airframe.aerodynamics.terms, MOVED)
        return (*terms, *usual_effects(parameter_names(canonical(self)), MOVED, signals_of(canonical(self))))

    def equations_with_terms(self):
        """No equation takes general terms: what an equation of motion may lack stands in its coefficient."""
        return ()

    def units(self):
        names = {"u": "m/s", "v": "m/s", "w": "m/s", "p": "rad/s", "q": "rad/s", "r": "rad/s"}
        names |= {"north": "m", "east": "m", "altitude": "m"} | {f"pilot_{surface}": "rad" for surface in SURFACES}
        names |= {gust: "rad/s" if gust[-1] in "pqr" else "m/s" for gust in GUSTS}
        own = {f"instruments.{name}": unit for name, unit in self.instruments.parameter_units().items()}
        return names | self.instruments.units() | own

    # Trim and start -------------------------------------------------------------------------------------------------------

    def steady_rates(
        self,
        velocity: Float[Array, "3"],
        omega: Float[Array, "3"],
        e: Float[Array, "4"],
        altitude: Float[Array, ""],
        surfaces: Mapping[str, Float[Array, ""]],
        setting: Float[Array, ""],
    ) -> Float[Array, "6"]:
        """The accelerations with surfaces and engines held, feedback and actuators out of the loop: what a trim balances.

        Args:
            velocity: over ground, body axes [m/s].
            omega: angular rate [rad/s].
            e: attitude, a unit quaternion.
            altitude: [m].
            surfaces: stabilator, aileron and rudder [rad].
            setting: of every engine (a constant thrust's is its push [N]).

        Returns:
            (udot, vdot, wdot) [m/s^2] and (pdot, qdot, rdot) [rad/s^2].
        """
        held = self.trimmed(surfaces, setting)
        place = jnp.stack([jnp.zeros(()), jnp.zeros(()), jnp.asarray(altitude, float)])
        return held.rhs(jnp.zeros(()), held.flight_state(velocity, omega, e, place), jnp.zeros(len(self.inputs)))[:6]

    def trimmed(self, surfaces: Mapping[str, Float[Array, ""]], setting: Float[Array, ""]) -> "Aircraft":
        """The same aircraft with other trim settings.

        Args:
            surfaces: stabilator, aileron and rudder [rad].
            setting: of every engine (a constant thrust's is its push [N]).
        """
        settings = jnp.stack([jnp.asarray(surfaces[name], float) for name in SURFACES])
        engines = tuple(
            eqx.tree_at(lambda one: one.source, engine, engine.source.trimmed(jnp.asarray(setting, float)))
            for engine in self.engines
        )
        return eqx.tree_at(lambda one: (one.controls.trim, one.engines), self, (settings, engines))

    def flight_state(
        self,
        velocity: Float[Array, "3"],
        omega: Float[Array, "3"],
        e: Float[Array, "4"],
        place: Float[Array, "3"],
    ) -> Float[Array, " state"]:
        """A state in flight with control system and engines at rest in their trim settings.

        Args:
            velocity: over ground, body axes [m/s].
            omega: angular rate [rad/s].
            e: attitude, a unit quaternion.
            place: north, east and altitude [m].
        """
        return self._assemble(jnp.concatenate([velocity, omega, e, place]))

    def disturbed(self, *names: str) -> "Aircraft":
        """The same aircraft with these disturbances among its inputs."""
        parts = {
            name: getattr(self, name) for name in ("engines", "controls", "instruments", "atmosphere", "wind", "buffet")
        }
        return Aircraft(self.airframe, **parts, disturbances=names)

    # Parts ----------------------------------------------------------------------------------------------------------------

    def _immediate(self, x, u, T: Float[Array, "3 3"]) -> Signals:
        """Inputs, states, the flow and the surfaces, with the rotation into body axes at hand."""
        rigid, control_states, _ = self._split_state(x)
        pilot, _, disturbances = self._split_input(u)
        signals = dict(zip(self.states + self.inputs, jnp.concatenate([x, u]), strict=True))
        return signals | self._flow(rigid, T, disturbances) | self.controls.positions(control_states, pilot)

    def _flow(self, rigid: Float[Array, "13"], T: Float[Array, "3 3"], disturbances: Signals) -> Signals:
        """Motion relative to ground and air, and the pressures that it makes."""
        altitude = rigid[12]
        air_velocity = rigid[:3] - T @ self.wind.velocity(altitude) - jnp.stack([disturbances[g] for g in GUSTS[:3]])
        air_omega = rigid[3:6] - jnp.stack([disturbances[g] for g in GUSTS[3:]])
        phi, pitch, psi = euler_of(T)
        climb = -(T.T @ rigid[:3])[2]
        return disturbances | {
            **dict(zip(("u", "v", "w", "p", "q", "r"), rigid[:6], strict=True)),
            **flow(self.airframe, self.atmosphere.air(altitude), air_velocity, air_omega),
            **{"phi": phi, "pitch": pitch, "psi": psi, "altitude": altitude},
            **{"gamma": jnp.arctan2(climb, jnp.sqrt(jnp.maximum(jnp.dot(rigid[:3], rigid[:3]) - climb**2, 1e-12)))},
        }

    def _propulsion(self, engine_states, signals: Signals) -> Signals:
        pushes = [engine.thrust(own, signals) for engine, own in zip(self.engines, engine_states, strict=True)]
        return {"thrust": jnp.sum(jnp.stack(pushes))}

    def _coefficients(self, signals: Signals) -> Float[Array, " coefficient"]:
        """The six coefficients, buffet included."""
        return self.airframe.aerodynamics.coefficients(signals).at[2].add(self.buffet.coefficient(signals))

    def _effectiveness(self, signals: Signals) -> Signals:
        """By how much each coefficient moves the rates of velocity and angular rate, inertial coupling included."""
        grown = effectiveness(self.airframe, signals["qbar"], self.airframe.mass_properties.inertia())
        return {
            f"{state}_per_{coefficient}": grown[COEFFICIENTS.index(coefficient), RIGID.index(state)]
            for coefficient, states in MOVED.items()
            for state in states
        }

    def _accelerations(self, rigid, T, engine_states, signals: Signals):
        """Rates of velocity and angular rate from all that acts on the body."""
        frame, mass = self.airframe, self.airframe.mass_properties
        coefficients = jnp.stack([signals[name] for name in COEFFICIENTS])
        force, moment = aerodynamic_loads(frame, signals["qbar"], coefficients)
        pushes = [engine.thrust(own, signals) for engine, own in zip(self.engines, engine_states, strict=True)]
        push, turning, momentum = loads(self.engines, pushes)
        force, moment = force + push + mass.mass * GRAVITY * T[:, 2], moment + turning
        return accelerations(mass.mass, mass.inertia(), rigid[:3], rigid[3:6], force, moment, momentum)

    def _felt(self, rigid, T, vdot, omegadot) -> Signals:
        """Specific force at the centre of gravity and angular acceleration, by name."""
        felt = specific_force(vdot, rigid[:3], rigid[3:6], GRAVITY * T[:, 2])
        return dict(zip(("ax", "ay", "az", "pdot", "qdot", "rdot"), jnp.concatenate([felt, omegadot]), strict=True))

    def _rates_of_angles(self, rigid, vdot, signals: Signals) -> Signals:
        """The reduced rates of alpha and beta in air whose motion over ground is steady."""
        velocity = jnp.stack([signals[name] for name in ("u_air", "v_air", "w_air")])
        change = vdot + jnp.cross(rigid[3:6], rigid[:3] - velocity)  # a steady wind turns in body axes
        alphadot, betadot = air_angle_rates(velocity, change)
        reduced = 1.0 / (2.0 * signals["V"])
        return {
            "alphadot_hat": alphadot * self.airframe.cbar * reduced,
            "betadot_hat": betadot * self.airframe.b * reduced,
        }

    def _assemble(self, rigid: Float[Array, "13"]) -> Float[Array, " state"]:
        return jnp.concatenate([rigid, self.controls.resting(), *(engine.source.resting() for engine in self.engines)])

    def _of_engines(self, kind: str) -> tuple[str, ...]:
        """Names of the engines' own states or inputs, numbered where there are several engines."""
        several = len(self.engines) > 1
        return tuple(
            f"{name}_{i + 1}" if several else name
            for i, engine in enumerate(self.engines)
            for name in getattr(engine.source, kind)
        )

    def _split_state(self, x):
        """The rigid body's states, the control system's, and a list of each engine's."""
        first = len(RIGID)
        last = first + len(self.controls.states)
        return x[:first], x[first:last], self._by_engine(x[last:], "states")

    def _split_input(self, u):
        """The pilot's three, a list of each engine's, and the disturbances by name."""
        first, last = len(SURFACES), len(self.inputs) - len(self.disturbances)
        disturbances = dict.fromkeys(DISTURBANCES, jnp.zeros(())) | dict(zip(self.disturbances, u[last:], strict=True))
        return u[:first], self._by_engine(u[first:last], "inputs"), disturbances

    def _by_engine(self, values, kind: str):
        parts, at = [], 0
        for engine in self.engines:
            count = len(getattr(engine.source, kind))
            parts.append(values[at : at + count])
            at += count
        return parts
