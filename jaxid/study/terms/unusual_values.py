"""`Parameter`: a row of an identification; parameters outside the range of their usual values."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

OUTSIDE = 2.0  # standard errors beyond the range, chosen


class Parameter(NamedTuple):
    """One row of the result, as in Table 6.5; NaN if a stage does not have the number.

    Attributes:
        name: name in the model.
        regression, regression_F: value and F of the regression.
        start, start_F: value and F at the start of maximum likelihood.
        value, standard_error, coloured_error, F: result of maximum likelihood; NaN for a parameter
            that it did not estimate.
    """

    name: str
    regression: float
    regression_F: float  # noqa: N815
    start: float
    start_F: float  # noqa: N815
    value: float
    standard_error: float
    coloured_error: float
    F: float


def unusual_values(
    parameters: Iterable[Parameter], ranges: Mapping[str, tuple[float, float]]
) -> tuple[str, ...]:
    """Return a sentence for each estimate more than two standard errors outside its usual range.

    Args:
        parameters: results of both stages.
        ranges: lowest and highest usual value by name (`AbstractModel.usual_ranges`).
    """
    return tuple(
        f"{row.name} is {row.value:.4g}, outside the usual {low:g} to {high:g}: it may stand for "
        "another effect, such as a late or biased channel. Check the instruments "
        "(`jaxid.consistency`), or search for the effect (`jaxid.close_loop`)."
        for row in parameters
        for low, high in [ranges.get(row.name, (-np.inf, np.inf))]
        if max(low - row.value, row.value - high) > OUTSIDE * row.coloured_error
    )
