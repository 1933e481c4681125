"""The control system: the sum of trim, autopilot, stability augmentation and pilot commands the
actuators (D.1.5).
"""

import abc
from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.checks import require, require_known
from ..._foundation.types import Array, Float
from .actuators import AbstractActuator, FirstOrder
from .augmentation import Augmentation
from .autopilot import Autopilot

SURFACES = ("stabilator", "aileron", "rudder")
LAG, RATE_DEG = 0.05, 60.0  # s and deg/s, chosen: the report prints no actuators


class AbstractControls(eqx.Module):
    """Dynamics from the control inputs to the surfaces.

    Attributes:
        states: names of its states.
        inputs: names of its inputs.
        trim: positions of the surfaces in trim [rad].
    """

    states: eqx.AbstractVar[tuple[str, ...]]
    inputs: eqx.AbstractClassVar[tuple[str, ...]]
    trim: eqx.AbstractVar[Float[Array, " surface"]]

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        return {"trim": tuple(f"trim.{surface}" for surface in SURFACES)}

    @abc.abstractmethod
    def positions(
        self, x: Float[Array, " control_state"], u: Float[Array, " surface"]
    ) -> dict[str, Float[Array, ""]]:
        """Return the positions of the surfaces [rad] by name, from states and inputs."""

    @abc.abstractmethod
    def rates(
        self,
        t: Float[Array, ""],
        x: Float[Array, " control_state"],
        u: Float[Array, " surface"],
        signals: Mapping[str, Float[Array, ""]],
    ) -> Float[Array, " control_state"]:
        """Return the rates of the states.

        Args:
            t: time [s].
            x: its states.
            u: its inputs [rad].
            signals: with `p`, `r`, `qdot`, `rdot`, `ay`, `phi` and `gamma`.
        """

    @abc.abstractmethod
    def resting(self) -> Float[Array, " control_state"]:
        """Return the states at rest with the surfaces in trim."""


class MeasuredSurfaces(AbstractControls):
    """Surfaces with recorded positions as inputs, for identification.

        position = input + trim

    Args:
        trim: correction of the recorded positions, or the positions in trim if the inputs are
            deviations from trim [rad].
    """

    trim: Float[Array, " surface"]

    states: ClassVar[tuple[str, ...]] = ()
    inputs: ClassVar[tuple[str, ...]] = SURFACES

    def __init__(self, trim: Mapping[str, Float[Array, ""] | float] | None = None):
        self.trim = _by_surface(trim)

    def positions(
        self, x: Float[Array, " control_state"], u: Float[Array, " surface"]
    ) -> dict[str, Float[Array, ""]]:
        return dict(zip(SURFACES, u + self.trim, strict=True))

    def rates(
        self,
        t: Float[Array, ""],
        x: Float[Array, " control_state"],
        u: Float[Array, " surface"],
        signals: Mapping[str, Float[Array, ""]],
    ) -> Float[Array, " control_state"]:
        return jnp.zeros(0)

    def resting(self) -> Float[Array, " control_state"]:
        return jnp.zeros(0)


class ControlSystem(AbstractControls):
    """A control system with actuators, from the pilot's inputs to the surfaces.

        command = trim + autopilot + augmentation + pilot        actuator: command -> position

    Signs are the report's: stabilator positive with its trailing edge down (nose down), aileron
    positive to roll left, rudder positive to yaw left.

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
        require(
            len(actuators) == 3,
            f"There are {len(actuators)} actuators. Give one each for {', '.join(SURFACES)}.",
        )
        self.trim = _by_surface(trim)
        self.augmentation = Augmentation() if augmentation is None else augmentation
        self.autopilot = Autopilot() if autopilot is None else autopilot
        self.actuators = actuators

    @property
    def states(self) -> tuple[str, ...]:
        """States of the augmentation, then of the actuators, whose positions have the names of the
        surfaces.
        """
        of_actuators = zip(SURFACES, self.actuators, strict=True)
        return self.augmentation.states + tuple(
            name + suffix for name, actuator in of_actuators for suffix in actuator.suffixes
        )

    def positions(
        self, x: Float[Array, " control_state"], u: Float[Array, " surface"]
    ) -> dict[str, Float[Array, ""]]:
        return {surface: self._of_actuator(x, i)[0] for i, surface in enumerate(SURFACES)}

    def rates(
        self,
        t: Float[Array, ""],
        x: Float[Array, " control_state"],
        u: Float[Array, " surface"],
        signals: Mapping[str, Float[Array, ""]],
    ) -> Float[Array, " control_state"]:
        washed_out = x[: len(self.augmentation.states)]
        command = (
            self.trim
            + u
            + self.autopilot.commands(t, signals)
            + self.augmentation.commands(t, washed_out, signals)
        )
        actuator_rates = [
            actuator.rates(self._of_actuator(x, i), command[i])
            for i, actuator in enumerate(self.actuators)
        ]
        augmentation_rates = self.augmentation.rates(
            t, washed_out, signals["qdot"], signals["rdot"]
        )
        return jnp.concatenate([augmentation_rates, *actuator_rates])

    def resting(self) -> Float[Array, " control_state"]:
        at_trim = [actuator.resting(self.trim[i]) for i, actuator in enumerate(self.actuators)]
        return jnp.concatenate([jnp.zeros(len(self.augmentation.states)), *at_trim])

    def _of_actuator(self, x: Float[Array, " control_state"], i: int) -> Float[Array, " state"]:
        before = sum(len(actuator.suffixes) for actuator in self.actuators[:i])
        start = len(self.augmentation.states) + before
        return x[start : start + len(self.actuators[i].suffixes)]


def _by_surface(trim: Mapping[str, Float[Array, ""] | float] | None) -> Float[Array, " surface"]:
    """Return positions in the order of the surfaces; the default is zero."""
    trim = {} if trim is None else trim
    require_known("surface", trim, SURFACES)
    return jnp.stack([jnp.asarray(trim.get(surface, 0.0), float) for surface in SURFACES])


def standard_actuators(limits: Mapping[str, tuple[float, float]]) -> tuple[AbstractActuator, ...]:
    """Return first-order actuators (lag 0.05 s, 60 deg/s, chosen) with the stops of an airframe.

    Args:
        limits: (lower, upper) of each surface [rad].
    """
    return tuple(FirstOrder(LAG, jnp.radians(RATE_DEG), *limits[surface]) for surface in SURFACES)
