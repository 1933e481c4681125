"""`shown_progress`: the progress of a computation, a bar on a terminal or a line in a notebook."""

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar, copy_context
from typing import Any, Protocol

REFRESH = 1.0  # seconds between two updates of the elapsed time in a notebook (chosen)


class ShowProgress(Protocol):
    """Shows a text, and a bar of the share that is done if it is known."""

    def __call__(self, words: str, share: float | None = None, /) -> None: ...


@contextlib.contextmanager
def text_progress(
    progress: bool | Callable[[str], None],
) -> Iterator[Callable[[str], None]]:
    """Return the function that receives a short text at every step of a computation.

    Until the end of the context, `report_part` adds the part of the step that is done.

    Args:
        progress: a function of the text; True shows it (`shown_progress`), False does not.
    """
    with contextlib.ExitStack() as stack:
        show = progress if callable(progress) else stack.enter_context(shown_progress(progress))
        step = ""

        def begin(words: str) -> None:
            nonlocal step
            step = words
            show(words)

        token = _PART.set(lambda words: show(f"{step}: {words}" if step else words))
        stack.callback(_PART.reset, token)
        yield begin


# Shows the part of a step that is done, in the context of `text_progress`.
_PART: ContextVar[Callable[[str], None]] = ContextVar("part", default=lambda _: None)


def report_part(words: str) -> None:
    """Show the part of the present step that is done, if a progress is shown."""
    _PART.get()(words)


@contextlib.contextmanager
def shown_progress(wanted: bool = True) -> Iterator[ShowProgress]:
    """Show texts on a terminal (standard error) or in a notebook until the computation ends.

    Args:
        wanted: False shows nothing. Nothing is shown either where there is no terminal and no
            notebook.
    """
    from rich.console import Console

    console = Console(stderr=True)
    if wanted and console.is_jupyter:
        with _notebook_line() as show:
            yield show
    elif wanted and console.is_terminal:
        with terminal_bar(console) as show:
            yield show
    else:
        yield lambda words, share=None: None


@contextlib.contextmanager
def terminal_bar(console: Any) -> Iterator[ShowProgress]:
    """Show a bar with the elapsed time and the latest text, removed at the end.

    Args:
        console: a `rich.console.Console`.
    """
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    text = TextColumn("{task.description}", markup=False)
    columns = (BarColumn(bar_width=24), TimeElapsedColumn(), text)
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=None)

        def show(words: str, share: float | None = None) -> None:
            bar.update(task, description=words)
            if share is not None:
                bar.update(task, total=1.0, completed=share)

        yield show


@contextlib.contextmanager
def _notebook_line() -> Iterator[ShowProgress]:
    """Show the elapsed time and the latest text in one output, emptied at the end."""
    from IPython.display import DisplayHandle

    begin, handle, ended, text = time.monotonic(), DisplayHandle(), threading.Event(), ""
    handle.display({"text/plain": ""}, raw=True)

    def update() -> None:
        line = f"{time.monotonic() - begin:6.0f} s  {text}"
        handle.update({"text/plain": line}, raw=True)

    def show(words: str, share: float | None = None) -> None:
        nonlocal text
        text = ("" if share is None else f"{100 * share:3.0f} %  ") + words
        update()

    def refresh() -> None:
        while not ended.wait(REFRESH):
            update()

    # The cell to which an output belongs is part of the context.
    clock = threading.Thread(target=copy_context().run, args=(refresh,), daemon=True)
    clock.start()
    try:
        yield show
    finally:
        ended.set()
        clock.join()
        handle.update({"text/plain": ""}, raw=True)
