"""The figures of a study with their captions, and their conversion to bytes."""

import base64
import io
import re
from typing import NamedTuple

from matplotlib.figure import Figure

from ..loop.outcome import Outcome
from ..study.study import Round, Study
from .figures import errors, prediction, ranking, residuals
from .figures_signals import inputs
from .figures_where import where

MOST_RECORDS = 3  # largest number of records of a test set to draw (chosen)
PNG_DPI = 150  # chosen


class Picture(NamedTuple):
    """A figure, a file name without its ending, and a caption."""

    name: str
    figure: Figure
    caption: str

    @property
    def source(self) -> str:
        """The figure as a data address, to be embedded in a page."""
        return "data:image/svg+xml;base64," + base64.b64encode(_saved(self.figure, "svg")).decode()

    @property
    def png(self) -> bytes:
        """The figure as a PNG file."""
        return _saved(self.figure, "png", dpi=PNG_DPI)


class Gallery(NamedTuple):
    """All figures of a study.

    Attributes:
        errors: errors before and after.
        where: location of the declared model's residual, None if nothing is missing.
        tests: predictions and residuals by test set.
        rounds: the ranking of each round, None if it had no candidate.
    """

    errors: Picture
    where: Picture | None
    tests: dict[str, tuple[Picture, ...]]
    rounds: tuple[Picture | None, ...]

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All figures, in the order of the page."""
        pictures = [self.errors]
        if self.where is not None:
            pictures.append(self.where)
        for test in self.tests.values():
            pictures.extend(test)
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
    return Gallery(
        first,
        _where(study),
        tests,
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
        else Picture("where", where(study.localisation["before"]), caption)
    )


def _test(study: Study, test: str, index: int) -> tuple[Picture, ...]:
    """Return the predictions of the first records of a test set, and the residuals of the first."""
    records, slug = study.tests[test], f"{index}-{_slug(test)}"
    count = min(records.n_cases, MOST_RECORDS)
    number_drawn = (
        f" The set has {records.n_cases} records; {count} are drawn."
        if records.n_cases > count
        else ""
    )
    caption = (
        "Measured outputs (grey) and the predictions of the models, from the recorded input alone."
    )
    drawn = [
        Picture(
            f"prediction-{slug}-{case + 1}",
            prediction(study, test, case),
            caption + (number_drawn if case == count - 1 else ""),
        )
        for case in range(count)
    ]
    drawn += _inputs(study, test, slug)
    caption = (
        "Measured less predicted, in time (each panel in its own scale; the grey band is the same "
        "noise in both), and its autocorrelation over all records of the set. The autocorrelation "
        "of white noise is in the band at 19 of 20 lags."
    )
    return (*drawn, Picture(f"residuals-{slug}", residuals(study, test), caption))


def _inputs(study: Study, test: str, slug: str) -> list[Picture]:
    """Return the recorded inputs of the first record of a test set, if it has any."""
    records = study.tests[test]
    caption = "Recorded inputs of the first of these records."
    if not records.inputs:
        return []
    return [Picture(f"inputs-{slug}", inputs(records[0] if records.is_stack else records), caption)]


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


def _saved(figure: Figure, kind: str, **options) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(
        buffer,
        format=kind,
        metadata={"Date": None} if kind == "svg" else {"Software": None},
        **options,
    )
    return buffer.getvalue()
