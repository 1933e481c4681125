"""Report on a residual: whiteness, correlation with signals, and mean over variables."""

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from .._foundation.types import Array, Bool, Float
from .maps import ResidualMaps, residual_maps
from .residuals import ResidualTests, ljung_box, residual_tests
from .thresholds import WHITENESS_LAGS


class Correlation(NamedTuple):
    """Correlation of a residual channel with a lagged signal.

    Attributes:
        signal: its name.
        correlation: between -1 and 1.
        lag: of the signal [samples].
    """

    signal: str
    correlation: float
    lag: int


class ResidualReport(NamedTuple):
    """Results of all tests of one residual.

    Attributes:
        tests: whiteness, and correlation with signals at lags, pooled over the records.
        maps: mean residual over each variable, pooled.
        by_record: p-values of whiteness of each single record; weak correlation is significant only
            in the pooled test.
    """

    tests: ResidualTests
    maps: ResidualMaps
    by_record: Float[np.ndarray, "case output"]

    def strongest_correlation(self, output: str) -> Correlation:
        """Return the most significant correlation of a channel with a signal; the largest of those
        whose p-values are equal, as zero is.
        """
        j, tests = self.tests.outputs.index(output), self.tests
        lags = np.asarray(tests.cross_lag)[j]
        middle = (tests.cross_correlation.shape[-1] - 1) // 2
        rows = np.arange(lags.size)
        correlations = np.asarray(tests.cross_correlation)[j, rows, middle + lags]
        k = int(np.lexsort((-np.abs(correlations), np.asarray(tests.cross_p)[j]))[0])
        return Correlation(tests.signals[k], float(correlations[k]), int(lags[k]))

    def nonlinear_dependence(self, output: str) -> tuple[str, float]:
        """Return the variable with the most significant map of a channel's mean, and its p-value;
        of those whose p-values are equal, as zero is, the one whose means scatter most.
        """
        j, maps = self.maps.outputs.index(output), self.maps
        p, scatter = np.asarray(maps.p_value)[j], np.nanstd(np.asarray(maps.mean)[j], axis=-1)
        k = int(np.lexsort((-scatter, p))[0])
        return maps.variables[k], float(p[k])

    def __str__(self) -> str:
        return f"{self.tests}\n\n{self.maps}"


def analyse_residual(
    residuals: Float[Array, "case time output"],
    mask: Bool[Array, "case time output"],
    signals: Mapping[str, Float[Array, "case time"]],
    outputs: tuple[str, ...],
) -> ResidualReport:
    """Run all tests of a residual.

    Args:
        residuals: `v = z - y` [output units].
        mask: valid samples.
        signals: states, inputs, and time as `t` [any]; time serves for the maps only, not for the
            correlations.
        outputs: names of the channels.

    Returns:
        The tests, pooled over the records, and the whiteness of each record.

    Raises:
        InputError: from `residual_tests` and `residual_maps`.
    """
    moving = {name: signal for name, signal in signals.items() if name != "t"}
    lags = min(WHITENESS_LAGS, max(residuals.shape[1] // 5, 1))
    by_record = _whiteness_by_record(residuals, mask, lags)
    tests = residual_tests(residuals, mask, moving, outputs, lags=lags)
    return ResidualReport(
        tests, residual_maps(residuals, mask, signals, outputs), np.asarray(by_record)
    )


@eqx.filter_jit
def _whiteness_by_record(v, mask, lags: int) -> Float[Array, "case output"]:
    """Return the p-values of the test of whiteness of each record (jitted)."""
    return jax.vmap(lambda v, mask: ljung_box(v[None], mask[None], lags).p_value)(v, mask)
