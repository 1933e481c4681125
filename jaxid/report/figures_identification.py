"""Figures of an identification: responses, coefficients and derivatives with bands of two
deviations.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from .._foundation.checks import require, require_known
from ..data.record import Record
from ..diagnosis.bands import Band
from ..diagnosis.combined_bands import CombinedBand
from ..models.pseudo_measurements import PseudoMeasurements
from .style import AFTER, BEFORE, MEASURED, canvas, channel_label, key, plain, require_case
from .words import display_unit, unit_words

OPACITY = 0.25  # of a band (chosen)


class History(NamedTuple):
    """An estimated history with its band; each array has the shape (time,).

    Attributes:
        label: label of the axis.
        value, deviation: estimate and standard deviation.
        measured: measured values, if any.
        truth: true values, if they are known.
    """

    label: str
    value: np.ndarray
    deviation: np.ndarray
    measured: np.ndarray | None = None
    truth: np.ndarray | None = None


def responses(records: Record, bands: Mapping[str, Band], case: int = 0) -> Figure:
    """Return a figure of the measured and the fitted outputs of a record (Figs. 6.3, 6.6).

    Args:
        records: the fitted records, a stack.
        bands: by output, `Bands.measured` of `prediction_bands`.
        case: which record.

    Raises:
        InputError: when there is no such record.
    """
    require_case(case, records.n_cases)
    rows, histories = int(records.samples[case]), []
    for k, (name, unit) in enumerate(zip(records.outputs, records.output_units, strict=True)):
        scale, shown = display_unit(unit)
        value, deviation = scale * _of(bands[name], case)[:, :rows]
        z = np.where(records.mask[case, :rows, k], records.z[case, :rows, k], np.nan)
        label = channel_label(name, unit_words(shown))
        histories.append(History(label, value, deviation, scale * z))
    t = np.asarray(records.t)[case, :rows]
    return _figure(t, histories, "fitted", records.names[case])


def coefficients(
    records: Sequence[Record],
    measured: Sequence[PseudoMeasurements],
    bands: Mapping[str, CombinedBand],
    truth: Mapping[str, np.ndarray] | None,
    case: int = 0,
) -> Figure:
    """Return a figure of the responses along a record, measured and estimated (Figs. 6.4, 6.7).

    Args:
        records: single records of an identification.
        measured: their pseudo-measurements.
        bands: of the responses, from `combined_bands`.
        truth: true histories by response, if they are known.
        case: which record.

    Raises:
        InputError: when there is no such record, or the truth has another response or length.
    """
    require_case(case, len(records))
    valid, histories = np.asarray(measured[case].valid), []
    for name, band in bands.items():
        value, deviation = _of(band, case)[:, : valid.size]
        points = np.where(valid, np.asarray(measured[case].responses[name]), np.nan)
        histories.append(History(name, value, deviation, points))
    t = np.asarray(records[case].t)
    return _figure(t, _with_truth(histories, truth), "estimated", records[case].names[0])


def derivatives(
    records: Sequence[Record],
    bands: Mapping[str, Band],
    truth: Mapping[str, np.ndarray] | None,
    case: int = 0,
) -> Figure:
    """Return a figure of derivatives of responses along a record (Figs. 6.5, 6.8).

    Args:
        records: single records of an identification.
        bands: by name, from `derivative_bands`.
        truth: true histories by the same names, if they are known.
        case: which record.

    Raises:
        InputError: when there is no such record, or the truth has another name or length.
    """
    require_case(case, len(records))
    t = np.asarray(records[case].t)
    histories = [History(name, *_of(band, case)[:, : t.size]) for name, band in bands.items()]
    return _figure(t, _with_truth(histories, truth), "estimated", records[case].names[0])


def _of(band: Band | CombinedBand, case: int) -> np.ndarray:
    """Return value and deviation of one record, shape (2, time)."""
    return np.stack([np.asarray(band.value)[case], np.asarray(band.deviation)[case]])


def _with_truth(histories: list[History], truth: Mapping[str, np.ndarray] | None) -> list[History]:
    truth = truth or {}
    require_known("history (in `truth`)", truth, [one.label for one in histories])
    for one in histories:
        size = np.shape(truth.get(one.label, one.value))
        require(
            size == one.value.shape,
            f"The true history of {one.label!r} has shape {size}, and the record has "
            f"{one.value.size} samples.",
        )
    return [
        one._replace(truth=np.asarray(truth[one.label])) if one.label in truth else one
        for one in histories
    ]


def _figure(t: np.ndarray, histories: list[History], fitted: str, title: str) -> Figure:
    """Return a figure with one panel for each history."""
    figure, panels = canvas(0.8 + 1.5 * len(histories), len(histories), sharex=True)
    for number, (one, (ax,)) in enumerate(zip(histories, panels, strict=True)):
        if one.measured is not None:
            ax.plot(t, one.measured, ".", color=MEASURED, markersize=4)
        low, high = one.value - 2.0 * one.deviation, one.value + 2.0 * one.deviation
        ax.fill_between(t, low, high, color=AFTER, alpha=OPACITY, linewidth=0)
        ax.plot(t, one.value, color=AFTER, linewidth=1.2)
        if one.truth is not None:
            ax.plot(t, one.truth, color=BEFORE, linewidth=1.0)
        plain(ax, "time [s]" if number == len(histories) - 1 else "", one.label)
    panels[-1][0].set_xlim(t[0], t[-1])
    entries = [("measured", MEASURED)] * any(one.measured is not None for one in histories)
    entries += [(f"{fitted}, ± 2 standard deviations", AFTER)]
    entries += [("true", BEFORE)] * any(one.truth is not None for one in histories)
    key(figure, entries, title=title)
    return figure
