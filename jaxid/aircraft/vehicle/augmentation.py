"""Stability augmentation: feedback of rates and lateral acceleration to the surfaces (App.
D.1.3).
"""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.types import Array, Float
from ..physics.imperial import FOOT

NEVER = 1e9  # s, chosen: beyond the end of any flight
# s, chosen: a switch closes within one sample of the report's records, and gains stay continuous
FADE = 0.1


class Switch(eqx.Module):
    """A switch that is on between two times, with a short linear fade at each end: `clip((t-on)
    /fade, 0, 1) - clip((t-off)/fade, 0, 1)`.

    Args:
        on, off: times at which it starts to close and to open [s]; never, by default.
        fade: duration of closing and of opening [s].
    """

    on: Float[Array, ""]
    off: Float[Array, ""]
    fade: Float[Array, ""]

    def __init__(
        self, on: Float[Array, ""] | float = NEVER, off: Float[Array, ""] | float = NEVER, fade=FADE
    ):
        self.on, self.off, self.fade = (jnp.asarray(value, float) for value in (on, off, fade))

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """Return the state of the switch, from 0 (open) to 1 (closed)."""
        return jnp.clip((t - self.on) / self.fade, 0.0, 1.0) - jnp.clip(
            (t - self.off) / self.fade, 0.0, 1.0
        )


ALWAYS = -NEVER  # s, for `Switch(on=ALWAYS)`


class Augmentation(eqx.Module):
    """The report's stability augmentation in pitch, yaw and roll (D.1.3); off by default.

        pitch:  d(s)/dt = .15 qdot - s      stabilator' = clip(s, +-0.5 deg)
        yaw:    d(n)/dt = 3 rdot - n/2      rudder'     = clip(n + .0168 a_y, +-5 deg)
        roll:                               aileron'    = clip(.265 p, +-7.5 deg)

    with a_y in ft/s^2. The report prints no units. The rate gains do not depend on the unit of
    angle. The limits are read as degrees, the unit of the neighbouring limits; the gain of the
    lateral acceleration as degrees per ft/s^2, because in radians it would move the rudder by 31
    deg at 1 g. The washed-out signals are at rest until the switch closes.

    Args:
        switch: schedule of the augmentation.
        pitch_gain: 0.15 [s]. yaw_gain: 3 [s]. roll_gain: 0.265 [s].
        pitch_washout, yaw_washout: 1 and 1/2 [1/s].
        acceleration_gain: of the lateral acceleration [rad per m/s^2].
        pitch_limit, yaw_limit, roll_limit: authority [rad].

    Source: report App. D.1.3.
    """

    switch: Switch
    pitch_gain: Float[Array, ""]
    yaw_gain: Float[Array, ""]
    roll_gain: Float[Array, ""]
    pitch_washout: Float[Array, ""]
    yaw_washout: Float[Array, ""]
    acceleration_gain: Float[Array, ""]
    pitch_limit: Float[Array, ""]
    yaw_limit: Float[Array, ""]
    roll_limit: Float[Array, ""]

    states: ClassVar[tuple[str, ...]] = ("sas_pitch", "sas_yaw")

    def __init__(self, switch: Switch | None = None):
        self.switch = Switch() if switch is None else switch
        self.pitch_gain, self.yaw_gain, self.roll_gain = (
            jnp.asarray(gain) for gain in (0.15, 3.0, 0.265)
        )
        self.pitch_washout, self.yaw_washout = jnp.asarray(1.0), jnp.asarray(0.5)
        self.acceleration_gain = jnp.radians(0.0168) / FOOT
        self.pitch_limit, self.yaw_limit, self.roll_limit = (
            jnp.radians(limit) for limit in (0.5, 5.0, 7.5)
        )

    def rates(
        self,
        t: Float[Array, ""],
        x: Float[Array, " state"],
        qdot: Float[Array, ""],
        rdot: Float[Array, ""],
    ) -> Float[Array, " state"]:
        """Return the rates of the two washed-out signals [rad/s], from the angular accelerations
        [rad/s^2].
        """
        driven = self.switch(t) * jnp.stack([self.pitch_gain * qdot, self.yaw_gain * rdot])
        return driven - jnp.stack([self.pitch_washout, self.yaw_washout]) * x

    def commands(
        self,
        t: Float[Array, ""],
        x: Float[Array, " state"],
        signals: Mapping[str, Float[Array, ""]],
    ) -> Float[Array, "3"]:
        """Return the increments of stabilator, aileron and rudder [rad].

        Args:
            t: time [s].
            x: its states [rad].
            signals: with `p` [rad/s] and `ay` [m/s^2].
        """
        pitch = jnp.clip(x[0], -self.pitch_limit, self.pitch_limit)
        roll = jnp.clip(self.roll_gain * signals["p"], -self.roll_limit, self.roll_limit)
        yaw = jnp.clip(
            x[1] + self.acceleration_gain * signals["ay"], -self.yaw_limit, self.yaw_limit
        )
        return self.switch(t) * jnp.stack([pitch, roll, yaw])
