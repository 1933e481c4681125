"""The report's autopilot, a model of a pilot who holds the wings level and the path horizontal
(App. D.1.4).
"""

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.types import Array, Float
from .augmentation import Switch


class Autopilot(eqx.Module):
    """Feedback of bank, yaw rate and flight path to the surfaces (D.1.4); off by default.

        rudder = 7 r + phi,    aileron = 0.3 phi,    stabilator = gamma

    Args:
        switch: schedule of the autopilot.
        yaw_rate_gain: 7 [s]. bank_to_rudder: 1. bank_to_aileron: 0.3. path_gain: 1.

    Source: report App. D.1.4.
    """

    switch: Switch
    yaw_rate_gain: Float[Array, ""]
    bank_to_rudder: Float[Array, ""]
    bank_to_aileron: Float[Array, ""]
    path_gain: Float[Array, ""]

    def __init__(self, switch: Switch | None = None):
        self.switch = Switch() if switch is None else switch
        self.yaw_rate_gain, self.bank_to_rudder = jnp.asarray(7.0), jnp.asarray(1.0)
        self.bank_to_aileron, self.path_gain = jnp.asarray(0.3), jnp.asarray(1.0)

    def commands(
        self, t: Float[Array, ""], signals: Mapping[str, Float[Array, ""]]
    ) -> Float[Array, "3"]:
        """Return the increments of stabilator, aileron and rudder [rad].

        Args:
            t: time [s].
            signals: with `gamma`, `phi` [rad] and `r` [rad/s].
        """
        stabilator, aileron = (
            self.path_gain * signals["gamma"],
            self.bank_to_aileron * signals["phi"],
        )
        rudder = self.yaw_rate_gain * signals["r"] + self.bank_to_rudder * signals["phi"]
        return self.switch(t) * jnp.stack([stabilator, aileron, rudder])
