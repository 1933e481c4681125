"""Lower powers of selected terms, forced into a regression (report section 6.3.1)."""

from collections.abc import Callable, Sequence

import numpy as np

from ...models.polynomial import factors
from ...structure import Regression

INSIGNIFICANT = 1.0  # F of a value as large as its standard error, chosen


def with_lower_powers(
    regression: Regression,
    candidates: Sequence[str],
    fit: Callable[[Sequence[str]], Regression],
    stay: float,
) -> Regression:
    """Return a regression with the lower powers of its terms, and without the terms that are then
    insignificant.

    A term that divides another one of the regression stays unless its F is below one; the others
    leave if their F is below `stay`. They leave one at a time, the one that is the farthest below
    its level first.

    Args:
        regression: regression chosen from a stepwise path.
        candidates: terms of the response.
        fit: regression of the response on some terms.
        stay: least F of the other terms.
    """
    selected = regression.names
    lower = [
        term
        for term in candidates
        if term not in selected and any(is_lower_power(term, other) for other in selected)
    ]
    if not lower:
        return regression
    result = fit((*selected, *lower))
    while result.names:
        levels = [
            INSIGNIFICANT if any(is_lower_power(term, other) for other in result.names) else stay
            for term in result.names
        ]
        ratios = result.F / np.array(levels)
        if not np.min(ratios) < 1.0:
            break
        weakest = result.names[int(np.argmin(ratios))]
        result = fit(tuple(term for term in result.names if term != weakest))
    return result


def is_lower_power(term: str, other: str) -> bool:
    """Return True if a term is another one with lower powers, such as `alpha` and `alpha^2 beta`,
    or `rudder` and `alpha rudder`, without the constant.
    """
    mine, theirs = dict(factors(term)), dict(factors(other))
    return term != other and all(theirs.get(name, 0) >= power for name, power in mine.items())
