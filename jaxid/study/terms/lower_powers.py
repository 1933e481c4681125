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
    below = [term for term in candidates if _is_below(term, regression.names)]
    lower = [term for term in below if term not in regression.names]
    if not lower:
        return regression
    result = fit((*regression.names, *lower))
    while (weakest := _weakest(result, stay)) is not None:
        result = fit(tuple(term for term in result.names if term != weakest))
    return result


def _weakest(regression: Regression, stay: float) -> str | None:
    """Return the term that is the farthest below its level; None if all reach theirs."""
    names = regression.names
    levels = np.array([INSIGNIFICANT if _is_below(term, names) else stay for term in names])
    ratios = regression.F / levels
    return names[int(np.argmin(ratios))] if names and np.min(ratios) < 1.0 else None


def _is_below(term: str, names: Sequence[str]) -> bool:
    """Return True if a term is a lower power of one of some terms."""
    return any(is_lower_power(term, other) for other in names)


def is_lower_power(term: str, other: str) -> bool:
    """Return True if a term is another one with lower powers, such as `alpha` and `alpha^2 beta`,
    or `rudder` and `alpha rudder`, without the constant.
    """
    mine, theirs = dict(factors(term)), dict(factors(other))
    return term != other and all(theirs.get(name, 0) >= power for name, power in mine.items())
