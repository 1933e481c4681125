"""The control system: trim, autopilot, stability augmentation and pilot, summed and handed to the actuators (D.1.5)."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from .._foundation.checks import require, require_known
from .._foundation.types import Array, Float
from .actuators import AbstractActuator, FirstOrder
from .augmentation import Augmentation
from .autopilot import Autopilot

SURFACES = ("stabilator", "aileron", "rudder")
LAG, RATE_DEG = 0.05, 60.0  # s and deg/s, our choice: the report prints no actuators


class ControlSystem(eqx.Module):
    """From the pilot's input to the surfaces.

        command = trim + autopilot + augmentation + pilot        actuator: command -> position

    Signs are the report's: stabilator positive with its trailing edge down (nose down), aileron positive to roll left,
    rudder positive to yaw left.

    Args:
        actuators: one for each of stabilator, aileron and rudder, with the stops.
        trim: positions of the surfaces in trim [rad].
        augmentation: feedback of rates; off by default.
        autopilot: feedback of attitude; off by default.

    Source: report App. D.1.3 to D.1.5.
    """

    trim: Float[Array, " surface"]
    augmentation: Augmentation
    autopilot: Autopilot
    actuators: tuple[AbstractActuator, ...]

    inputs: ClassVar[tuple[str, ...]] = tuple(f"pilot_{surface}" for surface in SURFACES)

    def __init__(
        self,
        actuators: tuple[AbstractActuator, ...],
        *,
        trim: Mapping[str, Float[Array, ""] | float] | None = None,
        augmentation: Augmentation | None = None,
        autopilot: Autopilot | None = None,
    ):
        require(len(actuators) == 3, f"There are {len(actuators)} actuators. Give one each for {', '.join(SURFACES)}.")
        trim = {} if trim is None else trim
        require_known("surface", trim, SURFACES)
        self.trim = jnp.stack([jnp.asarray(trim.get(surface, 0.0), float) for surface in SURFACES])
        self.augmentation = Augmentation() if augmentation is None else augmentation
        self.autopilot = Autopilot() if autopilot is None else autopilot
        self.actuators = actuators

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        return {"trim": tuple(f"trim.{surface}" for surface in SURFACES)}

    @property
    def states(self) -> tuple[str, ...]:
        """Those of the augmentation, then those of the actuators, whose positions carry the names of the surfaces."""
        of_actuators = zip(SURFACES, self.actuators, strict=True)
        return self.augmentation.states + tuple(name + end for name, one in of_actuators for end in one.suffixes)

    def positions(self, x: Float[Array, " control_state"]) -> dict[str, Float[Array, ""]]:
        """The surfaces [rad] that the states of the control system hold, by name."""
        return {surface: self._of_actuator(x, i)[0] for i, surface in enumerate(SURFACES)}

    def rates(
        self,
        t: Float[Array, ""],
        x: Float[Array, " control_state"],
        pilot: Float[Array, " surface"],
        signals: Mapping[str, Float[Array, ""]],
    ) -> Float[Array, " control_state"]:
        """Rates of the states of the control system.

        Args:
            t: time [s].
            x: its states.
            pilot: what the pilot adds to stabilator, aileron and rudder [rad].
            signals: with `p`, `r`, `qdot`, `rdot`, `ay`, `phi` and `gamma`.
        """
        own = x[: len(self.augmentation.states)]
        command = self.trim + pilot + self.autopilot.commands(t, signals) + self.augmentation.commands(t, own, signals)
        driven = [one.rates(self._of_actuator(x, i), command[i]) for i, one in enumerate(self.actuators)]
        return jnp.concatenate([self.augmentation.rates(t, own, signals["qdot"], signals["rdot"]), *driven])

    def resting(self) -> Float[Array, " control_state"]:
        """States at rest with the surfaces in trim."""
        at_trim = [one.resting(self.trim[i]) for i, one in enumerate(self.actuators)]
        return jnp.concatenate([jnp.zeros(len(self.augmentation.states)), *at_trim])

    def _of_actuator(self, x: Float[Array, " control_state"], i: int) -> Float[Array, " state"]:
        start = len(self.augmentation.states) + sum(len(one.suffixes) for one in self.actuators[:i])
        return x[start : start + len(self.actuators[i].suffixes)]


def standard_actuators(limits: Mapping[str, tuple[float, float]]) -> tuple[AbstractActuator, ...]:
    """First-order actuators of our choice (lag 0.05 s, 60 deg/s) with the stops of an airframe.

    Args:
        limits: (lower, upper) of each surface [rad].
    """
    return tuple(FirstOrder(LAG, jnp.radians(RATE_DEG), *limits[surface]) for surface in SURFACES)
