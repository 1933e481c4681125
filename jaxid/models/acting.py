"""`Acting`: how one scalar enters the equations of motion: in one equation, or through a coefficient in several of them."""

import dataclasses
from abc import abstractmethod
from collections.abc import Mapping

import equinox as eqx

from .._foundation.types import Array, Float
from .effects import Effect, Signals
from .polynomial import monomials


@dataclasses.dataclass(frozen=True)
class Acting:
    """Where a scalar acts: `d(state)/dt += multiplier * scalar` for each state that it moves.

    Args:
        name: of the equation or the coefficient.
        moved: states, and by what the scalar is multiplied in the equation of each: a product of signals, such as
            `"q_per_Cm"`, or `"1"`.
    """

    name: str
    moved: tuple[tuple[str, str], ...]

    @classmethod
    def equation(cls, state: str) -> "Acting":
        """In the equation of one state, as it is."""
        return cls(state, ((state, "1"),))

    @property
    def place(self) -> str:
        """Where that is: `equation of v`, `coefficient Cm`."""
        return f"{'equation of' if self._is_equation else 'coefficient'} {self.name}"

    @property
    def words(self) -> str:
        """The place in a sentence."""
        return f"in the {self.place}"

    def spread(self, scalar: Float[Array, ""], signals: Mapping[str, Float[Array, ""]]) -> Signals:
        """What the scalar adds to each state's rate."""
        if self._is_equation:
            return {self.name: scalar}
        states, multipliers = zip(*self.moved, strict=True)
        return dict(zip(states, scalar * monomials(multipliers, signals), strict=True))

    @property
    def _is_equation(self) -> bool:
        return self.moved == ((self.name, "1"),)


class ActingEffect(Effect):
    """An effect that adds `gain` times a scalar, made of one signal, where `acting` says.

    Attributes:
        acting: where it acts.
        signal: what it is made of.
    """

    acting: eqx.AbstractVar[Acting]
    signal: eqx.AbstractVar[str]

    @abstractmethod
    def scalar(self, signals: Signals) -> Float[Array, ""]:
        """What is added where it acts, at a gain of one."""

    @property
    def place(self):
        return self.acting.place

    @property
    def signals_used(self):
        return (self.signal,)

    @property
    def complexity(self):
        return 3  # no simpler than a cubic term, which it may resemble

    def equations(self, dx, signals):
        return self.acting.spread(self.gain * self.scalar(signals), signals)
