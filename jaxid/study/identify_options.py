"""`IdentifyOptions`: levels and rules of `identify`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._foundation.checks import require, require_unique
from ..structure import REPORT, AbstractRule, MaximumF, Minimum, SubsetOptions


@dataclass(frozen=True)
class IdentifyOptions:
    """Rules of `identify`, each with the report's value, and exceptions from them by name.

    Args:
        subset: levels of the regression, for all responses or by response (Table 6.2).
        rule: selects the step of a regression; by default the step of the largest overall F
            (section 6.2.2.2, rule 4). `FirstMaximumF` (section 3.3.2) stops at the first decrease,
            which may come after one term.
        weak_radius: half of the length of the test functions of a regression in weak form [s], see
            `jaxid.structure.weak_form`; about half a period of the motion suits. By default the
            regression takes the samples themselves, and needs recorded or computed derivatives.
        least_F: an equation whose overall F is below this is left out, and its state takes its
            measured history (section 6.2.3.1). F grows with the number of samples: the report's
            records of some hundred samples reach 100 with a regression that explains more than half
            of the response, a record of 3,000 samples with 10 % of it.
        least_R2: an equation is also left out if the regression explains a smaller share of its
            response than this. The report has no such rule (0).
        share: terms whose F is at least this share of the largest in their equation are estimated;
            the others keep the values of the regression (the 4 % rule, section 6.2.3.1).
        constants: True if the constant of each equation is estimated too (Table 6.4).
        adapt: True to add, delete and hold terms after the first estimate, by the levels of
            `subset`, with an estimate after each change (sections 1.3, 4.3.2).
        prior: a-priori mean and standard deviation of terms by dotted name, such as
            `{"Cm.alpha": (-0.6, 0.2)}`, from a wind tunnel or another flight; for increments to
            tables the mean is zero. These terms are estimated with this prior, whatever their F,
            and start at the mean if the regression does not select them; their equations are kept.
        lower_powers: True to force in the lower powers of selected terms, such as alpha beta for
            alpha^2 beta, which high noise hides behind a high one (section 6.3.1). They leave if
            their F is below one, the high powers if it is below the level to stay.
        add: further parameters to estimate, by their dotted name in the model, such as a bias; a
            parameter of an instrument that the final model does not have is refused.
        keep: responses whose equation is kept, whatever its F.
        leave_out: responses whose equation is left out, whatever its F.
        terms: terms by response, instead of those that the regression would choose; their values
            still come from the regression.
        estimate: terms that are estimated, whatever their F, by response.
        fix: terms that keep the value of the regression, whatever their F, by response.

    Raises:
        InputError: if a number is out of its range, or a response is both kept and left out.
    """

    subset: SubsetOptions | Mapping[str, SubsetOptions] = REPORT
    rule: AbstractRule = field(default_factory=MaximumF)
    weak_radius: float | None = None
    least_F: float = 100.0  # noqa: N815
    least_R2: float = 0.0  # noqa: N815
    share: float = 0.04
    constants: bool = True
    adapt: bool = False
    prior: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    lower_powers: bool = False
    add: Sequence[str] = ()
    keep: Sequence[str] = ()
    leave_out: Sequence[str] = ()
    terms: Mapping[str, Sequence[str]] = field(default_factory=dict)
    estimate: Mapping[str, Sequence[str]] = field(default_factory=dict)
    fix: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def __post_init__(self):
        require(
            self.weak_radius is None or self.weak_radius > 0,
            f"weak_radius is {self.weak_radius} s; it must be positive.",
        )
        require(self.least_F >= 0, f"least_F is {self.least_F}; an F is not negative.")
        require(
            0 <= self.least_R2 < 1,
            f"least_R2 is {self.least_R2}; it is a share, at least 0 and below 1.",
        )
        require(
            0 <= self.share <= 1,
            f"The share is {self.share}; it lies between 0 and 1, the report's is 0.04.",
        )
        require_unique("response in keep and leave_out", (*self.keep, *self.leave_out))
        require(
            not (self.adapt and self.prior),
            "Terms with a-priori values are not added or deleted. Leave `adapt` or `prior` out.",
        )
        both = [name for name in self.prior_terms if name in self.leave_out]
        require(
            not both,
            f"The equation of {', '.join(both)} is to be left out, and a-priori values keep it. "
            "Take it out of `leave_out` or `prior`.",
        )
        for name, values in self.prior.items():
            require(
                "." in name and _is_prior(values),
                f"The prior of {name!r} is {values}. Name a term, such as 'Cm.alpha', and give its "
                "mean and a positive standard deviation.",
            )

    @property
    def named(self) -> tuple[str, ...]:
        """All responses that an option names."""
        by_name = (
            self.terms,
            self.estimate,
            self.fix,
            *((self.subset,) if isinstance(self.subset, Mapping) else ()),
        )
        return (
            *self.keep,
            *self.leave_out,
            *(name for option in by_name for name in option),
            *self.prior_terms,
        )

    @property
    def prior_terms(self) -> dict[str, tuple[str, ...]]:
        """Terms with a-priori values, by response."""
        parts = [name.partition(".") for name in self.prior]
        return {
            response: tuple(term for other, _, term in parts if other == response)
            for response, _, _ in parts
        }

    def subset_of(self, response: str) -> SubsetOptions:
        """Return the levels of the regression for one response."""
        return (
            self.subset
            if isinstance(self.subset, SubsetOptions)
            else self.subset.get(response, REPORT)
        )


def _is_prior(values: Any) -> bool:
    """Return True for a finite mean and a finite, positive standard deviation."""
    pair = np.asarray(values)
    numbers = pair.shape == (2,) and pair.dtype.kind in "fi"
    return numbers and bool(np.all(np.isfinite(pair)) and pair[1] > 0)


# For records of a thousand samples and more, for which the report's levels are too weak: a
# regression that explains 10 % of a response reaches an F of 100, and a single term can have the
# largest overall F because further terms explain little more. Here half of the response must be
# explained, the terms are those of least BIC, and all of them are estimated.
LONG_RECORDS = IdentifyOptions(rule=Minimum("BIC"), least_R2=0.5, share=0.0)
