"""Which figures a study gets, with their captions, and how they become bytes."""

import base64
import io
import re
from typing import NamedTuple

from matplotlib.figure import Figure

from ..study.study import Study
from .figures import errors, prediction, ranking, residuals
from .figures_where import where

MOST_RECORDS = 3  # of one test set are drawn
PNG_DPI = 150


class Picture(NamedTuple):
    """A figure, a file name without its ending, and a caption."""

    name: str
    figure: Figure
    caption: str

    @property
    def source(self) -> str:
        """The figure as a data address, which a page holds in itself."""
        return "data:image/svg+xml;base64," + base64.b64encode(_saved(self.figure, "svg")).decode()

    @property
    def png(self) -> bytes:
        """The figure as a PNG file."""
        return _saved(self.figure, "png", dpi=PNG_DPI)


class Gallery(NamedTuple):
    """All figures of a study.

    Attributes:
        errors: errors before and after.
        where: where the declared model's residual sits, None where nothing is missing.
        tests: predictions and residuals by test set.
        rounds: the ranking of each round, None where there was no candidate.
    """

    errors: Picture
    where: Picture | None
    tests: dict[str, tuple[Picture, ...]]
    rounds: tuple[Picture | None, ...]

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All of them, in the order of the page."""
        rounds = (one for one in self.rounds if one is not None)
        found = () if self.where is None else (self.where,)
        return (self.errors, *found, *(one for some in self.tests.values() for one in some), *rounds)


def gallery(study: Study) -> Gallery:
    """Draw all figures of a study.

    Args:
        study: the study.

    Returns:
        The figures with names and captions.
    """
    caption = "Error before and after, by channel. The dashed line is the standard deviation of the measurement noise."
    first = Picture("errors", errors(study), caption)
    tests = {test: _test(study, test, index) for index, test in enumerate(study.tests, 1)}
    return Gallery(first, _where(study), tests, tuple(_round(one, index) for index, one in enumerate(study.rounds, 1)))


def _where(study: Study) -> Picture | None:
    caption = (
        "Left: the share of the declared model's residual (training records) that a free-form disturbance in one place alone "
        "explains, beyond what the free parameters can do. Right: the disturbance itself in the first of these places, "
        "with two standard deviations, in time and against the variable that it follows best."
    )
    return None if study.outcome == "nothing missing" else Picture("where", where(study.where["before"]), caption)


def _test(study: Study, test: str, index: int) -> tuple[Picture, ...]:
    """Predictions of the first few records of a test set, and the residuals of the first."""
    records, slug = study.tests[test], f"{index}-{_slug(test)}"
    count = min(records.n_cases, MOST_RECORDS)
    rest = f" The set has {records.n_cases} records; {count} are drawn." if records.n_cases > count else ""
    caption = "Measured outputs (grey) and what the models predict of them, from the recorded input alone."
    drawn = [
        Picture(
            f"prediction-{slug}-{case + 1}",
            prediction(study, test, case),
            caption + (rest if case == count - 1 else ""),
        )
        for case in range(count)
    ]
    caption = (
        "Measured less predicted, in time (each panel in its own scale; the grey band is the same noise in both), and "
        "its autocorrelation over all records of the set: that of noise stays in the band, all but one time in twenty."
    )
    return (*drawn, Picture(f"residuals-{slug}", residuals(study, test), caption))


def _round(one, index: int) -> Picture | None:
    caption = (
        "How much of the residual each candidate could explain beyond what the free parameters already do, before any "
        "of them is fitted. The refit decides, not this score."
    )
    return Picture(f"ranking-round-{index}", ranking(one), caption) if one.candidates else None


def _slug(name: str) -> str:
    """A name as part of a file name."""
    return re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-")[:40] or "set"


def _saved(figure: Figure, kind: str, **options) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, metadata={"Date": None} if kind == "svg" else {"Software": None}, **options)
    figure.set_layout_engine("none")  # the panels have found their places; a second format need not seek them again
    return buffer.getvalue()
