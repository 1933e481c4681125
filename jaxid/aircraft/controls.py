"""The control system: trim, autopilot, stability augmentation and pilot, summed and handed to the actuators (D.1.5)."""

import abc
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


class AbstractControls(eqx.Module):
    """How the surfaces follow what is put in.

    Attributes:
        states: its own states, names.
        inputs: what moves it, names.
        trim: positions of the surfaces in trim [rad].
    """

    states: eqx.AbstractVar[tuple[str, ...]]
    inputs: eqx.AbstractClassVar[tuple[str, ...]]
    trim: eqx.AbstractVar[Float[Array, " surface"]]

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        return {"trim": tuple(f"trim.{surface}" for surface in SURFACES)}

    @abc.abstractmethod
    def positions(self, x: Float[Array, " control_state"], u: Float[Array, " surface"]) -> dict[str, Float[Array, ""]]:
        """The surfaces [rad] by name, from its states and inputs."""

    @abc.abstractmethod
    def rates(
        self,
        t: Float[Array, ""],
        x: Float[Array, " control_state"],
        u: Float[Array, " surface"],
        signals: Mapping[str, Float[Array, ""]],
    ) -> Float[Array, " control_state"]:
        """Rates of its states.

        Args:
            t: time [s].
            x: its states.
            u: its inputs [rad].
            signals: with `p`, `r`, `qdot`, `rdot`, `ay`, `phi` and `gamma`.
        """

    @abc.abstractmethod
    def resting(self) -> Float[Array, " control_state"]:
        """Its states at rest with the surfaces in trim."""


class MeasuredSurfaces(AbstractControls):
    """Surfaces whose positions were recorded and are given as inputs, as a model for identification takes them.

        position = input + trim

    Args:
        trim: what the recorded positions are off by, or the whole trim where they are given about it [rad].
    """

    trim: Float[Array, " surface"]

    states: ClassVar[tuple[str, ...]] = ()
    inputs: ClassVar[tuple[str, ...]] = SURFACES

    def __init__(self, trim: Mapping[str, Float[Array, ""] | float] | None = None):
        self.trim = _by_surface(trim)

    def positions(self, x: Float[Array, " control_state"], u: Float[Array, " surface"]) -> dict[str, Float[Array, ""]]:
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
        self.trim = _by_surface(trim)
        self.augmentation = Augmentation() if augmentation is None else augmentation
        self.autopilot = Autopilot() if autopilot is None else autopilot
        self.actuators = actuators

    @property
    def states(self) -> tuple[str, ...]:
        """Those of the augmentation, then those of the actuators, whose positions carry the names of the surfaces."""
        of_actuators = zip(SURFACES, self.actuators, strict=True)
        return self.augmentation.states + tuple(name + end for name, one in of_actuators for end in one.suffixes)

    def positions(self, x: Float[Array, " control_state"], u: Float[Array, " surface"]) -> dict[str, Float[Array, ""]]:
        return {surface: self._of_actuator(x, i)[0] for i, surface in enumerate(SURFACES)}

    def rates(
        self,
        t: Float[Array, ""],
        x: Float[Array, " control_state"],
        u: Float[Array, " surface"],
        signals: Mapping[str, Float[Array, ""]],
    ) -> Float[Array, " control_state"]:
        own = x[: len(self.augmentation.states)]
        command = self.trim + u + self.autopilot.commands(t, signals) + self.augmentation.commands(t, own, signals)
        driven = [one.rates(self._of_actuator(x, i), command[i]) for i, one in enumerate(self.actuators)]
        return jnp.concatenate([self.augmentation.rates(t, own, signals["qdot"], signals["rdot"]), *driven])

    def resting(self) -> Float[Array, " control_state"]:
        at_trim = [one.resting(self.trim[i]) for i, one in enumerate(self.actuators)]
        return jnp.concatenate([jnp.zeros(len(self.augmentation.states)), *at_trim])

    def _of_actuator(self, x: Float[Array, " control_state"], i: int) -> Float[Array, " state"]:
        start = len(self.augmentation.states) + sum(len(one.suffixes) for one in self.actuators[:i])
        return x[start : start + len(self.actuators[i].suffixes)]


def _by_surface(trim: Mapping[str, Float[Array, ""] | float] | None) -> Float[Array, " surface"]:
    """Positions in the order of the surfaces, zero where none is given."""
    trim = {} if trim is None else trim
    require_known("surface", trim, SURFACES)
    return jnp.stack([jnp.asarray(trim.get(surface, 0.0), float) for surface in SURFACES])


def standard_actuators(limits: Mapping[str, tuple[float, float]]) -> tuple[AbstractActuator, ...]:
    """First-order actuators of our choice (lag 0.05 s, 60 deg/s) with the stops of an airframe.

    Args:
        limits: (lower, upper) of each surface [rad].
    """
    return tuple(FirstOrder(LAG, jnp.radians(RATE_DEG), *limits[surface]) for surface in SURFACES)
