"""`Kinematics`: flight-path reconstruction.

The motion is integrated from accelerometers and gyros, and compared with air data and attitude.
"""

from collections.abc import Mapping
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.checks import require, require_known
from ..._foundation.traced_checks import require_value
from ..._foundation.types import Array, Float
from ...data.record import Record
from ...models.base import AbstractModel
from ..air.atmosphere import GRAVITY, SEA_LEVEL_DENSITY, AbstractAtmosphere, true_airspeed
from ..instruments.channels import (
    ANGULAR,
    CHANNEL_TABLE,
    FLOW,
    FORCE,
    RATES,
    PerChannel,
    numbers,
    positions,
)
from ..instruments.geometry import velocity_at
from ..instruments.instruments import Instruments
from ..physics.frames import downwards, euler_rates, quaternion, rotation, velocity
from ..records.initial_channels import initial_channels
from ..records.to_centre_of_gravity import acceleration_at_cg
from .remove_sensor_errors import remove_sensor_errors

KINEMATIC_OUTPUTS = ("V", "alpha", "beta", "phi", "pitch", "psi", "altitude")
BASE_STATES = ("u", "v", "w", "phi", "pitch")
# states and inputs that are zero in symmetric flight
SYMMETRIC_STATES, SYMMETRIC_INPUTS = ("v", "phi"), ("ay", "p", "r", "pdot", "rdot")
LONGITUDINAL_OUTPUTS = ("V", "alpha", "pitch", "altitude")
# no other equation depends on these, so they are states only if they are outputs
OPTIONAL_STATES = ("psi", "altitude")
STATE_UNITS = {
    **dict.fromkeys(("u", "v", "w"), "m/s"),
    **{name: CHANNEL_TABLE[name].unit for name in KINEMATIC_OUTPUTS[3:]},
}
WIND = ("north", "east", "down")

Signals = dict[str, Float[Array, ""]]


class Kinematics(AbstractModel):
    r"""Motion of a rigid aircraft driven by measured specific forces and angular rates.

        udot = r v - q w + ax - g sin(pitch)
        vdot = p w - r u + ay + g cos(pitch) sin(phi)
        wdot = q u - p v + az + g cos(pitch) cos(phi)
        phidot   = p + (q sin(phi) + r cos(phi)) tan(pitch)
        pitchdot = q cos(phi) - r sin(phi)
        psidot   = (q sin(phi) + r cos(phi)) / cos(pitch)
        altitude' = u sin(pitch) - (v sin(phi) + w cos(phi)) cos(pitch)

    The model contains no aerodynamics. The inputs are measured; their true values are `true =
    (measured - bias)/(1 + scale)`, and specific forces are then moved to the c.g. The outputs are
    the readings of the instruments, with their scale, bias, position, lag and delay. Every error of
    an instrument is therefore a parameter: `input_bias.ax`, `input_scale.q`,
    `instruments.bias.alpha`, `instruments.delay.beta`. A lag or delay is a parameter only if it is
    given; give zero to estimate it. `psi` and `altitude` are states only if they are outputs.

    Noise of the inputs is integrated like the motion itself, and output error ignores it: standard
    errors are valid if this noise leaves the residuals of the outputs white (`jaxid.consistency`
    warns if it does not).

    Attitude is in Euler angles, the measured quantities, with their singularity at a pitch of 90
    deg.

    Args:
        instruments: instruments of the outputs, channels among V, alpha, beta, phi, pitch, psi,
            altitude; by default error-free ones of all seven.
        input_bias, input_scale: offset [unit of the input] and relative scale error by input; zero
            by default.
        input_position: (x, y, z) of the accelerometers ax, ay, az from the c.g. [m].
        angular_acceleration: True if pdot, qdot, rdot are inputs too; without them the
            accelerometers must be at the c.g.
        wind: north, east and down component of a constant wind over ground [m/s], parameters
            `wind.north` and so on; None for still air. The wind is identifiable only from a record
            with changing heading and measured psi: in straight flight it is confounded with the
            initial `u v w` (the altitude determines only the vertical component).
        atmosphere: if given, V is the indicated airspeed at the altitude; otherwise the true
            airspeed.
        beta: meaning of the channel beta: the "sideslip" asin(v/V), or the flank angle atan2(v, u)
            of a "vane".
        longitudinal: True for symmetric flight: `v`, `phi` and all lateral inputs are zero, the
            inputs are ax, az, q (and qdot), the states u, w, pitch, and no lateral error of an
            instrument can take up a misfit.

    Raises:
        InputError: for an unknown channel or input; for accelerometers off the c.g. without angular
            accelerations; for a wind without psi, or an atmosphere without altitude, among the
            outputs.

    Source: report App. D.1, E.2, with the measured specific force in place of aerodynamics and
    thrust; V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, chapter 10.
    """

    instruments: Instruments
    input_bias: PerChannel
    input_scale: PerChannel
    input_position: PerChannel
    wind: Float[Array, "3"] | None
    atmosphere: AbstractAtmosphere | None
    inputs: tuple[str, ...] = eqx.field(static=True)
    beta: Literal["vane", "sideslip"] = eqx.field(static=True)
    longitudinal: bool = eqx.field(static=True)

    def __init__(
        self,
        instruments: Instruments | None = None,
        *,
        input_bias: Mapping[str, Any] | None = None,
        input_scale: Mapping[str, Any] | None = None,
        input_position: Mapping[str, Any] | None = None,
        angular_acceleration: bool = False,
        wind: Any = None,
        atmosphere: AbstractAtmosphere | None = None,
        beta: Literal["vane", "sideslip"] = "sideslip",
        longitudinal: bool = False,
    ):
        possible = LONGITUDINAL_OUTPUTS if longitudinal else KINEMATIC_OUTPUTS
        self.instruments = Instruments(possible) if instruments is None else instruments
        require_known("output of a kinematic model", self.instruments.channels, possible)
        self.longitudinal = longitudinal
        require_known("meaning of beta", [beta], ("vane", "sideslip"))
        self.inputs = _inputs(angular_acceleration, longitudinal)
        self.input_bias = numbers(self.inputs, "input_bias", input_bias, 0.0)
        self.input_scale = numbers(self.inputs, "input_scale", input_scale, 0.0)
        self.input_position, self.beta = _positions(input_position, self.inputs), beta
        self.wind = None if wind is None else jnp.asarray(wind, float)
        self.atmosphere = atmosphere
        require(
            self.wind is None or self.wind.shape == (3,),
            f"`wind` is {wind}. Give three numbers: north, east, down [m/s].",
        )
        require(
            wind is None or "psi" in self.outputs,
            "A wind needs the heading, and without psi among the outputs the heading is unknown. "
            "Measure psi, or leave the wind out: velocities are then relative to the air.",
        )
        require(
            atmosphere is None or "altitude" in self.outputs,
            "Indicated airspeed depends on the altitude, which is not among the outputs. Measure "
            "the altitude, or convert V to true airspeed first and leave the atmosphere out.",
        )

    @property
    def states(self) -> tuple[str, ...]:
        absent = SYMMETRIC_STATES if self.longitudinal else ()
        base = tuple(name for name in BASE_STATES if name not in absent)
        return (*base, *(name for name in OPTIONAL_STATES if name in self.outputs))

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.instruments.channels

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        """Names of the wind components, if the model has a wind."""
        return {} if self.wind is None else {"wind": tuple(f"wind.{name}" for name in WIND)}

    def rhs(self, t, x, u):
        states, true = self._state(x), self.true_inputs(u)
        ground_velocity = jnp.stack([states[name] for name in "uvw"])
        force, omega = (jnp.stack([true[name] for name in names]) for names in (FORCE, RATES))
        down = downwards(states["phi"], states["pitch"])
        vdot = force + GRAVITY * down - jnp.cross(omega, ground_velocity)
        rates = dict(zip("uvw", vdot, strict=True))
        angle_rates = euler_rates(states["phi"], states["pitch"], omega)
        rates |= dict(zip(("phi", "pitch", "psi"), angle_rates, strict=True))
        rates["altitude"] = -jnp.dot(down, ground_velocity)
        return jnp.stack([rates[name] for name in self.states])

    def output(self, t, x, u):
        signals = self.signals(t, x, u)
        y = self.instruments.read(signals)
        if self.beta == "vane" or "beta" not in self.outputs:
            return y
        omega, air = (jnp.stack([signals[name] for name in names]) for names in (RATES, FLOW))
        forward, side, down = velocity_at(air, omega, self.instruments.position["beta"])
        correction = jnp.arctan2(side, jnp.sqrt(forward**2 + down**2)) - jnp.arctan2(side, forward)
        return y.at[self.outputs.index("beta")].add(
            (1.0 + self.instruments.scale["beta"]) * correction
        )

    def observe(self, t, y):
        return self.instruments.observe(t, y)

    def signals(self, t, x, u):
        """Return the signals by name.

        These are the states, the true inputs (specific forces at the c.g.), `u_air v_air w_air`,
        `V`, `mach` and `density`.
        """
        states, true = self._state(x), self.true_inputs(u)
        air = jnp.stack([states["u"], states["v"], states["w"]])
        if self.wind is not None:
            e = quaternion(states["phi"], states["pitch"], states["psi"])
            air = air - rotation(e) @ self.wind
        V = jnp.sqrt(jnp.dot(air, air))
        # At sea level and Mach zero the indicated airspeed equals the true airspeed.
        density, mach = jnp.asarray(SEA_LEVEL_DENSITY), jnp.zeros(())
        if self.atmosphere is not None:
            ambient = self.atmosphere.air(states["altitude"])
            density, mach = ambient.density, V / ambient.sound_speed
        return (
            states
            | true
            | dict(zip(FLOW, air, strict=True))
            | {"V": V, "density": density, "mach": mach}
        )

    def true_inputs(self, u: Float[Array, " input"]) -> Signals:
        """Return the true inputs by name: bias and scale removed, specific forces at the c.g.

        Args:
            u: measured inputs, in the order of `inputs` [m/s^2, rad/s, rad/s^2].
        """
        true = dict(
            zip(
                self.inputs,
                (u - self.input_bias.values) / (1.0 + self.input_scale.values),
                strict=True,
            )
        )
        if self.longitudinal:
            true |= dict.fromkeys(SYMMETRIC_INPUTS, jnp.zeros(()))
        position = self.input_position
        return true | {
            name: acceleration_at_cg(name[1], true, true[name], position[name])
            for name in position.channels
        }

    def initial_state(self, record: Record) -> Float[Array, " state"]:
        """Return the state at the first valid sample of each output.

        Errors and positions of the instruments are ignored; the estimation accounts for them. A
        quantity that is not measured is taken from the record's constant of the same name; without
        one, an angle is zero.

        Args:
            record: record with this model's outputs.

        Raises:
            InputError: if V, which must not be zero, is neither an output nor a constant.
        """
        known = record.constants | initial_channels(record)
        require(
            "V" in known,
            f"Record {record.names[0]!r} has no airspeed: give V as an output or a constant.",
        )
        at = {name: jnp.asarray(known.get(name, 0.0), float) for name in KINEMATIC_OUTPUTS}
        V, beta = at["V"], at["beta"]
        if self.atmosphere is not None:
            V = true_airspeed(V, self.atmosphere.air(at["altitude"]))
        if self.beta == "vane":
            beta = jnp.arctan(jnp.cos(at["alpha"]) * jnp.tan(beta))
        ground_velocity = velocity(V, at["alpha"], beta)
        if self.wind is not None:
            e = quaternion(at["phi"], at["pitch"], at["psi"])
            ground_velocity = ground_velocity + rotation(e) @ self.wind
        at |= dict(zip("uvw", ground_velocity, strict=True))
        return jnp.stack([at[name] for name in self.states])

    def sensor_errors(self) -> tuple[str, ...]:
        """Return names of the errors that are jointly identifiable from a dynamic manoeuvre.

        A manoeuvre of some seconds with a free initial state determines the biases of the specific
        forces and rates, the scales of V, alpha and beta, the biases of alpha and beta, and all
        lags and delays of the model. Left out are the biases of attitude angles (the biases of psi
        and of the altitude are confounded with the initial state in every record), the scales of
        the inputs, and the bias of V, which only a large change of speed separates from its scale.
        Pass their names to `jaxid.consistency` if the manoeuvre is designed for them.
        """
        air = {"scale": ("V", "alpha", "beta"), "bias": ("alpha", "beta")}
        dynamic = [
            f"instruments.{kind}.{n}"
            for kind in ("lag", "delay")
            for n in getattr(self.instruments, kind).channels
        ]
        return (
            *(f"input_bias.{name}" for name in (*FORCE, *RATES) if name in self.inputs),
            *(
                f"instruments.{kind}.{n}"
                for kind, names in air.items()
                for n in names
                if n in self.outputs
            ),
            *dynamic,
        )

    def corrected(self, record: Record) -> Record:
        """Return the record without the sensor errors of this model.

            inputs: (measured - bias)/(1 + scale),      outputs: (z(t + delay) - bias)/(1 + scale)

        Positions are not corrected. A delayed channel is interpolated between its samples by a
        cubic spline; it is missing where a neighbouring sample is missing or the record has ended,
        and its noise becomes slightly smaller and is no longer white. A channel is corrected
        wherever the record has it, as an input or an output; other channels are unchanged.

        Args:
            record: a record or a stack, with any of this model's inputs and outputs.

        Raises:
            InputError: if an instrument has a lag, which cannot be removed without amplifying the
                noise.
        """
        return remove_sensor_errors(record, self.instruments, self.input_bias, self.input_scale)

    def units(self):
        errors = self.instruments.parameter_units().items()
        parameters = {f"instruments.{name}": unit for name, unit in errors}
        inputs = {name: CHANNEL_TABLE[name].unit for name in self.inputs}
        parameters |= {f"input_bias.{name}": unit for name, unit in inputs.items()}
        parameters |= {f"input_scale.{name}": "" for name in inputs}
        parameters |= dict.fromkeys(
            (f"input_position.{name}" for name in self.input_position.element_names["values"]), "m"
        )
        parameters |= dict.fromkeys(self.element_names.get("wind", ()), "m/s")
        states = {name: STATE_UNITS[name] for name in self.states}
        return states | inputs | self.instruments.units() | parameters

    def _state(self, x) -> Signals:
        zero = dict.fromkeys(SYMMETRIC_STATES, jnp.zeros(())) if self.longitudinal else {}
        return zero | dict(zip(self.states, x, strict=True))


def _inputs(angular_acceleration: bool, longitudinal: bool) -> tuple[str, ...]:
    """Return the names of the inputs."""
    possible = (*FORCE, *RATES, *(ANGULAR if angular_acceleration else ()))
    absent = SYMMETRIC_INPUTS if longitudinal else ()
    return tuple(name for name in possible if name not in absent)


def _positions(given: Mapping[str, Any] | None, inputs: tuple[str, ...]) -> PerChannel:
    """Return the positions of the accelerometers; empty without angular accelerations."""
    if "qdot" in inputs:
        return positions(given, inputs)
    require_known("accelerometer (in `input_position`)", given or {}, FORCE)
    message = (
        "The accelerometer {!r} is at {{}} m from the c.g., and moving its reading to the c.g. "
        "takes angular accelerations. Set `angular_acceleration=True` and give pdot, qdot, rdot "
        "(smoothed derivatives of the rates), or correct the reading first."
    )
    for name, position in (given or {}).items():
        require_value(jnp.asarray(position, float), lambda value: value == 0, message.format(name))
    return PerChannel({}, {})
