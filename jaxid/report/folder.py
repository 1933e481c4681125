"""A study on disk: a new folder with the page, the numbers and the figures; nothing is ever overwritten."""

import errno
import os
import tempfile
from collections.abc import Iterator
from itertools import chain, count
from pathlib import Path

from .._foundation.checks import InputError, require
from ..study.study import Study
from .gallery import gallery
from .html import html


def write_study(study: Study, folder: str | Path, title: str = "jaxid study", *, exist: str = "number") -> Path:
    """Write a study into a new folder: `study.html`, `study.json` and the figures as PNG files.

    All is drawn before anything is written, written beside its place and then renamed: a folder is whole or absent.

    Args:
        study: the study.
        folder: where to; its parents are made.
        title: words for the head of the page.
        exist: what to do where it exists: "number" takes `folder-2`, `folder-3`, ..., "refuse" refuses.

    Returns:
        The folder that was written.

    Raises:
        InputError: when the folder exists and `exist` is "refuse", or `exist` is neither of the two.
    """
    require(exist in ("number", "refuse"), f"exist is {exist!r}; choose 'number' or 'refuse'.")
    folder = Path(folder).absolute()
    if exist == "refuse":
        require_new(folder)
    contents = _contents(study, title)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as beside:
        whole = Path(beside) / "study"  # made by mkdir, which grants the user's usual rights
        whole.mkdir()
        for name, content in contents.items():
            (whole / name).write_bytes(content)
        return _settle(whole, folder, exist)


def write_json(study: Study, path: str | Path) -> Path:
    """Write the numbers of a study as a JSON file that does not exist yet.

    Args:
        study: the study.
        path: the file, in a folder that exists.

    Returns:
        The file that was written.

    Raises:
        InputError: when the file exists, or its folder does not.
    """
    path = Path(path).absolute()
    require_new(path)
    require(path.parent.is_dir(), f"There is no folder {str(path.parent)!r} for {path.name!r}. Make it first.")
    with tempfile.TemporaryDirectory(prefix=f".{path.name}-", dir=path.parent) as beside:
        whole = Path(beside) / "study.json"
        whole.write_text(study.to_json() + "\n", encoding="utf-8")
        try:
            os.link(whole, path)  # a link is refused where the name is taken, a rename is not
        except FileExistsError:
            require_new(path)
        except OSError:  # no hard links on this file system
            require_new(path)
            whole.rename(path)
    return path


def require_new(path: str | Path) -> None:
    """Refuse a path that is taken; to be asked before long work, too.

    Args:
        path: of a file or folder.

    Raises:
        InputError: when there is anything of that name.
    """
    if os.path.lexists(path):
        raise InputError(
            f"{str(path)!r} exists, and results are never overwritten. Give another name, or move it away."
        )


def _contents(study: Study, title: str) -> dict[str, bytes]:
    """File names and what goes into them."""
    drawn = gallery(study)
    numbered = ((f"{index:02d}-{one.name}.png", one.png) for index, one in enumerate(drawn.pictures, 1))
    return {
        "study.html": html(study, title, drawn).encode(),
        "study.json": (study.to_json() + "\n").encode(),
        **dict(numbered),
    }


def _settle(whole: Path, folder: Path, exist: str) -> Path:
    """Give a finished folder its name, the first that is free."""
    for target in _names(folder) if exist == "number" else iter((folder,)):
        if os.path.lexists(target):
            continue
        try:
            return whole.rename(target)
        except OSError as error:  # someone else was faster
            if error.errno not in (errno.EEXIST, errno.ENOTEMPTY, errno.ENOTDIR, errno.EACCES) or not target.exists():
                raise
    require_new(folder)
    raise InputError(f"{str(folder)!r} could not be written. Give another name.")


def _names(folder: Path) -> Iterator[Path]:
    return chain((folder,), (folder.with_name(f"{folder.name}-{number}") for number in count(2)))
