"""`Reduction`: a structure with lower powers or fewer terms, for a start that diverges."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...models.polynomial import factors
from ...structure import Regression


class Reduction(NamedTuple):
    """Limits of the terms of each response.

    Attributes:
        power: largest total power of a term, such as 3 for `alpha^2 beta`; None for any.
        most: largest number of terms; None for any.
    """

    power: int | None = None
    most: int | None = None

    def __str__(self) -> str:
        parts = [] if self.power is None else [f"terms up to power {self.power}"]
        parts += [] if self.most is None else [f"at most {self.most} of them"]
        return ", ".join(parts) or "the terms as selected"

    def admitted(self, candidates: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
        """Return the candidates within the power.

        Args:
            candidates: terms by response.
        """
        return {
            name: tuple(term for term in terms if self.power is None or power(term) <= self.power)
            for name, terms in candidates.items()
        }

    def kept(self, regression: Regression) -> tuple[str, ...]:
        """Return the terms of largest F within the number, in the order of the regression.

        Args:
            regression: regression of one response.
        """
        if self.most is None or len(regression.names) <= self.most:
            return regression.names
        strongest = np.argsort(-regression.F)[: self.most]
        return tuple(name for k, name in enumerate(regression.names) if k in strongest)


AS_SELECTED = Reduction()
# chosen: lower powers first, because high ones turn a small error of the motion into divergence
REDUCTIONS = (*(Reduction(power) for power in (5, 3, 2, 1)), Reduction(1, 2), Reduction(1, 1))


def power(term: str) -> int:
    """Return the total power of a term, 3 for `alpha^2 beta`."""
    return sum(exponent for _, exponent in factors(term))
