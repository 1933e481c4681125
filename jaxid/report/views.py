"""Selection of the samples of one test record for a figure, in display units."""

from typing import NamedTuple

import numpy as np

from .._foundation.checks import require, require_known
from ..study.study import Study
from .words import display_unit, unit_words

LIMIT = 1500  # samples that a line across a page can resolve (chosen)
# Largest error of straight lines through a thinned record, as a share of the standard deviation
# of each channel (chosen).
SMOOTH = 0.02


class View(NamedTuple):
    """The drawn samples of one test record.

    Arrays are (time, output) in display units, NaN where there is no value.

    Attributes:
        t: times [s].
        z, before, after: measurement, and predictions of the declared model and of the model with
            effects.
        residual_before, residual_after: measured less predicted, at the scored samples.
        sigma: standard deviation of the noise by channel.
        channels, units: names and display units.
        name: name of the record.
        note: selection of the samples in words, empty if all are drawn.
        scored_from: first scored time if a window at the start is not scored, otherwise None [s].
        same: True if no effect was added, so that both models are the same.
    """

    t: np.ndarray
    z: np.ndarray
    before: np.ndarray
    after: np.ndarray
    residual_before: np.ndarray
    residual_after: np.ndarray
    sigma: np.ndarray
    channels: tuple[str, ...]
    units: tuple[str, ...]
    name: str
    note: str
    scored_from: float | None
    same: bool

    @property
    def time_label(self) -> str:
        """Label of the time axis."""
        return f"time [s]: {self.note}" if self.note else "time [s]"


def view(study: Study, test: str, case: int = 0) -> View:
    """Return the samples of one test record for drawing.

    A record of more than `LIMIT` samples is thinned if its signals are slow, otherwise cut to a
    stretch of typical error.

    Args:
        study: the study.
        test: name of the test set.
        case: index of the record in the set.

    Returns:
        Samples in display units.

    Raises:
        InputError: when there is no such test set or record.
    """
    require_known("test set", [test], study.tests)
    records = study.tests[test]
    require(
        0 <= case < records.n_cases,
        f"Test set {test!r} has {records.n_cases} records; there is no number {case}.",
    )
    rows = int(np.atleast_1d(np.asarray(records.samples))[case])
    before, after = study.before.tests[test], study.after.tests[test]
    t, z, mask = (np.asarray(array)[case, :rows] for array in (after.t, after.z, records.mask))
    scored = np.asarray(after.scored)[case, :rows]
    old, new = (np.asarray(side.y)[case, :rows] for side in (before, after))
    shown, note = _shown(t, new, np.where(scored, z - old, np.nan))
    scales, units = zip(*(display_unit(unit) for unit in study.output_units), strict=True)
    signals = (
        np.where(mask, z, np.nan),
        old,
        new,
        np.where(scored, z - old, np.nan),
        np.where(scored, z - new, np.nan),
    )
    return View(
        t[shown],
        *(
            np.where(np.isfinite(signal), signal, np.nan)[shown] * np.array(scales)
            for signal in signals
        ),
        sigma=np.array([study.noise[name] for name in study.outputs]) * np.array(scales),
        channels=study.outputs,
        units=tuple(unit_words(unit) for unit in units),
        name=records.names[case],
        note=note,
        scored_from=_scored_from(t, mask, scored),
        same=not study.effects,
    )


def _shown(t: np.ndarray, y: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, str]:
    """Return the rows to draw, and their description."""
    rows = t.size
    if rows <= LIMIT:
        return np.arange(rows), ""
    step = -(-rows // LIMIT)
    thin = np.arange(0, rows, step)
    if np.all(np.isfinite(y)) and _is_smooth(t, y, thin):
        return thin, f"one sample in {step} of {rows} is drawn"
    start = _typical_start(error)
    return np.arange(start, start + LIMIT), f"a typical stretch, {LIMIT} of {rows} samples"


def _is_smooth(t: np.ndarray, y: np.ndarray, thin: np.ndarray) -> bool:
    """Return True if straight lines between the thinned samples are close to all samples."""
    t, y = t[: thin[-1] + 1], y[: thin[-1] + 1]
    return all(
        np.std(np.interp(t, t[thin], channel[thin]) - channel) <= SMOOTH * np.std(channel)
        for channel in y.T
    )


def _typical_start(error: np.ndarray) -> int:
    """Return the start of the stretch whose mean square error is nearest to that of the record.

    All channels have the same weight.
    """
    square = np.where(np.isfinite(error), error, 0.0) ** 2
    mean = np.mean(square, axis=0)
    square = np.mean(square / np.where(mean > 0, mean, 1.0), axis=1)
    starts = np.arange(0, square.size - LIMIT + 1, LIMIT // 2)
    sums = np.concatenate([[0.0], np.cumsum(square)])
    stretch = (sums[starts + LIMIT] - sums[starts]) / LIMIT
    return int(starts[np.argmin(np.abs(np.log(np.maximum(stretch, 1e-12))))])


def _scored_from(t: np.ndarray, mask: np.ndarray, scored: np.ndarray) -> float | None:
    """Return the end of the window at the start that is not scored, or None."""
    left_out, counted = np.any(mask & ~scored, axis=1), np.any(scored, axis=1)
    return float(t[np.argmax(counted)]) if left_out[0] and np.any(counted) else None
