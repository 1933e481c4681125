"""Tables of the errors of a study on its test records, as rows of words, for the page."""

from typing import NamedTuple

import numpy as np

from ..diagnosis.validation import Prediction
from ..study.study import Study
from .words import ABSENT, display_unit, number, unit_words


class ErrorRow(NamedTuple):
    """Error of one channel on one test set: before, after, noise, ratio after/noise, change, and
    the fit after in percent.
    """

    channel: str
    unit: str
    before: str
    after: str
    noise: str
    ratio: str
    change: str
    fit: str


class RecordErrorRow(NamedTuple):
    """Error of one channel on one test record: before and after."""

    record: str
    channel: str
    unit: str
    before: str
    after: str


def error_rows(study: Study, test: str) -> tuple[ErrorRow, ...]:
    """Return the errors before and after by channel, in display units.

    Args:
        study: the study.
        test: name of the test set.

    Returns:
        One row for each channel.
    """
    rows, fits = [], np.asarray(study.after.tests[test].statistics.fit)
    for name, unit, fit in zip(study.outputs, study.output_units, fits, strict=True):
        scale, shown = display_unit(unit)
        before, after, noise = (
            scale * x[name] for x in (study.before.rms[test], study.after.rms[test], study.noise)
        )
        ratio = number(after / noise, 3) if noise > 0 else ABSENT
        change = after / before - 1.0 if before > 0 and np.isfinite(before) else float("nan")
        words = ABSENT if not np.isfinite(change) or not study.effects else f"{100 * change:+.0f} %"
        rows.append(
            ErrorRow(
                name,
                unit_words(shown),
                number(before),
                number(after),
                number(noise),
                ratio,
                words,
                f"{fit:.1f} %" if np.isfinite(fit) else ABSENT,
            )
        )
    return tuple(rows)


def record_error_rows(study: Study, test: str) -> tuple[RecordErrorRow, ...]:
    """Return the errors before and after by record and channel, none of a set with one record.

    Args:
        study: the study.
        test: name of the test set.
    """
    names = study.tests[test].names
    sides = [_record_rms(side.tests[test]) for side in (study.before, study.after)]
    rows = []
    for case, name in enumerate(names if len(names) > 1 else ()):
        for j, (channel, unit) in enumerate(zip(study.outputs, study.output_units, strict=True)):
            scale, shown = display_unit(unit)
            before, after = (number(scale * float(rms[case, j])) for rms in sides)
            title = name or f"record {case + 1}"
            rows.append(RecordErrorRow(title, channel, unit_words(shown), before, after))
    return tuple(rows)


def _record_rms(prediction: Prediction) -> np.ndarray:
    """Return the RMS error by record and channel, NaN without a scored sample."""
    v, scored = np.asarray(prediction.residuals), np.asarray(prediction.scored)
    count = scored.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.sqrt(np.sum(v**2, axis=1) / count)
