"""`Readings`: instrument readings of a motion, and the motion computed from readings."""

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import require
from ..._foundation.types import Array, Float
from ...data.record import Record
from ..air.atmosphere import GRAVITY, SEA_LEVEL_DENSITY, AbstractAtmosphere
from ..air.turbulence import GUSTS
from ..instruments.channels import FLOW, RATES
from ..instruments.geometry import velocity_at
from ..instruments.instruments import Instruments
from ..instruments.inverse import air_of, motion
from ..physics.frames import air_angles
from ..records.initial_channels import initial_channels
from ..vehicle.airframe import Airframe
from .channels import Channels
from .units import SIGNALS

AIR_DATA = {"u": "V", "V": "V", "v": "beta", "beta": "beta", "w": "alpha", "alpha": "alpha"}
"""Channel of the instruments that determines a state, by state."""

Signals = dict[str, Float[Array, ""]]


class Readings(eqx.Module):
    """Instruments of an identification model, with the meaning of the channels V and beta.

    Args:
        instruments: all instruments on board, with their known errors.
        atmosphere: atmosphere for airspeed and density.
        held: constants that replace states or inputs, by name [SI].
        channels: names of states and outputs.
        airspeed: meaning of the channel V: "indicated" or "true" airspeed.
        beta: meaning of the channel beta: "vane" (flank angle) or "sideslip".
    """

    instruments: Instruments
    atmosphere: AbstractAtmosphere
    held: dict[str, Float[Array, ""]]
    channels: Channels = eqx.field(static=True)
    airspeed: str = eqx.field(static=True)
    beta: str = eqx.field(static=True)

    def outputs(self, signals: Signals) -> Float[Array, " output"]:
        """Return the outputs at an instant.

        Args:
            signals: signals of the motion, with specific forces and angular accelerations at the
                c.g. [SI].
        """
        if self.airspeed == "true":  # equals the indicated airspeed at sea level and Mach zero
            signals = signals | {"density": jnp.asarray(SEA_LEVEL_DENSITY), "mach": jnp.zeros(())}
        # If the heading is not a state, it is not an output, and any value serves.
        y = self.instruments.read({"psi": jnp.zeros(())} | signals)
        if self.beta == "sideslip" and "beta" in self.channels.outputs:
            y = self._with_sideslip(y, signals)
        return y[self._columns]

    def observe(
        self, t: Float[Array, " time"], y: Float[Array, "time output"]
    ) -> Float[Array, "time output"]:
        """Return the outputs with the instruments' lags, delays and ranges; unchanged if there are
        none.

        Args:
            t: sample times [s].
            y: outputs at these times, from `outputs`.
        """
        table = jnp.zeros((y.shape[0], len(self.instruments.channels))).at[:, self._columns].set(y)
        observed = self.instruments.observe(t, table)
        return y if observed is table else observed[:, self._columns]

    def motion(
        self, measured: Mapping[str, Float[Array, ""]], known: Mapping[str, Float[Array, ""]]
    ) -> Signals:
        """Return the motion relative to the air at an instant, from readings and known true values.

        Args:
            measured: readings by channel, NaN where one is missing [its unit].
            known: true values by name; u, v and w over ground [SI].

        Returns:
            The signals of `instruments.inverse.motion`, with the states of the velocity in this
            frame.

        Raises:
            InputError: for a gust, if a speed or an air angle is not propagated.
        """
        known = self._less_gusts(dict(known) | dict(self.held))
        true = motion(self.instruments, measured, known, self.atmosphere, self.airspeed, self.beta)
        return self._translated(true) | true if {*"uvw"} <= set(true) else true

    def over_ground(self, true: Signals) -> Signals:
        """Return the velocities over ground where the model has a gust.

        Args:
            true: signals of `motion`.

        Returns:
            The sum of velocity and gust for u, v and w, if both are known [m/s].
        """
        gusts = self._gusts(true)
        return {name: true[name] + true[gust] for name, gust in gusts.items() if name in true}

    def first_state(self, record: Record, airframe: Airframe) -> Float[Array, " state"]:
        """Return the state at the first valid samples (see `IdentificationModel.initial_state`).

        Args:
            record: a single record.
            airframe: airframe whose weight determines the speed if the record has none.
        """
        measured = initial_channels(record)
        known = self._known_at_first(record, measured)
        for name in (*RATES, "phi", "pitch", "psi", "altitude"):
            if name not in measured:
                known.setdefault(name, jnp.zeros(()))
        for name in ("v", "w"):
            if not {AIR_DATA[name], name} & {*measured, *known}:
                known[name] = jnp.zeros(())
        if not {"V", "u"} & {*measured, *known}:
            altitude = measured.get("altitude", jnp.zeros(()))
            known["V"] = self._carrying_speed({"altitude": altitude} | known, airframe)
        true = self.motion(measured, known)
        true |= self.over_ground(true)
        true |= self._translated(true)
        return jnp.stack([true[name] for name in self.channels.states])

    @property
    def _columns(self) -> np.ndarray:
        """Indices of the outputs among the channels of the instruments."""
        return np.array([self.instruments.channels.index(name) for name in self.channels.outputs])

    def _with_sideslip(
        self, y: Float[Array, " channel"], signals: Signals
    ) -> Float[Array, " channel"]:
        """Return the readings with the sideslip instead of the flank angle in the channel beta."""
        omega = jnp.stack([signals[name] for name in RATES])
        through_air = jnp.stack([signals[name] for name in FLOW])
        local = velocity_at(through_air, omega, self.instruments.position["beta"])
        correction = air_angles(local)[2] - jnp.arctan2(local[1], local[0])
        return y.at[self.instruments.channels.index("beta")].add(
            (1.0 + self.instruments.scale["beta"]) * correction
        )

    def _less_gusts(self, known: Signals) -> Signals:
        """Return known values with u, v, w relative to the air."""
        gusts, channels = self._gusts(known), self.channels
        history = [name for name in channels.translation.names if name not in channels.states]
        require(
            not gusts or not history or channels.frame == "body",
            f"The inputs are gusts, {', '.join(gusts.values())}, and the model does not propagate "
            f"{', '.join(history)}: readings are relative to the air, and the model takes them "
            "over ground. Propagate V, alpha and beta, or choose the frame 'body'.",
        )
        moved = {name: known[name] - known[gust] for name, gust in gusts.items() if name in known}
        return known | moved

    def _gusts(self, known: Signals) -> dict[str, str]:
        """Return the known gusts of the model, by name of the velocity along each."""
        along = zip("uvw", GUSTS[:3], strict=True)
        inputs = self.channels.inputs
        return {name: gust for name, gust in along if gust in inputs and gust in known}

    def _translated(self, true: Signals) -> Signals:
        """Return the three states of the velocity in this frame."""
        translation = self.channels.translation
        states = translation.states(jnp.stack([true[name] for name in "uvw"]))
        return dict(zip(translation.names, states, strict=True))

    def _known_at_first(self, record: Record, measured: Mapping[str, Float[Array, ""]]) -> Signals:
        """Return values of the first row of inputs, held constants and constants of the record."""
        inputs = dict(zip(record.inputs, record.u[0], strict=True)) if record.inputs else {}
        known = {name: value for name, value in inputs.items() if name in SIGNALS} | dict(self.held)
        hidden = [name for name in record.constants if name in SIGNALS and name not in measured]
        return {name: record.constants[name] for name in hidden} | known

    def _carrying_speed(self, known: Signals, airframe: Airframe) -> Float[Array, ""]:
        """Return the speed at which a force coefficient of one carries the weight [m/s]."""
        density = air_of(self.atmosphere, known).density
        return jnp.sqrt(2.0 * airframe.mass_properties.mass * GRAVITY / (density * airframe.S))
