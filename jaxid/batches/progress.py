"""`Progress`: how far a batch is, and a bar on the terminal that shows it."""

import contextlib
from collections.abc import Callable, Iterator
from typing import NamedTuple


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


@contextlib.contextmanager
def listener(progress: bool | Callable[[Progress], object]) -> Iterator[Callable]:
    """Return the function to call after each group of cases.

    Args:
        progress: a function of `Progress`; True for a bar on standard error; False for nothing.
    """
    if callable(progress):
        yield progress
    elif not progress:
        yield lambda state: None
    else:
        with _bar() as show:
            yield show


@contextlib.contextmanager
def _bar() -> Iterator[Callable[[Progress], None]]:
    """Show a bar with the time that remains on standard error."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (
        *(TextColumn("cases"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()),
        TextColumn("{task.fields[failed]} failed"),
    )
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("cases", total=None, failed=0)
        yield lambda state: bar.update(
            task, completed=state.finished, total=state.total, failed=state.failed
        )
