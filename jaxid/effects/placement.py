"""`Placement`: equations of motion in which a scalar acts, directly or through a coefficient."""

import dataclasses
from abc import abstractmethod
from collections.abc import Mapping

import equinox as eqx

from .._foundation.location import Location, LocationKind
from .._foundation.types import Array, Float
from ..models.polynomial import monomials
from .base import Effect, Signals

# complexity of a shape of one signal (chosen): equal to a cubic term, which it may resemble
AS_CUBIC = 3


@dataclasses.dataclass(frozen=True)
class Placement:
    """Equations in which a scalar acts: `d(state)/dt += multiplier * scalar` for each state.

    Args:
        name: name of the equation or the coefficient.
        affected: pairs of a state and the multiplier of the scalar in its equation: a product of
            signals, such as `"q_per_Cm"`, or `"1"`.
    """

    name: str
    affected: tuple[tuple[str, str], ...]

    @classmethod
    def equation(cls, state: str) -> "Placement":
        """Return the placement in the equation of one state, with multiplier one."""
        return cls(state, ((state, "1"),))

    @property
    def location(self) -> Location:
        """Location of the scalar: an equation or a coefficient."""
        kind = LocationKind.EQUATION if self._is_equation else LocationKind.COEFFICIENT
        return Location(kind, self.name)

    @property
    def words(self) -> str:
        """The location as an adverbial phrase, such as "in the equation of x"."""
        return f"in the {self.location}"

    def distribute(
        self, scalar: Float[Array, ""], signals: Mapping[str, Float[Array, ""]]
    ) -> Signals:
        """Return the terms that the scalar adds to the state derivatives, by state."""
        if self._is_equation:
            return {self.name: scalar}
        states, multipliers = zip(*self.affected, strict=True)
        return dict(zip(states, scalar * monomials(multipliers, signals), strict=True))

    @property
    def _is_equation(self) -> bool:
        return self.affected == ((self.name, "1"),)


class ScalarEffect(Effect):
    """An effect that adds `gain` times a scalar function of one signal to equations of motion.

    Attributes:
        placement: equations in which the scalar acts.
        signal: argument of the function.
    """

    placement: eqx.AbstractVar[Placement]
    signal: eqx.AbstractVar[str]

    @abstractmethod
    def scalar(self, signals: Signals) -> Float[Array, ""]:
        """Return the scalar at a gain of one."""

    def equations(self, dx, signals):
        return self.placement.distribute(self.gain * self.scalar(signals), signals)
