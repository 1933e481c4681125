"""The residual, read: what it remembers, what it follows and over what it has a mean, pooled and record by record."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import numpy as np

from .._foundation.types import Array, Bool, Float
from .maps import ResidualMaps, residual_maps
from .residuals import ResidualTests, ljung_box, residual_tests

LAGS = 25  # samples


class Reading(NamedTuple):
    """What all tests together say of one residual.

    Attributes:
        tests: whiteness, and correlation with signals at lags, pooled over the records.
        maps: mean residual over each variable, pooled.
        by_record: p-values of whiteness of each record by itself; a faint memory shows pooled only.
    """

    tests: ResidualTests
    maps: ResidualMaps
    by_record: Float[np.ndarray, "case output"]

    def strongest(self, output: str) -> tuple[str, float, int]:
        """The signal that a channel follows most clearly, its correlation and the lag [samples]."""
        j, tests = self.tests.outputs.index(output), self.tests
        k = int(np.argmin(np.asarray(tests.cross_p)[j]))
        lag = int(tests.cross_lag[j, k])
        middle = (tests.cross_correlation.shape[-1] - 1) // 2
        return tests.signals[k], float(tests.cross_correlation[j, k, middle + lag]), lag

    def bent(self, output: str) -> tuple[str, float]:
        """The variable over which a channel's mean is least by chance, and its p-value."""
        p = np.asarray(self.maps.p_value)[self.maps.outputs.index(output)]
        return self.maps.variables[int(np.argmin(p))], float(np.min(p))

    def __str__(self) -> str:
        return f"{self.tests}\n\n{self.maps}"


def read(
    residuals: Float[Array, "case time output"],
    mask: Bool[Array, "case time output"],
    signals: Mapping[str, Float[Array, "case time"]],
    outputs: tuple[str, ...],
) -> Reading:
    """All tests of a residual.

    Args:
        residuals: `v = z - y` [output units].
        mask: valid samples.
        signals: states, inputs, and time as `t`, which is mapped over and not correlated with [any].
        outputs: names of the channels.

    Returns:
        The tests, pooled over the records, and their whiteness one by one.

    Raises:
        InputError: as `residual_tests` and `residual_maps`.
    """
    moving = {name: signal for name, signal in signals.items() if name != "t"}
    lags = min(LAGS, max(residuals.shape[1] // 5, 1))
    alone = jax.vmap(lambda v, seen: ljung_box(v[None], seen[None], lags).p_value)(residuals, mask)
    tests = residual_tests(residuals, mask, moving, outputs, lags=lags)
    return Reading(tests, residual_maps(residuals, mask, signals, outputs), np.asarray(alone))
