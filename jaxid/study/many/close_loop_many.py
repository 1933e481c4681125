"""`close_loop_many`: many studies, each in a process of its own pool, continued from a folder."""

import json
import multiprocessing
import os
import pickle
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from ..._foundation.checks import InputError, require, require_float64
from ..._foundation.configuration import configure, settings_in_use
from ..._foundation.progress import shown_progress
from ...batches.identity import digest_of, digest_of_code, version
from ..close_loop import close_loop
from .studies import Studies, StudyResult
from .study_folder import StudyFolder

Arguments = Mapping[str, Any]
NEEDED = ("model", "free", "likelihood", "train")
KILLED = (
    "Its process ended without a result; the system may have killed it for want of memory. Call "
    "again with fewer `processes`."
)


def close_loop_many(
    studies: Mapping[str, Arguments],
    *,
    folder: str | Path | None = None,
    processes: int | None = None,
    progress: bool | Callable[[StudyResult], object] = True,
) -> Studies:
    """Return the results of many calls of `close_loop`, such as of a fleet or a Monte Carlo.

    The studies run in processes that are started for this call (`spawn`), one study at a time in
    each. A study that fails does not affect the others. In a script, call it below
    `if __name__ == "__main__":`, and define models in a module: a process cannot import a class
    that was typed into a notebook.

    Args:
        studies: arguments of `close_loop` by the name of the study: `model`, `free`, `likelihood`,
            `train` and any others but `progress`.
        folder: folder in which the result of each study is written when it ends, as JSON. A call
            with the same studies takes the results from there, and repeats those that failed.
        processes: number of processes, by default that of the processors. Each has JAX and the
            compiled programs of a study in its memory [about 1 GB].
        progress: True shows the number of results on a terminal or in a notebook; False does not;
            or a function that receives each result as it comes.

    Returns:
        The results in the order of `studies`; printed, a table.

    Raises:
        InputError: when there is no study, an argument is missing, the folder belongs to other
            studies or cannot be written, or JAX is in 32 bit.
    """
    require_float64()
    _check(studies, processes)
    kept = _opened(folder, studies)
    results = {} if kept is None else kept.results()
    pending = {name: studies[name] for name in studies if name not in results}
    with shown_progress(progress is True) as show:
        for result in _run(pending, processes or os.cpu_count() or 1):
            results[result.name] = result
            if kept is not None:
                kept.write(result)
            show(f"{len(results)} of {len(studies)} studies", len(results) / len(studies))
            if callable(progress):
                progress(result)
    return Studies(tuple(results[name] for name in studies))


def _check(studies: Mapping[str, Arguments], processes: int | None) -> None:
    """Refuse studies without the arguments that `close_loop` needs, and no process."""
    require(processes is None or processes >= 1, f"`processes` is {processes}. Give at least 1.")
    require(len(studies) > 0, "There is no study. Give the arguments of at least one.")
    for name, arguments in studies.items():
        missing = [one for one in NEEDED if one not in arguments]
        require(not missing, f"The study {name!r} has no {', '.join(missing)}.")
        require(
            "progress" not in arguments,
            f"The study {name!r} has `progress`, which does not pass to another process. Give "
            "`progress` to `close_loop_many`.",
        )


def _opened(folder: str | Path | None, studies: Mapping[str, Arguments]) -> StudyFolder | None:
    """Return the folder of the results, if there is one."""
    if folder is None:
        return None
    return StudyFolder(folder, {name: _identity(arguments) for name, arguments in studies.items()})


def _identity(arguments: Arguments) -> dict[str, str]:
    """Return version and digests of the arguments of a study and of their code."""
    ordered = dict(sorted(arguments.items()))
    digests = {"arguments": digest_of(ordered), "code": digest_of_code(ordered)}
    return {"version": version(), **digests}


def _run(studies: Mapping[str, Arguments], processes: int) -> Iterator[StudyResult]:
    """Yield the results of studies as they come.

    If a process is killed, its pool fails with all studies that it runs, and a new pool takes the
    waiting ones.
    """
    waiting = deque(studies)
    while waiting:
        context, settings = multiprocessing.get_context("spawn"), settings_in_use()
        count = min(processes, len(waiting))
        with ProcessPoolExecutor(count, context, configure_process, (settings,)) as pool:
            yield from _run_in(pool, count, studies, waiting)


def _run_in(
    pool: ProcessPoolExecutor, count: int, studies: Mapping[str, Arguments], waiting: deque[str]
) -> Iterator[StudyResult]:
    """Yield the results of waiting studies from one pool, until none waits or the pool fails.

    A pool that accepts no study fails the first waiting one, so that each pool ends at least one.
    """
    running: dict[Future, str] = {}
    works = _fill(pool, count, studies, waiting, running)
    if not running:
        yield StudyResult(waiting.popleft(), 0.0, None, KILLED)
    while running:
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            result = _result(future, running.pop(future))
            works = works and result.failure != KILLED
            yield result
        works = works and _fill(pool, count, studies, waiting, running)


def _fill(
    pool: ProcessPoolExecutor,
    count: int,
    studies: Mapping[str, Arguments],
    waiting: deque[str],
    running: dict[Future, str],
) -> bool:
    """Move waiting studies to the running ones, and return False if the pool has failed.

    No more studies are submitted than there are processes, so that the others wait. A study that
    the failed pool refuses waits again.
    """
    while waiting and len(running) < count:
        name = waiting[0]
        try:
            running[_submitted(pool, name, studies[name])] = name
        except BrokenProcessPool:
            return False
        waiting.popleft()
    return True


def _result(future: Future, name: str) -> StudyResult:
    """Return the result of a study that has ended."""
    try:
        return future.result()
    except BrokenProcessPool:
        return StudyResult(name, 0.0, None, KILLED)


def _submitted(pool: ProcessPoolExecutor, name: str, arguments: Arguments) -> Future:
    """Return the future of a study, or of its failure if its arguments cannot be sent.

    Raises:
        BrokenProcessPool: if a process of the pool was killed.
    """
    try:
        return pool.submit(run_study, name, pickle.dumps(dict(arguments)))
    except BrokenProcessPool:
        raise
    except Exception as error:  # pickle has many
        unsent: Future = Future()
        unsent.set_result(StudyResult(name, 0.0, None, _unsent(error)))
        return unsent


def configure_process(settings: Mapping[str, Any]) -> None:
    """Give a new process the settings of the calling one."""
    configure(**settings)


def run_study(name: str, pickled: bytes) -> StudyResult:
    """Return the result of one study, or its failure in words.

    Args:
        name: name of the study.
        pickled: its arguments.
    """
    begin = time.monotonic()
    try:
        arguments = pickle.loads(pickled)
    except Exception as error:  # a module that does not exist here, a class of a notebook
        return StudyResult(name, 0.0, None, _unsent(error))
    try:
        content = json.loads(close_loop(**arguments, progress=False).to_json())
    except InputError as error:
        return StudyResult(name, time.monotonic() - begin, None, str(error))
    except Exception:
        return StudyResult(name, time.monotonic() - begin, None, traceback.format_exc())
    return StudyResult(name, time.monotonic() - begin, content)


def _unsent(error: Exception) -> str:
    return (
        f"Its arguments cannot be sent to another process ({error}). Define models and effects in "
        "a module that can be imported, not in a notebook or within a function."
    )
