"""Figures of single objects: the channels of a record, the residual of a fit, a prediction."""

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .._foundation.checks import require
from ..data.record import Record
from ..diagnosis.residuals import autocorrelation
from ..diagnosis.thresholds import BAND
from ..diagnosis.validation import Prediction
from ..estimation.result import Estimate
from .figures import PLOTTED_LAGS
from .style import (
    AFTER,
    MEASURED,
    NOISE,
    OTHER,
    canvas,
    channel_label,
    key,
    plain,
    require_case,
)
from .words import display_unit, unit_words


def signals(record: Record, case: int = 0) -> Figure:
    """Return a figure of the inputs and the measured outputs of a record over time.

    Args:
        record: one record or a stack.
        case: which record of a stack.

    Returns:
        One panel for each channel, in degrees where the unit is rad.

    Raises:
        InputError: when there is no such record.
    """
    require_case(case, record.n_cases)
    single = record[case] if record.is_stack else record
    entries = [("inputs", NOISE)] * bool(single.inputs) + [("measured outputs", MEASURED)]
    names = (*single.inputs, *single.outputs)
    units = (*single.input_units, *single.output_units)
    figure, panels = canvas(0.8 + 1.1 * len(names), len(names), sharex=True)
    t = np.asarray(single.t)
    for number, (name, unit, (ax,)) in enumerate(zip(names, units, panels, strict=True)):
        scale, shown = display_unit(unit)
        colour = NOISE if name in single.inputs else MEASURED
        ax.plot(t, scale * np.asarray(single.channel(name)), color=colour, linewidth=1.0)
        label = channel_label(name, unit_words(shown))
        plain(ax, "time [s]" if number == len(names) - 1 else "", label)
    _limit(panels, t)
    key(figure, entries, title=single.names[0])
    return figure


def fit_residuals(estimate: Estimate, case: int = 0) -> Figure:
    """Return a figure of the residual of a fit and of its autocorrelation.

    Args:
        estimate: of one case.
        case: which of its records is drawn over time; the autocorrelation is of all of them.

    Returns:
        Two panels for each output.

    Raises:
        InputError: for a batch of estimates, or when there is no such record.
    """
    require(
        np.ndim(estimate.values) == 1,
        "A figure is of one estimate, and this is a batch of them. Select one of them.",
    )
    require_case(case, estimate.mask.shape[0])
    mask, v = np.asarray(estimate.mask), np.asarray(estimate.residuals)
    names, units = estimate.model.outputs, estimate.model.units()
    lags = max(min(PLOTTED_LAGS, v.shape[1] // 5), 1)
    r = np.asarray(autocorrelation(jnp.asarray(v), jnp.asarray(mask), lags))
    count = np.maximum(mask.sum(axis=(0, 1)), 1)
    rms = np.sqrt(np.sum(np.where(mask, v, 0.0) ** 2, axis=(0, 1)) / count)
    figure, panels = canvas(0.8 + 1.3 * len(names), len(names), 2, width_ratios=(2, 1))
    for channel, (name, (left, right)) in enumerate(zip(names, panels, strict=True)):
        scale, unit = display_unit(units.get(name, ""))
        last, shown = channel == len(names) - 1, np.where(mask, v, np.nan)[case, :, channel]
        _band(left, 2.0 * scale * rms[channel])
        left.plot(scale * shown, color=AFTER, linewidth=0.8)
        label = channel_label(name, unit_words(unit))
        plain(left, "sample" if last else "", label, "" if channel else "residual")
        _band(right, BAND / np.sqrt(count[channel]))
        right.plot(np.arange(1, lags + 1), r[channel, 1:], color=AFTER, linewidth=1.2)
        right.set_ylim(-1.05, 1.05)
        plain(right, "lag [samples]" if last else "", "", "" if channel else "autocorrelation")
    key(figure, [("± 2 RMS; 95 % band of white noise", OTHER)])
    return figure


def predicted_outputs(prediction: Prediction, case: int = 0) -> Figure:
    """Return a figure of the measured and the predicted outputs of a record.

    Measured samples that are not scored (missing, or in the window of the initial state) are left
    out.

    Args:
        prediction: from `predict`.
        case: which record.

    Returns:
        One panel for each output, in degrees where the unit is rad.

    Raises:
        InputError: when there is no such record.
    """
    cases, _, channels = prediction.z.shape
    require_case(case, cases)
    t = np.asarray(prediction.t)[case]
    rows = 1 + int(np.sum(np.diff(t) > 0))
    z, y, scored = (
        np.asarray(part)[case, :rows] for part in (prediction.z, prediction.y, prediction.scored)
    )
    figure, panels = canvas(0.8 + 1.5 * channels, channels, sharex=True)
    named = zip(prediction.outputs, prediction.units, panels, strict=True)
    for channel, (name, unit, (ax,)) in enumerate(named):
        scale, shown = display_unit(unit)
        measured = np.where(scored, z, np.nan)[:, channel]
        ax.plot(t[:rows], scale * measured, color=MEASURED, linewidth=2.6, alpha=0.55)
        ax.plot(t[:rows], scale * y[:, channel], color=AFTER, linewidth=1.0)
        label = channel_label(name, unit_words(shown))
        plain(ax, "time [s]" if channel == channels - 1 else "", label)
    _limit(panels, t[:rows])
    key(figure, [("measured", MEASURED), ("predicted", AFTER)], title=prediction.names[case])
    return figure


def _limit(panels: list[list[Axes]], t: np.ndarray) -> None:
    """Let the time axis end with the record."""
    if t[-1] > t[0]:
        panels[-1][0].set_xlim(t[0], t[-1])


def _band(ax: Axes, half_width: float) -> None:
    ax.axhspan(-half_width, half_width, color=OTHER, alpha=0.45, linewidth=0)
