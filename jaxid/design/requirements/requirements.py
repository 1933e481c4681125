"""Requirements on an input (section 5.1 of the report), and the result of their checks."""

import enum
from typing import NamedTuple

import equinox as eqx
import numpy as np

from ..._foundation.notebook import preformatted
from ...data.excitation import INFLATION
from ..information import PlannedInformation
from ..limits import Limits
from ..measures import AbstractMeasure

Range = tuple[float | None, float | None]

# Chosen: number of criteria shown of a check that is met; relative excess that is rounding.
LISTED, EXCESS = 3, 1e-9


class Requirements(eqx.Module):
    """Requirements on an input, each optional: a requirement that is not given is not checked.

    Quantities of the motion are states, outputs and signals of the model (among its signals are the
    inputs, unless the model overrides `signals`), by name. A range is the lowest and the highest
    value, None for no bound.

    Attributes:
        limits: amplitude, rate and energy of the inputs, and the safe envelope of the motion.
        pilot_frequency: frequency up to which the pilot can fly an input [Hz].
        pilot_share: largest share of the power of an input above it, under a Hann window (chosen).
        reversals: largest number of reversals per second of an input; a movement of less than 5 %
            of its range is none (chosen).
        trim_distance: largest distance of a quantity from trim in the last tenth of the record
            (chosen) [unit of the quantity].
        ranges: range of the instrument of each output.
        signal_to_noise: least ratio of the standard deviation of an output to its noise.
        quantum: quantum of the instrument of each output [unit of the output], at most one standard
            deviation of the noise: rounding then adds at most 1/12 to the variance of the noise.
        fast_share: largest share of the power of an output above half of the Nyquist frequency
            (chosen). Checked for outputs that move by more than their noise.
        valid: ranges of quantities in which the model is valid.
        interest: ranges of quantities in which the model will be used, with both bounds.
        time_inside: least share of the time in each range of interest (chosen: most of it).
        covered: least share of each range of interest through which the motion goes (chosen).
        goal: a measure of the information, and its largest cost.
        standard_errors, relative_errors: largest standard error of a free parameter, and largest
            share of its value.
        integrity: ranges of quantities that the structure bears, such as the load factor.
        parameters: the parameters of interest. They must be determined within 50 %, the boundary of
            "hardly determined" in `PlannedInformation`, unless their value is zero.
        inflation: largest ratio of the standard error of a parameter of interest with the other
            free parameters unknown to its error with them known (a variance inflation of 10).
    """

    limits: Limits | None = None
    pilot_frequency: float | None = None
    pilot_share: float = 0.1
    reversals: float | None = None
    trim_distance: dict[str, float] = eqx.field(default_factory=dict)
    ranges: dict[str, Range] = eqx.field(default_factory=dict)
    signal_to_noise: dict[str, float] = eqx.field(default_factory=dict)
    quantum: dict[str, float] = eqx.field(default_factory=dict)
    fast_share: float | None = 0.05
    valid: dict[str, Range] = eqx.field(default_factory=dict)
    interest: dict[str, Range] = eqx.field(default_factory=dict)
    time_inside: float = 0.5
    covered: float = 0.9
    goal: tuple[AbstractMeasure, float] | None = None
    standard_errors: dict[str, float] = eqx.field(default_factory=dict)
    relative_errors: dict[str, float] = eqx.field(default_factory=dict)
    integrity: dict[str, Range] = eqx.field(default_factory=dict)
    parameters: tuple[str, ...] = ()
    inflation: float = INFLATION**0.5


class Verdict(enum.Enum):
    """Verdict of a check; NOT_CHECKED if nothing was given to check the record against."""

    MET = "met"
    NOT_MET = "not met"
    NOT_CHECKED = "not checked"


class Criterion(NamedTuple):
    """A number of an input, and the limits within which it must lie.

    Attributes:
        name: name of the number.
        value: the number.
        remedy: a sentence for a number outside the limits.
        low, high: the limits, included.
    """

    name: str
    value: float
    remedy: str
    low: float = -np.inf
    high: float = np.inf

    @property
    def is_met(self) -> bool:
        """True if the number is within its limits, up to rounding; False if it is NaN."""
        low, high = (bound * EXCESS for bound in (abs(self.low), abs(self.high)))
        return bool(self.low - low <= self.value <= self.high + high)

    def __str__(self) -> str:
        words = {f"at least {self.low:.4g}": self.low, f"at most {self.high:.4g}": self.high}
        given = " and ".join(text for text, bound in words.items() if np.isfinite(bound))
        return f"{self.name} {self.value:.4g} ({given})"


class Check(NamedTuple):
    """The criteria of one requirement.

    Attributes:
        criteria: all criteria for which the requirements gave limits.
    """

    criteria: tuple[Criterion, ...]

    @property
    def verdict(self) -> Verdict:
        """MET if all criteria are met, NOT_CHECKED without any."""
        if not self.criteria:
            return Verdict.NOT_CHECKED
        return Verdict.MET if not self.failures else Verdict.NOT_MET

    @property
    def failures(self) -> tuple[Criterion, ...]:
        """The criteria that are not met."""
        return tuple(criterion for criterion in self.criteria if not criterion.is_met)

    @property
    def numbers(self) -> dict[str, float]:
        """The numbers of the criteria by name."""
        return {criterion.name: criterion.value for criterion in self.criteria}

    def __str__(self) -> str:
        """Each criterion that is not met with its remedy, on a line; else the first criteria."""
        if self.failures:
            return "\n".join(f"{failure}. {failure.remedy}" for failure in self.failures)
        more = len(self.criteria) - LISTED
        shown = [*map(str, self.criteria[:LISTED]), *([f"and {more} more"] if more > 0 else [])]
        return "; ".join(shown) or "nothing was given to check the record against"


class InputCheck(eqx.Module):
    """The seven requirements of section 5.1 of the report on an input.

    Attributes:
        pilot: safe and possible for the pilot: size, rate, frequencies and reversals of the inputs,
            the envelope, the return to trim (a).
        instruments: ranges, noise and resolution of the instruments, sample rate (b).
        procedure: the likelihood determines all free parameters, no collinear inputs (c).
        modelling: the motion stays where the model is valid, and covers the range of interest (d).
        objective: measure and standard errors that the use of the model needs (e).
        integrity: loads of the structure (f).
        sensitivity: parameters of interest determined, and not confounded with others (g).
        information: the predicted standard errors.
    """

    pilot: Check
    instruments: Check
    procedure: Check
    modelling: Check
    objective: Check
    integrity: Check
    sensitivity: Check
    information: PlannedInformation

    @property
    def checks(self) -> dict[str, Check]:
        """The checks by name of the requirement."""
        return {name: part for name, part in vars(self).items() if isinstance(part, Check)}

    @property
    def is_met(self) -> bool:
        """True if no requirement is violated; requirements that are not checked do not count."""
        return all(check.verdict is not Verdict.NOT_MET for check in self.checks.values())

    def __str__(self) -> str:
        lines = [f"{'requirement':<12} {'verdict':<12} numbers"]
        for name, check in self.checks.items():
            first, *others = str(check).splitlines()
            lines.append(f"{name:<12} {check.verdict.value:<12} {first}")
            lines += [f"{'':<25} {line}" for line in others]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return preformatted(str(self))
