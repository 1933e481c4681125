"""`IdentificationModel`: the model of Appendix E with polynomial coefficients.

It serves estimation and regression.
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.checks import require, require_known
from ..._foundation.types import Array, Float
from ...data.record import Record
from ...models.base import AbstractModel, selected
from ...models.pseudo_measurements import PseudoMeasurements, WeakMeasurements
from ..air.atmosphere import AbstractAtmosphere, StandardAtmosphere
from ..instruments.instruments import Instruments
from ..vehicle.aerodynamics import COEFFICIENTS
from ..vehicle.airframe import Airframe
from ..vehicle.engine import ConstantThrust, Engine
from .channels import EULER_ANGLES, Channels, Choice, arrange_channels
from .coefficients import pseudo_measurements, weak_measurements
from .effects import effects_of
from .motion import RigidMotion
from .readings import Readings
from .records import at_constants, prepared
from .regressors import TABLE_6_1, USUAL_RANGES, in_axes
from .units import units_of


class IdentificationModel(AbstractModel):
    r"""Rigid aircraft with six polynomial coefficients, driven by measured surfaces (App. E).

        udot = r v - q w + qbar S/m CX + Tx/m - g sin(pitch)               alpha = atan2(w, u)
        vdot = p w - r u + qbar S/m CY + Ty/m + g cos(pitch) sin(phi)      beta  = asin(v/V)
        wdot = q u - p v + qbar S/m CZ + Tz/m + g cos(pitch) cos(phi)      qbar  = density V^2/2
        I omegadot = qbar S (b Cl, cbar Cm, b Cn) + reference x F + engines - omega x (I omega + h)

    Attitude is in Euler angles (E.9 to E.11); the altitude is an optional state. In the frame "air
    path" the states V, alpha, beta replace u, v, w (Table E.1): the motion is the same, but other
    equations can be left out.

    **Equations can be left out.** A variable that is not a state is an input of the same name with
    its measured history (section 4.2 c), or is held constant. The angular acceleration of a rate
    that is not a state acts on the other equations through products of inertia and accelerometers
    off the plane of symmetry; it is held at zero unless `measured` names it. `without` leaves out
    the equation of a coefficient.

    **Parameters** are array leaves with dotted names: `Cm.alpha^2`, `mass`, `S`,
    `instruments.bias.beta`, and each held constant by its name (`altitude`, `v`). A constant of a
    record replaces the parameter of the same name for that record, so that each record may have its
    own `altitude`, `density` or `mass`.

    **Outputs** are channels of the instruments, with their scales, biases, positions and lags;
    accelerometers include the contributions of effects. By default the outputs are the channels
    whose equation is propagated: V, alpha, beta, ax, ay, az belong to the translation along them, a
    rate and its acceleration to that rate.

    The air is at rest except for gusts named in `measured`: velocity over ground and airspeed are
    the same.

    Args:
        airframe: mass, size, and aerodynamics: `PolynomialAerodynamics` with a `Polynomial` for
            each coefficient, or tables with corrections (then only the corrections have terms).
        states: "coupled" (all nine), "longitudinal" (u w q pitch), "lateral" (v p r phi psi), or
            names among u v w (V alpha beta) p q r phi pitch psi altitude.
        frame: "body" or "air path".
        measured: inputs in addition to the surfaces and the states that are not propagated: thrust
            [N], altitude [m], density [kg/m^3], sound_speed [m/s], pdot, qdot, rdot of rates that
            are not propagated [rad/s^2], and `gust_u` to `gust_w`, the velocity of the air [m/s].
        held: constants that replace states or inputs, by name [SI]. The altitude must be here if it
            is neither a state nor measured: it determines density and speed of sound. This class
            knows no record, so a longitudinal model takes the lateral variables and surfaces as
            measured inputs; `model_of` holds at zero what its record lacks in symmetric flight.
        engines: engines without states, unless the thrust is measured or held; the engines then
            share it equally. Their positions, directions and momenta are used in either case. None
            by default.
        instruments: all instruments on board, including channels that are not outputs: their known
            errors correct measured histories. By default error-free ones at the centre of gravity.
        outputs: a selection of the instruments' channels.
        atmosphere: the standard atmosphere by default.
        airspeed: meaning of the channel V: "true" airspeed, or "indicated" airspeed (D.2.4).
        beta: meaning of the channel beta: the "sideslip" asin(v/V) (E.14), or the flank angle
            atan2(v, u) of a "vane" (D.2.6).
        candidates: terms by coefficient for the regression; by default Table 6.1 (`extended` adds
            terms to it). Terms of CX, CY, CZ serve CD, CY or CC, CL where these are the forces.

    Raises:
        InputError: for an unknown state, input, output or coefficient, a name with two roles, an
            altitude without a role, an output that depends on measured inputs only, or engines with
            states.

    Source: report App. E, errata in docs/errata.md; section 4.2 c.
    """

    airframe: Airframe
    held: dict[str, Float[Array, ""]]
    engines: tuple[Engine, ...]
    instruments: Instruments
    atmosphere: AbstractAtmosphere
    channels: Channels = eqx.field(static=True)
    airspeed: str = eqx.field(static=True)
    beta: str = eqx.field(static=True)
    candidates: tuple[tuple[str, tuple[str, ...]], ...] = eqx.field(static=True)

    transparent: ClassVar[tuple[str, ...]] = ("airframe", "held")

    def __init__(
        self,
        airframe: Airframe,
        *,
        states: str | Sequence[str] = "coupled",
        frame: str = "body",
        measured: Sequence[str] = (),
        held: Mapping[str, Any] | None = None,
        engines: tuple[Engine, ...] | None = None,
        instruments: Instruments | None = None,
        outputs: Sequence[str] | None = None,
        atmosphere: AbstractAtmosphere | None = None,
        airspeed: str = "true",
        beta: str = "sideslip",
        candidates: Mapping[str, Sequence[str]] | None = None,
    ):
        require_known("meaning of V", [airspeed], ("indicated", "true"))
        require_known("meaning of beta", [beta], ("vane", "sideslip"))
        self.airframe = airframe
        self.engines = (Engine(ConstantThrust(0.0)),) if engines is None else engines
        self.instruments = Instruments() if instruments is None else instruments
        self.atmosphere = StandardAtmosphere() if atmosphere is None else atmosphere
        self.channels = arrange_channels(
            states,
            frame,
            measured,
            held or {},
            self.instruments.channels,
            outputs,
            airframe.aerodynamics.force_axes,
        )
        given = {name: (held or {}).get(name, 0.0) for name in self.channels.held}
        self.held = {name: jnp.asarray(value, float) for name, value in given.items()}
        self.airspeed, self.beta = airspeed, beta
        candidates = TABLE_6_1 if candidates is None else candidates
        chosen = in_axes(candidates, self.channels.force)
        self.candidates = tuple((name, tuple(terms)) for name, terms in chosen.items())
        _check_engines(self.engines, self.channels)

    @property
    def states(self) -> tuple[str, ...]:
        return self.channels.states

    @property
    def inputs(self) -> tuple[str, ...]:
        return self.channels.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.channels.outputs

    @property
    def responses(self) -> tuple[str, ...]:
        """Coefficients whose equations are propagated."""
        return self.channels.responses

    @property
    def motion(self) -> RigidMotion:
        """Equations of motion."""
        return RigidMotion(self.airframe, self.held, self.engines, self.atmosphere, self.channels)

    @property
    def readings(self) -> Readings:
        """Instruments, with the meaning of V and beta in this model."""
        return Readings(
            self.instruments, self.atmosphere, self.held, self.channels, self.airspeed, self.beta
        )

    # The model ------------------------------------------------------------------------------------

    def rhs(self, t, x, u):
        return self.rhs_and_signals(t, x, u)[0]

    def signals(self, t, x, u):
        """Return all signals on which a coefficient or an effect may depend, by name.

        Returns:
            Inputs, states and held constants, `u v w`, the signals of `air_relative.flow` (`alpha`,
            `beta`, `V`, `mach`, `qbar`, `phat`, `qhat`, `rhat` and others), `thrust`, the
            coefficients in body axes and in the axes of the model, and the derivatives of the state
            rates by the coefficients, `p_per_Cl` and so on; `alphadot_hat` and `betadot_hat` if the
            angle is propagated, without the part of an effect that is added to the model.
        """
        return self.rhs_and_signals(t, x, u)[1]

    def immediate_signals(self, t, x, u):
        return self.motion.flow(x, u)

    def rhs_and_signals(self, t, x, u):
        motion = self.motion
        signals = motion.flow(x, u)
        coefficients, signals = motion.coefficient_signals(signals)
        rates = motion.rates(signals, coefficients)
        return jnp.stack([rates[name] for name in self.states]), signals | motion.effectiveness(
            signals
        )

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))

    def output_given(self, t, x, u, dx):
        signals = self.motion.flow(x, u)
        return self.readings.outputs(signals | self.motion.inertial_signals(signals, dx))

    def observe(self, t, y):
        return self.readings.observe(t, y)

    def initial_state(self, record: Record) -> Float[Array, " state"]:
        """Return the state at the first valid sample of each channel.

        The readings are moved to the centre of gravity with the known errors of the instruments.
        Velocities of the state are over ground: gusts among the inputs are added to those of the
        air data. A quantity that is neither an output nor an input of the record is taken from its
        constant of the same name; without one it is zero, and the speed is the one at which a force
        coefficient of one carries the weight. A state that is known exactly is the constant
        `initial_state.<state>`.

        Args:
            record: record with this model's outputs and inputs.
        """
        return _first_state(self.readings, self.airframe, record.anonymous())

    # Interface of a study -------------------------------------------------------------------------

    def prepared(self, record: Record) -> Record:
        """Return the record with this model's inputs and outputs, from a record of all channels.

        Histories that replace states are corrected with the known errors of the instruments: u, v,
        w (or alpha, beta) and V are computed from the measured air data at the centre of gravity;
        known scales and biases are removed from rates and surfaces. The velocities u, v and w are
        over ground: gusts among the inputs are added. Outputs are unchanged, and biases to be
        estimated act on outputs only. The first value of a measured state without an output becomes
        a constant of the record, which `initial_state` uses.

        Args:
            record: a single record.

        Raises:
            InputError: if a channel is missing, an input has invalid samples, or for gusts in the
                frame "air path" if V, alpha or beta is not propagated.
        """
        readings = at_constants(self, record).readings
        return selected(prepared(readings, record), self.inputs, self.outputs)

    def pseudo_measurements(self, record: Record) -> PseudoMeasurements:
        """Return the coefficients from accelerations and rates, and the signals of their terms.

            qbar S (CX, CY, CZ) = m a - T d,    a: specific force at the centre of gravity
            qbar S (b Cl, cbar Cm, b Cn)
                = I omegadot + omega x (I omega + h) - M_engines - reference x F_aero

        Coefficients whose equation is not propagated are left out (Table 3.2). Density, altitude
        and thrust are the held or measured ones; if the altitude is a state, it is the measured
        altitude.

        Args:
            record: a single record, with V, alpha, beta, the rates, the surfaces, ax, ay, az and
                pdot, qdot, rdot.

        Raises:
            InputError: if a channel is missing.
        """
        model = at_constants(self, record)
        return pseudo_measurements(model.motion, model.readings, record, dict(self.candidates))

    def weak_measurements(self, record: Record) -> WeakMeasurements:
        """Return the equations of `pseudo_measurements` without angular accelerations.

            qbar S (b Cl, cbar Cm, b Cn) = (I omega)' + omega x (I omega + h) - M_engines - ...

        The accelerometers off the centre of gravity are corrected in the same way.

        Args:
            record: a single record, with V, alpha, beta, the rates, the surfaces, ax, ay, az.

        Raises:
            InputError: if a channel is missing.
        """
        model = at_constants(self, record)
        return weak_measurements(model.motion, model.readings, record, dict(self.candidates))

    def without(self, responses: tuple[str, ...]) -> "IdentificationModel":
        """Return the model without the equations of some coefficients.

        Their states u, v, w (V, beta, alpha), p, q, r become inputs; with a rate its angular
        acceleration becomes an input too. Outputs that then depend on measured inputs only are left
        out, and so is the accelerometer along a velocity that is not propagated. Attitude angles
        remain states: they are the integrals of the rates, measured or not.

        Args:
            responses: coefficients, such as `("CX", "Cn")`.

        Raises:
            InputError: for a coefficient without an equation, or if no equation would be left.
        """
        require_known("response", responses, self.responses)
        if not responses:
            return self
        return self._with(self.channels.without(responses))

    def with_disturbance_inputs(self):
        """Return the model with a gust along each propagated velocity among its inputs."""
        return self._with(self.channels.with_gusts())

    def actuated(self):
        return self.channels.actuated

    def effects(self):
        return effects_of(self, self.channels, self.airframe.aerodynamics.terms)

    def usual_ranges(self):
        return USUAL_RANGES

    def input_rates(self, t, x, u):
        """Return the rates of the attitude angles and the altitude that are inputs."""
        motion = self.motion
        rates = motion.rates(motion.flow(x, u), jnp.zeros(len(COEFFICIENTS)))
        kinematic = (*EULER_ANGLES, "altitude")
        return {name: rates[name] for name in kinematic if name in self.inputs}

    def equations_with_terms(self):
        """Return no equations: terms that an equation of motion lacks belong to a coefficient."""
        return ()

    def units(self):
        signals = (*self.states, *self.inputs, *self.held)
        return units_of(signals, self.instruments, self.airframe.aerodynamics.terms)

    def _with(self, choice: Choice) -> "IdentificationModel":
        """Return the model with other channels; a constant that becomes an input is not held."""
        return IdentificationModel(
            self.airframe,
            states=choice.states,
            frame=self.channels.frame,
            measured=choice.measured,
            held={name: value for name, value in self.held.items() if name not in choice.measured},
            engines=self.engines,
            instruments=self.instruments,
            outputs=choice.outputs,
            atmosphere=self.atmosphere,
            airspeed=self.airspeed,
            beta=self.beta,
            candidates=dict(self.candidates),
        )


@eqx.filter_jit
def _first_state(readings: Readings, airframe: Airframe, record: Record) -> Float[Array, " state"]:
    """Return the first state, jitted as one program instead of about a hundred operations."""
    return readings.first_state(record, airframe)


def _check_engines(engines: tuple[Engine, ...], channels: Channels) -> None:
    """Refuse engines with states, unless their thrust is measured or held."""
    for engine in engines:
        require(
            engine.source.states == () or "thrust" in (*channels.held, *channels.inputs),
            f"The engine {type(engine.source).__name__} has states of its own, which this model "
            "does not propagate. Measure its thrust (`measured=('thrust',)`), or give an engine of "
            "constant thrust.",
        )
