"""`Progress`: how far a batch is, and its bar."""

import contextlib
from collections.abc import Callable, Iterator
from typing import NamedTuple

from .._foundation.progress import shown_progress


class Progress(NamedTuple):
    """How far a batch is.

    Attributes:
        finished: number of finished cases, those of an earlier run of the same store included.
        failed: number of those that failed.
        total: number of all cases.
        seconds: time since the start of this run [s].
        remaining: expected time to the end [s], from the mean time of a case in this run; infinite
            before the first one.
    """

    finished: int
    failed: int
    total: int
    seconds: float
    remaining: float

    def __str__(self) -> str:
        return f"{self.finished} of {self.total} cases, {self.failed} failed"

    @property
    def words(self) -> str:
        """The counts, with the time that remains."""
        return f"{self}, {self.remaining:.0f} s remain"


@contextlib.contextmanager
def listener(progress: bool | Callable[[Progress], object]) -> Iterator[Callable]:
    """Return the function to call after each group of cases.

    Args:
        progress: a function of `Progress`; True for a bar on a terminal or a line in a notebook;
            False for nothing.
    """
    if callable(progress):
        yield progress
        return
    with shown_progress(progress) as show:
        yield lambda state: show(state.words, state.finished / max(state.total, 1))
