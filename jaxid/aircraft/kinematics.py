"""`Kinematics`: flight-path reconstruction, the motion that accelerometers and gyros imply beside what is measured of it."""

from collections.abc import Mapping
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp

from .._foundation.checks import require, require_known
from .._foundation.concrete import require_value
from .._foundation.types import Array, Float
from ..data.record import Record
from ..models.base import AbstractModel
from .atmosphere import GRAVITY, SEA_LEVEL_DENSITY, AbstractAtmosphere, true_airspeed
from .corrections import acceleration_at_cg
from .first_samples import first_samples
from .frames import downwards, euler_rates, quaternion, rotation, velocity
from .instrument_channels import ANGULAR, FLOW, FORCE, RATES, TABLE, PerChannel, numbers, positions
from .instrument_geometry import velocity_at
from .instruments import Instruments
from .kinematics_corrected import without_errors

SHOWN = ("V", "alpha", "beta", "phi", "pitch", "psi", "altitude")
ALWAYS = ("u", "v", "w", "phi", "pitch")
OPTIONAL = ("psi", "altitude")  # nothing else depends on them, so that they are states only where they are measured
STATE_UNITS = {**dict.fromkeys(("u", "v", "w"), "m/s"), **{name: TABLE[name].unit for name in SHOWN[3:]}}
WIND = ("north", "east", "down")

Signals = dict[str, Float[Array, ""]]


class Kinematics(AbstractModel):
    r"""The motion of a rigid aircraft from measured specific forces and angular rates, with no word on its aerodynamics.

        udot = r v - q w + ax - g sin(pitch)                phidot   = p + (q sin(phi) + r cos(phi)) tan(pitch)
        vdot = p w - r u + ay + g cos(pitch) sin(phi)       pitchdot = q cos(phi) - r sin(phi)
        wdot = q u - p v + az + g cos(pitch) cos(phi)       psidot   = (q sin(phi) + r cos(phi)) / cos(pitch)
        altitude' = u sin(pitch) - (v sin(phi) + w cos(phi)) cos(pitch)

    The inputs are measured, and what is true of them follows from their bias and scale, `true = (measured - bias)/(1 + scale)`;
    accelerations are then moved to the c.g. The outputs are what instruments show of the motion, with their scale, bias, place,
    lag and delay. So every error of an instrument is a parameter: `input_bias.ax`, `input_scale.q`, `instruments.bias.alpha`,
    `instruments.delay.beta`. A lag or delay exists where it is given, zero to free it. `psi` and `altitude` are states where
    they are outputs.

    Noise of the inputs is integrated like the motion itself, and output error does not know of it: standard errors are
    right for inputs whose noise leaves the outputs' residuals white (`jaxid.consistency` says when it does not).

    Attitude is in Euler angles, as it is measured, with their singularity at a pitch of 90 deg.

    Args:
        instruments: of the outputs, channels among V, alpha, beta, phi, pitch, psi, altitude; faultless ones of all seven by
            default.
        input_bias, input_scale: offset [its unit] and relative error of scale by input; zero where not given.
        input_position: (x, y, z) from the c.g. of the accelerometers ax, ay, az [m].
        angular_acceleration: whether pdot, qdot, rdot are inputs too; without them accelerometers must stand at the c.g.
        wind: north, east and down component of a constant wind over ground [m/s], parameters `wind.north` and so on; None for
            still air. Only a record that changes its heading determines it, and only with psi measured: in straight flight
            a wind and another start of `u v w` are the same (the altitude tells the vertical component alone).
        atmosphere: where it is given V is the indicated airspeed, by the altitude; else the true airspeed.
        beta: what the channel beta shows: the flank angle atan2(v, u) of a vane, or the sideslip asin(v/V).

    Raises:
        InputError: for a channel or an input that does not exist; accelerometers off the c.g. without angular accelerations;
            a wind without psi, or an atmosphere without altitude, among the outputs.

    Source: report App. D.1, E.2, with the measured specific force in place of aerodynamics and thrust; V. Klein, E. A. Morelli,
    Aircraft System Identification, AIAA 2006, chapter 10.
    """

    instruments: Instruments
    input_bias: PerChannel
    input_scale: PerChannel
    input_position: PerChannel
    wind: Float[Array, "3"] | None
    atmosphere: AbstractAtmosphere | None
    inputs: tuple[str, ...] = eqx.field(static=True)
    beta: Literal["vane", "sideslip"] = eqx.field(static=True)

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
        beta: Literal["vane", "sideslip"] = "vane",
    ):
        self.instruments = Instruments(SHOWN) if instruments is None else instruments
        require_known("output of a kinematic model", self.instruments.channels, SHOWN)
        require_known("meaning of beta", [beta], ("vane", "sideslip"))
        self.inputs = (*FORCE, *RATES, *(ANGULAR if angular_acceleration else ()))
        self.input_bias = numbers(self.inputs, "input_bias", input_bias, 0.0)
        self.input_scale = numbers(self.inputs, "input_scale", input_scale, 0.0)
        self.input_position, self.beta = _places(input_position, self.inputs), beta
        self.wind = None if wind is None else jnp.asarray(wind, float)
        self.atmosphere = atmosphere
        require(
            self.wind is None or self.wind.shape == (3,),
            f"`wind` is {wind}. Give three numbers: north, east, down [m/s].",
        )
        require(
            wind is None or "psi" in self.outputs,
            "A wind blows from somewhere, and without psi among the outputs the heading is not known. Measure psi, or leave "
            "the wind out: velocities are then relative to the air.",
        )
        require(
            atmosphere is None or "altitude" in self.outputs,
            "Indicated airspeed depends on the altitude, which is not among the outputs. Measure it, or turn V into the true "
            "airspeed before and leave the atmosphere out.",
        )

    @property
    def states(self) -> tuple[str, ...]:
        return (*ALWAYS, *(name for name in OPTIONAL if name in self.outputs))

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.instruments.channels

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        """Names of the wind's components, where there is one."""
        return {} if self.wind is None else {"wind": tuple(f"wind.{name}" for name in WIND)}

    def rhs(self, t, x, u):
        now, felt = self._state(x), self.true_inputs(u)
        motion, force, omega = (
            jnp.stack([of[name] for name in names]) for of, names in ((now, "uvw"), (felt, FORCE), (felt, RATES))
        )
        down = downwards(now["phi"], now["pitch"])
        rates = dict(zip("uvw", force + GRAVITY * down - jnp.cross(omega, motion), strict=True))
        turning = euler_rates(now["phi"], now["pitch"], omega)
        rates |= dict(zip(("phi", "pitch", "psi"), turning, strict=True)) | {"altitude": -jnp.dot(down, motion)}
        return jnp.stack([rates[name] for name in self.states])

    def output(self, t, x, u):
        signals = self.signals(t, x, u)
        y = self.instruments.read(signals)
        if self.beta == "vane" or "beta" not in self.outputs:
            return y
        omega, air = (jnp.stack([signals[name] for name in names]) for names in (RATES, FLOW))
        forward, side, down = velocity_at(air, omega, self.instruments.position["beta"])
        turned = jnp.arctan2(side, jnp.sqrt(forward**2 + down**2)) - jnp.arctan2(side, forward)
        return y.at[self.outputs.index("beta")].add((1.0 + self.instruments.scale["beta"]) * turned)

    def observe(self, t, y):
        return self.instruments.observe(t, y)

    def signals(self, t, x, u):
        """States, the true inputs (specific forces at the c.g.), `u_air v_air w_air`, `V`, `mach`, `density`."""
        now, felt = self._state(x), self.true_inputs(u)
        air = jnp.stack([now["u"], now["v"], now["w"]])
        if self.wind is not None:
            air = air - rotation(quaternion(now["phi"], now["pitch"], now["psi"])) @ self.wind
        V = jnp.sqrt(jnp.dot(air, air))
        # Without an atmosphere the true airspeed is what an indicator shows at sea level and Mach zero.
        density, mach = jnp.asarray(SEA_LEVEL_DENSITY), jnp.zeros(())
        if self.atmosphere is not None:
            around = self.atmosphere.air(now["altitude"])
            density, mach = around.density, V / around.sound_speed
        return now | felt | dict(zip(FLOW, air, strict=True)) | {"V": V, "density": density, "mach": mach}

    def true_inputs(self, u: Float[Array, " input"]) -> Signals:
        """What is true of the measured inputs: bias and scale taken out, specific forces moved to the c.g.

        Args:
            u: as measured, in the order of `inputs` [m/s^2, rad/s, rad/s^2].
        """
        true = dict(zip(self.inputs, (u - self.input_bias.values) / (1.0 + self.input_scale.values), strict=True))
        places = self.input_position
        return true | {name: acceleration_at_cg(name[1], true, true[name], places[name]) for name in places.channels}

    def initial_state(self, record: Record) -> Float[Array, " state"]:
        """The state from the first valid sample of each output, errors and places of the instruments left to the estimation.

        What is not measured is taken from the record's constant of the same name, an angle else as zero.

        Args:
            record: with this model's outputs.

        Raises:
            InputError: when neither an output nor a constant says V, which must not be zero.
        """
        at = record.constants | first_samples(record)
        require(
            "V" in at, f"Record {record.names[0]!r} does not say how fast it flies: give V as an output or a constant."
        )
        at = {name: jnp.asarray(at.get(name, 0.0), float) for name in SHOWN}
        V, beta = at["V"], at["beta"]
        if self.atmosphere is not None:
            V = true_airspeed(V, self.atmosphere.air(at["altitude"]))
        if self.beta == "vane":
            beta = jnp.arctan(jnp.cos(at["alpha"]) * jnp.tan(beta))
        moving = velocity(V, at["alpha"], beta)
        if self.wind is not None:
            moving = moving + rotation(quaternion(at["phi"], at["pitch"], at["psi"])) @ self.wind
        return jnp.stack([*moving, *(at[name] for name in self.states[3:])])

    def sensor_errors(self) -> tuple[str, ...]:
        """Errors that a lively manoeuvre of some seconds determines together, with a free initial state.

        The biases of the six inputs, scales of V, alpha and beta, biases of alpha and beta, and what lags and delays there
        are. Left out: biases of attitude angles (that of psi and of the altitude no record tells from another start), scales
        of the inputs, and the bias of V, which only a large change of speed tells from its scale. Name them to
        `jaxid.consistency` where the manoeuvre is made for them.
        """
        air = {"scale": ("V", "alpha", "beta"), "bias": ("alpha", "beta")}
        late = [
            f"instruments.{kind}.{n}" for kind in ("lag", "delay") for n in getattr(self.instruments, kind).channels
        ]
        return (
            *(f"input_bias.{name}" for name in (*FORCE, *RATES)),
            *(f"instruments.{kind}.{n}" for kind, names in air.items() for n in names if n in self.outputs),
            *late,
        )

    def corrected(self, record: Record) -> Record:
        """The record as the same instruments would have made it without the errors that this model holds.

            inputs: (measured - bias)/(1 + scale),      outputs: (z(t + delay) - bias)/(1 + scale)

        Places stay as they are. A channel that is late is read between its samples by a cubic spline, and is missing where
        a neighbour is missing or the record has ended; noise there becomes a little smaller and is not white any more. A
        channel is corrected wherever the record has it, as an input or an output; others stay as they are.

        Args:
            record: one or a stack, with any of this model's inputs and outputs.

        Raises:
            InputError: when an instrument has a lag, which cannot be taken out without raising the noise.
        """
        return without_errors(record, self.instruments, self.input_bias, self.input_scale)

    def units(self):
        own = {f"instruments.{name}": unit for name, unit in self.instruments.parameter_units().items()}
        names = {name: TABLE[name].unit for name in self.inputs}
        own |= {f"input_bias.{name}": unit for name, unit in names.items()}
        own |= {f"input_scale.{name}": "" for name in names}
        own |= dict.fromkeys((f"input_position.{name}" for name in self.input_position.element_names["values"]), "m")
        own |= dict.fromkeys(self.element_names.get("wind", ()), "m/s")
        return {name: STATE_UNITS[name] for name in self.states} | names | self.instruments.units() | own

    def _state(self, x) -> Signals:
        return dict(zip(self.states, x, strict=True))


def _places(given: Mapping[str, Any] | None, inputs: tuple[str, ...]) -> PerChannel:
    """Places of the accelerometers; none at all, and nothing to move, without angular accelerations."""
    if set(ANGULAR) <= set(inputs):
        return positions(given, inputs)
    require_known("accelerometer (in `input_position`)", given or {}, FORCE)
    told = (
        "The accelerometer {!r} stands at {{}} m off the c.g., and moving what it shows takes angular accelerations. Set "
        "`angular_acceleration=True` and give pdot, qdot, rdot (smoothed derivatives of the rates), or move it before."
    )
    for name, place in (given or {}).items():
        require_value(jnp.asarray(place, float), lambda value: value == 0, told.format(name))
    return PerChannel({}, {})
