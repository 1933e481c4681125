"""Progress of a command."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console

from .._foundation.progress import terminal_bar


@contextmanager
def show_progress(console: Console) -> Iterator[Callable[[str], None]]:
    """Context whose function shows a description of the present step.

    A terminal shows a moving bar with the description. Otherwise each description is a line with
    the elapsed time.

    Args:
        console: on standard error, so that standard output can be piped.
    """
    if not console.is_terminal:
        begin = time.monotonic()
        yield lambda words: console.print(
            f"{time.monotonic() - begin:6.0f} s  {words}",
            soft_wrap=True,
            highlight=False,
            markup=False,
        )
        return
    with terminal_bar(console) as show:
        yield show
