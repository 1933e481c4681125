"""The figures of a study with their captions, and their conversion to bytes."""

import io
import re
from typing import NamedTuple

from matplotlib.figure import Figure

from ..data.record import Record
from ..diagnosis.validation import Prediction
from ..loop.outcome import Outcome
from ..study.study import Round, Study
from .figures import errors, prediction, ranking, residuals
from .figures_records import PANEL_SAMPLES, RECORDS_IN_FIGURE, small_panels
from .figures_where import where
from .inline_svg import inline_svg

# Chosen: largest number of records of a set to draw, in large figures and in small panels.
MOST_LARGE, MOST_RECORDS = 3, 12
PNG_DPI = 150  # chosen


class Picture(NamedTuple):
    """A figure, a file name without its ending, and a caption."""

    name: str
    figure: Figure
    caption: str

    @property
    def svg(self) -> str:
        """The figure as an SVG element of a page."""
        return inline_svg(self.figure, self.name, self.caption)

    @property
    def png(self) -> bytes:
        """The figure as a PNG file."""
        buffer = io.BytesIO()
        self.figure.savefig(buffer, format="png", metadata={"Software": None}, dpi=PNG_DPI)
        return buffer.getvalue()


class Gallery(NamedTuple):
    """All figures of a study.

    Attributes:
        errors: errors before and after.
        where: location of the declared model's residual, None if nothing is missing.
        tests: predictions, records and residuals by test set.
        records: the training and the check records in small panels, by role.
        rounds: the ranking of each round, None if it had no candidate.
    """

    errors: Picture
    where: Picture | None
    tests: dict[str, tuple[Picture, ...]]
    records: dict[str, tuple[Picture, ...]]
    rounds: tuple[Picture | None, ...]

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All figures, in the order of the page."""
        pictures = [self.errors]
        if self.where is not None:
            pictures.append(self.where)
        for drawn in (*self.tests.values(), *self.records.values()):
            pictures.extend(drawn)
        pictures.extend(ranked for ranked in self.rounds if ranked is not None)
        return tuple(pictures)


def gallery(study: Study) -> Gallery:
    """Return all figures of a study, with names and captions.

    Args:
        study: the study.

    Returns:
        The figures with names and captions.
    """
    caption = (
        "Error before and after, by channel. The dashed line is the standard deviation of the "
        "measurement noise."
    )
    first = Picture("errors", errors(study), caption)
    tests = {test: _test(study, test, index) for index, test in enumerate(study.tests, 1)}
    records = {"training": study.train, "check": study.check}
    return Gallery(
        first,
        _where(study),
        tests,
        {role: _records(each, role) for role, each in records.items()},
        tuple(_round(each, index) for index, each in enumerate(study.rounds, 1)),
    )


def _where(study: Study) -> Picture | None:
    caption = (
        "Left: share of the declared model's residual (training records) that a free-form "
        "disturbance in a single place explains, beyond the effect of the free parameters. "
        "Right: the disturbance in the first of these places, with two standard deviations, in "
        "time and against the variable that it follows best; above it, the share of the "
        "disturbance that a cubic of this variable explains."
    )
    return (
        None
        if study.outcome is Outcome.NOTHING_MISSING
        else Picture("where", where(study.localisation["before"], study.options.level), caption)
    )


def _test(study: Study, test: str, index: int) -> tuple[Picture, ...]:
    """Return the predictions of the first records of a test set, all its records in small panels,
    and the residuals of the first.
    """
    records, slug = study.tests[test], f"{index}-{_slug(test)}"
    count = min(records.n_cases, MOST_LARGE)
    caption = (
        "Measured outputs (grey) and the predictions of the models, from the recorded input alone."
    )
    drawn = [
        Picture(f"prediction-{slug}-{case + 1}", prediction(study, test, case), caption)
        for case in range(count)
    ]
    drawn += _records(records, slug, study.after.tests[test])
    caption = (
        "Measured less predicted, in time (each panel in its own scale; the grey band is the same "
        "noise in both), and its autocorrelation over all records of the set. The autocorrelation "
        "of white noise is in the band at 19 of 20 lags."
    )
    return (*drawn, Picture(f"residuals-{slug}", residuals(study, test), caption))


def _records(
    records: Record, slug: str, predicted: Prediction | None = None
) -> tuple[Picture, ...]:
    """Return the records of a set in small panels, `RECORDS_IN_FIGURE` to a figure."""
    count = min(records.n_cases, MOST_RECORDS)
    pictures = []
    for start in range(0, count, RECORDS_IN_FIGURE):
        cases = range(start, min(start + RECORDS_IN_FIGURE, count))
        caption = "Inputs and outputs of the set, one record in each column, in a common scale."
        if records.t.shape[-1] > PANEL_SAMPLES:
            caption += f" Records of more than {PANEL_SAMPLES} samples are thinned."
        if records.n_cases > count and cases.stop == count:
            caption += (
                f" The set has {records.n_cases} records; the first {count} are drawn, and the "
                f"other {records.n_cases - count} are not."
            )
        figure = small_panels(records, cases, predicted)
        pictures.append(
            Picture(f"records-{slug}-{start // RECORDS_IN_FIGURE + 1}", figure, caption)
        )
    return tuple(pictures)


def _round(search_round: Round, index: int) -> Picture | None:
    caption = (
        "Fall of chi-square that each candidate should bring beyond the free parameters, before it "
        "is fitted (bar), and the fall that its refit brought (dot). The refit decides."
    )
    return (
        Picture(f"ranking-round-{index}", ranking(search_round), caption)
        if search_round.candidates
        else None
    )


def _slug(name: str) -> str:
    """Return a name as part of a file name."""
    return re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-")[:40] or "set"
