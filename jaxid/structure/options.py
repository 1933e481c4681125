"""Options of stepwise regression: levels of F, tolerance, forced terms, limits."""

import enum
from dataclasses import dataclass

from .._foundation.checks import member, require, require_known, require_unique
from .criteria import critical_F

# about the 95 % level for many samples; the usual value (Efroymson, 1960)
DEFAULT_F = 4.0


class Direction(enum.Enum):
    """Direction of stepwise regression; options also accept the value as text.

    Attributes:
        BOTH: checks for removal before each entry.
        FORWARD: only adds terms.
        BACKWARD: only removes terms.
        FORWARD_THEN_BACKWARD: adds all terms and then removes all, whatever their F, for rules that
            select a model by a criterion. A term that entered early in place of others leaves in
            the backward pass, so that the path contains the right model more often.
    """

    BOTH = "both"
    FORWARD = "forward"
    BACKWARD = "backward"
    FORWARD_THEN_BACKWARD = "forward then backward"


@dataclass(frozen=True)
class SubsetOptions:
    """Options of stepwise regression (Appendix B.2.3, Table 6.2).

    Give a level of F as a number or as a probability, not both. The F of a probability increases as
    degrees of freedom are used up. A removal level above the entry level is refused, because a term
    could enter and leave endlessly.

    Args:
        F_in, F_out: least F for a term to enter, and to stay.
        level_in, level_out: the same as probabilities of exceeding F by chance; `level_out` is
            `level_in` by default.
        tolerance: least share of a column, unexplained by the terms in the model, for its term to
            enter (section B.3).
        R2_stop: squared multiple correlation at which no further term enters; never for 1.
        direction: a `Direction`, or its value, such as `"forward"`.
        force_in: terms that enter first, in this order, and stay.
        force_out: terms that never enter.
        max_terms: largest number of terms in a model; no limit by default. Not for a direction that
            begins with all terms.
        PSE_bound: upper bound of the noise variance for PSE [response^2]; mean square of the
            response about its mean by default.

    Raises:
        InputError: if an option is out of range, or two options contradict each other.
    """

    F_in: float | None = None
    F_out: float | None = None
    level_in: float | None = None
    level_out: float | None = None
    tolerance: float = 0.01
    R2_stop: float = 1.0
    direction: Direction | str = Direction.BOTH
    force_in: tuple[str, ...] = ()
    force_out: tuple[str, ...] = ()
    max_terms: int | None = None
    PSE_bound: float | None = None

    def __post_init__(self):
        direction = member("direction", self.direction, Direction)
        object.__setattr__(self, "direction", direction)
        numbers = self.F_in is not None or self.F_out is not None
        levels = self.level_in is not None or self.level_out is not None
        require(
            not (numbers and levels),
            "Levels of F are given as numbers and as probabilities. Give one kind.",
        )
        require(
            self.level_out is None or self.level_in is not None,
            "level_out is given without level_in. Give both.",
        )
        require(
            0 < self.tolerance < 1,
            f"The tolerance is {self.tolerance}; it lies between 0 and 1, the report's is 0.01.",
        )
        require(
            0 < self.R2_stop <= 1, f"R2_stop is {self.R2_stop}; it lies above 0 and is at most 1."
        )
        require(
            direction is not Direction.FORWARD_THEN_BACKWARD or not (numbers or levels),
            "The direction 'forward then backward' uses no level of F. Leave the levels out, or "
            "choose another direction.",
        )
        require_unique("term in force_in and force_out", (*self.force_in, *self.force_out))
        most, forced = self.max_terms, len(self.force_in)
        require(
            most is None or most >= max(forced, 1),
            f"max_terms is {most}, and {forced} terms are forced in. Allow at least as many terms, "
            "and at least one.",
        )
        require(
            most is None or direction in (Direction.BOTH, Direction.FORWARD),
            f"max_terms is {most}, and the direction {direction.value!r} has models of all "
            "terms. Leave max_terms out, or choose the direction 'forward' or 'both'.",
        )
        require(
            self.PSE_bound is None or self.PSE_bound > 0,
            f"PSE_bound is {self.PSE_bound}; a variance is positive.",
        )
        enter, leave = self.F_to_enter(100), self.F_to_stay(100)
        require(
            0 <= leave <= enter,
            f"A term enters at F = {enter:g} and stays at {leave:g}. The level to stay must not be "
            "negative or the higher of the two.",
        )

    def F_to_enter(self, dof: int) -> float:
        """Return the least F for a term to enter, `dof` counted with the term in the model."""
        if self.level_in is not None:
            return critical_F(self.level_in, dof)
        return DEFAULT_F if self.F_in is None else self.F_in

    def F_to_stay(self, dof: int) -> float:
        """Return the least F for a term to stay, `dof` counted with the term in the model."""
        if self.level_in is not None:
            return critical_F(self.level_in if self.level_out is None else self.level_out, dof)
        return self.F_to_enter(dof) if self.F_out is None else self.F_out

    def check(self, names: tuple[str, ...]) -> None:
        """Check that forced names are candidates.

        Raises:
            InputError: if a name is not among the candidates.
        """
        require_known("candidate to force in", self.force_in, names)
        require_known("candidate to force out", self.force_out, names)


REPORT = SubsetOptions(F_in=3.0, F_out=3.0, tolerance=0.01, R2_stop=0.999)  # Table 6.2
