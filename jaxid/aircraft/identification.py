"""`IdentificationModel`: the model of Appendix E, with polynomials for coefficients, for estimation and regression."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.types import Array, Float
from ..data.record import Record
from ..models.base import AbstractModel, selected
from ..models.pseudo import PseudoMeasurements
from .aerodynamics import COEFFICIENTS
from .airframe import Airframe, aerodynamic_loads
from .atmosphere import GRAVITY, SEA_LEVEL_DENSITY, AbstractAtmosphere, StandardAtmosphere
from .effectiveness import effectiveness
from .engine import ConstantThrust, Engine, loads
from .flow import flow
from .frames import air_angles, downwards, euler_rates
from .identification_channels import Channels, arranged
from .identification_effects import effects_of
from .identification_frames import FRAMES, Translation
from .identification_records import initial_state, prepared, pseudo_measurements
from .identification_units import units_of
from .instrument_channels import ANGULAR, FLOW, RATES
from .instrument_geometry import velocity_at
from .instruments import Instruments
from .instruments_inverse import air_of
from .regressors import TABLE_6_1
from .rigid_body import solve_3x3, specific_force
from .turbulence import GUSTS

MOMENTS = dict(zip(("Cl", "Cm", "Cn"), RATES, strict=True))

Signals = dict[str, Float[Array, ""]]


class IdentificationModel(AbstractModel):
    r"""A rigid aircraft whose six coefficients are polynomials, driven by measured surfaces (App. E).

        udot = r v - q w + qbar S/m CX + Tx/m - g sin(pitch)                     alpha = atan2(w, u)
        vdot = p w - r u + qbar S/m CY + Ty/m + g cos(pitch) sin(phi)            beta  = asin(v/V)
        wdot = q u - p v + qbar S/m CZ + Tz/m + g cos(pitch) cos(phi)            qbar  = density V^2/2
        I omegadot = qbar S (b Cl, cbar Cm, b Cn) + reference x F + engines - omega x (I omega + h)

    with attitude in Euler angles (E.9 to E.11), and altitude where it is asked for. In the frame "air path" the states V,
    alpha, beta stand in the place of u, v, w (Table E.1): the same motion, and other equations to leave out.

    **Equations can be left out.** What is not a state takes its measured history, as an input of the same name (section 4.2 c),
    or is held at a constant. The angular acceleration of a rate that is not a state couples into the others by products of
    inertia and by accelerometers off the plane of symmetry; it is taken as held at zero unless `measured` names it. `without`
    leaves out the equation of a coefficient, and names it.

    **Numbers** are array leaves with dotted names, parameters all: `Cm.alpha^2`, `mass`, `S`, `instruments.bias.beta`, what is
    held by its own name (`altitude`, `v`). A constant of a record that is called as one takes its place in that record,
    so that each may have its own `altitude`, `density` or `mass`.

    **Outputs** are channels of the instruments, with their scales, biases, places and lags; accelerometers feel what effects
    add. By default those whose equation is propagated: V, alpha, beta, ax, ay, az go with the translation along them, a rate and
    its acceleration with that rate.

    The air is still but for gusts that are named in `measured`: velocity over ground and relative to it are one.

    Args:
        airframe: mass, size, and aerodynamics: `PolynomialAerodynamics` with a `Polynomial` for each coefficient, or tables with
            corrections (then only the corrections have terms).
        states: "coupled" (all nine), "longitudinal" (u w q pitch), "lateral" (v p r phi psi), or names among u v w (V alpha
            beta) p q r phi pitch psi altitude.
        frame: "body" or "air path".
        measured: inputs beside the surfaces and the states not propagated: thrust [N], altitude [m], density [kg/m^3],
            pdot, qdot, rdot of rates not propagated [rad/s^2], and `gust_u` to `gust_w`, the velocity of the air [m/s].
        held: constants in the place of states or inputs, by name [SI]. The altitude stands here if it is neither a state nor
            measured: it says density and speed of sound.
        engines: without states of their own, unless thrust is measured or held, which they then share equally; their
            places, directions and momenta count in either case. None by default.
        instruments: all that are on board, also of channels that are no outputs: what is known of them corrects measured
            histories. Faultless ones at the centre of gravity by default.
        outputs: a selection of the instruments' channels.
        atmosphere: the standard one by default.
        airspeed: what the channel V shows: "indicated" airspeed (D.2.4), or "true" airspeed.
        beta: what the channel beta shows: the flank angle atan2(v, u) of a "vane" (D.2.6), or the "sideslip" asin(v/V) (E.14).
        candidates: terms by coefficient for the regression; those of Table 6.1 by default (`extended` adds to them).

    Raises:
        InputError: for a state, an input, an output or a coefficient that does not exist, one that is two things at once, an
            altitude that is none of the three, an output that shows only what is measured, or engines with states.

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
        airspeed: str = "indicated",
        beta: str = "vane",
        candidates: Mapping[str, Sequence[str]] | None = None,
    ):
        require_known("meaning of V", [airspeed], ("indicated", "true"))
        require_known("meaning of beta", [beta], ("vane", "sideslip"))
        self.airframe = airframe
        self.engines = (Engine(ConstantThrust(0.0)),) if engines is None else engines
        self.instruments = Instruments() if instruments is None else instruments
        self.atmosphere = StandardAtmosphere() if atmosphere is None else atmosphere
        self.channels = arranged(states, frame, measured, held or {}, self.instruments.channels, outputs)
        given = {name: (held or {}).get(name, 0.0) for name in self.channels.held}
        self.held = {name: jnp.asarray(value, float) for name, value in given.items()}
        self.airspeed, self.beta = airspeed, beta
        candidates = TABLE_6_1 if candidates is None else candidates
        require_known("aerodynamic coefficient (in `candidates`)", candidates, COEFFICIENTS)
        self.candidates = tuple((name, tuple(terms)) for name, terms in candidates.items())
        for engine in self.engines:
            require(
                engine.source.states == () or "thrust" in (*self.channels.held, *self.inputs),
                f"The engine {type(engine.source).__name__} has states of its own, which this model does not propagate. "
                "Measure its thrust (`measured=('thrust',)`), or give an engine of constant thrust.",
            )

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
    def translation(self) -> Translation:
        """How the velocity is written."""
        return FRAMES[self.channels.frame]

    @property
    def equation(self) -> dict[str, str]:
        """By coefficient, the state whose equation it dominates: `Cm` and `q`."""
        return {**self.translation.equation, **MOMENTS}

    @property
    def responses(self) -> tuple[str, ...]:
        """The coefficients whose equations are propagated."""
        return tuple(name for name, state in self.equation.items() if state in self.states)

    # The model ------------------------------------------------------------------------------------------------------------

    def rhs(self, t, x, u):
        return self.rhs_and_signals(t, x, u)[0]

    def signals(self, t, x, u):
        """Everything that a coefficient or an effect may depend on, by name.

        Returns:
            Inputs, states and constants held, `u v w`, the flow (`alpha`, `beta`, `V`, `mach`, `qbar`, `phat`, `qhat`, `rhat` and
            the rest), `thrust`, the six coefficients, and by how much the rate of a state grows with a coefficient,
            `p_per_Cl` and so on.
        """
        return self.rhs_and_signals(t, x, u)[1]

    def immediate_signals(self, t, x, u):
        return self._flow(x, u)

    def rhs_and_signals(self, t, x, u):
        signals = self._flow(x, u)
        coefficients = self.airframe.aerodynamics.coefficients(signals)
        signals |= dict(zip(COEFFICIENTS, coefficients, strict=True))
        rates = self._rates(signals, *self._accelerations(signals, coefficients))
        return jnp.stack([rates[name] for name in self.states]), signals | self._effectiveness(signals)

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))

    def output_given(self, t, x, u, dx):
        signals = self._flow(x, u)
        vdot, omegadot = self._motion_given(signals, dict(zip(self.states, dx, strict=True)))
        gravity = GRAVITY * downwards(signals["phi"], signals["pitch"])
        felt = specific_force(vdot, _three(signals, "uvw"), _three(signals, RATES), gravity)
        signals |= dict(zip(("ax", "ay", "az", *ANGULAR), jnp.concatenate([felt, omegadot]), strict=True))
        y = self._read(signals)
        return y[np.array([self.instruments.channels.index(name) for name in self.outputs])]

    def observe(self, t, y):
        at = np.array([self.instruments.channels.index(name) for name in self.outputs])
        table = jnp.zeros((y.shape[0], len(self.instruments.channels))).at[:, at].set(y)
        return self.instruments.observe(t, table)[:, at]

    def initial_state(self, record: Record) -> Float[Array, " state"]:
        """The state from the first valid sample of each channel, brought to the centre of gravity by what is known of the
        instruments.

        What is neither an output nor an input of the record is taken from its constant of the same name, else as zero; the
        speed then as that at which the weight is carried by a force coefficient of one.

        Args:
            record: of this model's outputs and inputs.
        """
        return initial_state(self, record)

    # What a study asks for ------------------------------------------------------------------------------------------------

    def prepared(self, record: Record) -> Record:
        """The record with this model's inputs and outputs, from one with all that was measured.

        Histories that stand in for states are corrected by what is known of the instruments: u, v, w (or alpha, beta) and V
        follow from the measured air data at the centre of gravity, rates and surfaces lose their known scales and biases.
        Outputs stay as they were recorded. Biases that are to be estimated act on outputs only. The first value of a state that
        was measured and that no output shows becomes a constant of the record, from which `initial_state` has it.

        Args:
            record: a single record.

        Raises:
            InputError: when a channel is missing, or an input has samples that are not valid.
        """
        return selected(prepared(self, record), self.inputs, self.outputs)

    def pseudo_measurements(self, record: Record) -> PseudoMeasurements:
        """The coefficients that accelerations and rates say, and the signals of which they are to be polynomials (Table 3.2).

            qbar S (CX, CY, CZ) = m a - T d,    a the specific force at the centre of gravity
            qbar S (b Cl, cbar Cm, b Cn) = I omegadot + omega x (I omega + h) - M_engines - reference x F_aero

        Those of the equations that are propagated. What the model holds or measures of density, altitude and thrust is taken;
        where it propagates the altitude, the measured one.

        Args:
            record: a single record, with V, alpha, beta, the rates, the surfaces, ax, ay, az and pdot, qdot, rdot.

        Raises:
            InputError: when a channel is missing.
        """
        return pseudo_measurements(self, record)

    def without(self, responses: tuple[str, ...]) -> "IdentificationModel":
        """The same model without the equations of these coefficients: u, v, w (V, beta, alpha), p, q, r are inputs of it.

        With a rate its angular acceleration becomes an input. Outputs that then show what is measured are left out, and so is
        the accelerometer along a velocity that is not propagated. Attitude angles stay states where they are: they
        follow the rates, measured or not.

        Args:
            responses: coefficients, such as `("CX", "Cn")`.

        Raises:
            InputError: when there is no such equation, or none would be left.
        """
        require_known("response", responses, self.responses)
        if not responses:
            return self
        gone = [self.equation[name] for name in responses]
        states = tuple(name for name in self.states if name not in gone)
        accelerations = [f"{name}dot" for name in gone if name in RATES]
        mine = self.channels
        return self._again(
            states=states,
            measured=(*mine.measured, *accelerations),
            held={name: value for name, value in self.held.items() if name not in accelerations},
            outputs=tuple(name for name in self.outputs if mine.owner[name] not in gone),
        )

    def gusty(self):
        """The same model with the air's velocity along what is propagated among its inputs."""
        along = zip(GUSTS[:3], self.translation.equation.values(), strict=True)
        gusts = tuple(gust for gust, state in along if state in self.states and gust not in self.inputs)
        return self._again(states=self.states, measured=(*self.channels.measured, *gusts), outputs=self.outputs)

    def actuated(self):
        return self.channels.actuated

    def effects(self):
        return effects_of(self)

    def equations_with_terms(self):
        """No equation takes general terms: what an equation of motion may lack stands in its coefficient."""
        return ()

    def units(self):
        return units_of(self)

    # Parts ----------------------------------------------------------------------------------------------------------------

    def _again(self, **changes: Any) -> "IdentificationModel":
        """The same model with other options."""
        names = ("engines", "instruments", "atmosphere", "airspeed", "beta", "held")
        mine: dict[str, Any] = {name: getattr(self, name) for name in names}
        mine |= {"frame": self.channels.frame, "candidates": dict(self.candidates)}
        return IdentificationModel(self.airframe, **(mine | changes))

    def _flow(self, x, u) -> Signals:
        """All that is known at an instant but what accelerates."""
        known = self.held | dict(zip(self.states, x, strict=True)) | dict(zip(self.inputs, u, strict=True))
        velocity = self.translation.velocity(_three(known, self.translation.names))
        signals = known | dict(zip("uvw", velocity, strict=True))
        through_air = velocity - jnp.stack([known.get(gust, jnp.zeros(())) for gust in GUSTS[:3]])
        signals |= flow(self.airframe, air_of(self.atmosphere, known), through_air, _three(known, RATES))
        return signals | {"thrust": jnp.sum(jnp.stack(self.pushes(signals)))}

    def pushes(self, signals: Signals) -> list[Float[Array, ""]]:
        """The push of each engine [N]."""
        if "thrust" in self.inputs or "thrust" in self.held:
            shares = jnp.stack([engine.share for engine in self.engines])
            return list(signals["thrust"] * shares / jnp.sum(shares))
        return [engine.thrust(jnp.zeros(0), signals) for engine in self.engines]

    def _accelerations(self, signals: Signals, coefficients) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Rates of velocity and angular rate; of a rate that is not propagated, what is measured or held."""
        mass = self.airframe.mass_properties
        omega, velocity = _three(signals, RATES), _three(signals, "uvw")
        force, moment = aerodynamic_loads(self.airframe, signals["qbar"], coefficients)
        push, turning, momentum = loads(self.engines, self.pushes(signals))
        gravity = GRAVITY * downwards(signals["phi"], signals["pitch"])
        vdot = (force + push) / mass.mass + gravity - jnp.cross(omega, velocity)
        left = moment + turning - jnp.cross(omega, mass.inertia() @ omega + momentum)
        given = jnp.stack([signals.get(name, jnp.zeros(())) for name in ANGULAR])
        return vdot, solve_3x3(self._inertia(), jnp.where(self._turns, left, given))

    @property
    def _turns(self) -> np.ndarray:
        """Which rates are propagated."""
        return np.array([name in self.states for name in RATES])

    def _inertia(self) -> Float[Array, "3 3"]:
        """The inertia tensor with the row of a unit matrix for each rate that is not propagated."""
        return jnp.where(np.tile(self._turns[:, None], 3), self.airframe.mass_properties.inertia(), jnp.eye(3))

    def _rates(self, signals: Signals, vdot, omegadot) -> Signals:
        """The rate of everything that can be a state."""
        velocity = _three(signals, "uvw")
        rates = dict(zip(self.translation.names, self.translation.rates(velocity, vdot), strict=True))
        rates |= dict(zip(RATES, omegadot, strict=True))
        turning = euler_rates(signals["phi"], signals["pitch"], _three(signals, RATES))
        rates |= dict(zip(("phi", "pitch", "psi"), turning, strict=True))
        return rates | {"altitude": -jnp.dot(downwards(signals["phi"], signals["pitch"]), velocity)}

    def _motion_given(self, signals: Signals, dx: Signals) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Accelerations from the rate of the state, and from the equations for what is not propagated."""
        own = dict(dx)
        if not {*self.translation.names, *RATES} <= set(dx):
            coefficients = self.airframe.aerodynamics.coefficients(signals)
            own = self._rates(signals, *self._accelerations(signals, coefficients)) | dx
        vdot = self.translation.accelerations(_three(signals, "uvw"), _three(own, self.translation.names))
        return vdot, _three(own, RATES)

    def _read(self, signals: Signals) -> Float[Array, " channel"]:
        """What the instruments show, V and beta in the sense that this model gives them."""
        if self.airspeed == "true":  # which is what an indicator shows at sea level and Mach zero
            signals = signals | {"density": jnp.asarray(SEA_LEVEL_DENSITY), "mach": jnp.zeros(())}
        y = self.instruments.read({"psi": jnp.zeros(())} | signals)  # a heading that is no state is no output either
        if self.beta == "vane" or "beta" not in self.outputs:
            return y
        there = velocity_at(_three(signals, FLOW), _three(signals, RATES), self.instruments.position["beta"])
        turned = air_angles(there)[2] - jnp.arctan2(there[1], there[0])
        return y.at[self.instruments.channels.index("beta")].add((1.0 + self.instruments.scale["beta"]) * turned)

    def _effectiveness(self, signals: Signals) -> Signals:
        """By how much each coefficient moves the rates of the states."""
        grown = effectiveness(self.airframe, signals["qbar"], self._inertia(), self._turns)
        velocity = _three(signals, "uvw")
        translated = jax.vmap(lambda vdot: self.translation.rates(velocity, vdot))(grown[:, :3])
        columns = dict(zip(self.translation.names, translated.T, strict=True))
        columns |= dict(zip(RATES, grown[:, 3:].T, strict=True))
        return {
            f"{state}_per_{coefficient}": column[k]
            for state, column in columns.items()
            if state in self.states
            for k, coefficient in enumerate(COEFFICIENTS)
        }


def _three(signals: Mapping[str, Float[Array, ""]], names: Sequence[str]) -> Float[Array, "3"]:
    return jnp.stack([signals[name] for name in names])
