"""A study or a design on disk: a new folder with its files. Nothing is overwritten."""

import errno
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, count
from pathlib import Path
from typing import NamedTuple

from .._foundation.checks import InputError, require
from ..data.io.csv import write_csv
from ..design.design import Design
from ..study.identification import Identification
from ..study.study import Study
from .gallery import gallery
from .html import html


def write_study(
    study: Study,
    folder: str | Path,
    title: str = "jaxid study",
    *,
    exist: str = "number",
    files: Sequence[str | Path] = (),
) -> Path:
    """Write a study into a new folder: `study.html`, `study.json` and the figures as PNG files.

    Everything is drawn first, then written to a temporary folder next to the target, which is
    renamed at the end: the folder is complete or absent.

    Args:
        study: the study.
        folder: path of the new folder; its parents are created.
        title: heading of the page.
        exist: action if the folder exists: "number" takes `folder-2`, `folder-3`, ..., "refuse"
            raises.
        files: the files that were read for the study; the page states their SHA-256.

    Returns:
        The new folder.

    Raises:
        InputError: when the folder exists and `exist` is "refuse", or `exist` is neither of the
            two.
    """
    require(exist in ("number", "refuse"), f"exist is {exist!r}; choose 'number' or 'refuse'.")
    folder = Path(folder).absolute()
    if exist == "refuse":
        require_new(folder)
    contents = _contents(study, title, files)

    def write(complete: Path) -> None:
        for name, content in contents.items():
            (complete / name).write_bytes(content)

    return _write_folder(write, folder, exist)


def write_design(design: Design, folder: str | Path) -> Path:
    """Write a design into a new folder: the record to fly, `design.csv`, and its figure.

    The folder is complete or absent.

    Args:
        design: the design.
        folder: path of the new folder; its parents are created.

    Returns:
        The new folder.

    Raises:
        InputError: when the folder exists, and as `write_csv`.
    """
    folder = Path(folder).absolute()
    require_new(folder)

    def write(complete: Path) -> None:
        write_csv(design.record, complete / "design.csv")
        design.plot().savefig(complete / "design.png", dpi=150)

    return _write_folder(write, folder, "refuse")


def write_json(result: Study | Identification, path: str | Path) -> Path:
    """Write the numbers of a result to a new JSON file.

    Args:
        result: a study or an identification.
        path: path of the file, in an existing folder.

    Returns:
        The new file.

    Raises:
        InputError: when the file exists, or its folder does not exist.
    """
    path = Path(path).absolute()
    require_new(path)
    require(
        path.parent.is_dir(),
        f"There is no folder {str(path.parent)!r} for {path.name!r}. Make it first.",
    )
    with tempfile.TemporaryDirectory(prefix=f".{path.name}-", dir=path.parent) as temporary:
        complete = Path(temporary) / "study.json"
        complete.write_text(result.to_json() + "\n", encoding="utf-8")
        try:
            os.link(complete, path)  # a link fails if the name exists, a rename does not
        except FileExistsError:
            require_new(path)
        except OSError:  # no hard links on this file system
            require_new(path)
            complete.rename(path)
    return path


def require_new(path: str | Path) -> None:
    """Check that a path does not exist; also called before long computations.

    Args:
        path: path of a file or folder.

    Raises:
        InputError: when the path exists.
    """
    if os.path.lexists(path):
        raise InputError(
            f"{str(path)!r} exists, and results are never overwritten. Give another name, or move "
            "it away."
        )


def require_writable(path: str | Path) -> None:
    """Check that a file or folder can be created; also called before long computations.

    A temporary file is created and removed in the nearest folder that exists.

    Args:
        path: path of a new file or folder.

    Raises:
        InputError: when a part of the path is a file, or the folder cannot be written.
    """
    path = Path(path).absolute()
    nearest = next(parent for parent in path.parents if os.path.lexists(parent))
    require(
        nearest.is_dir(),
        f"{str(path)!r} cannot be created: {str(nearest)!r} is not a folder. Give another name.",
    )
    try:
        with tempfile.TemporaryFile(dir=nearest):
            pass
    except OSError as error:
        raise InputError(
            f"{str(path)!r} cannot be created: the folder {str(nearest)!r} cannot be written "
            f"({error.strerror}). Give another name, or change the rights of the folder."
        ) from error


class Written(NamedTuple):
    """Place of a written file or folder.

    Attributes:
        path: the file or folder.
        error: reason why the requested path was not written; None if it was.
    """

    path: Path
    error: OSError | InputError | None


def write_or_elsewhere(write: Callable[[Path], Path], path: str | Path) -> Written:
    """Write to a path, or to a new folder where this fails.

    The other places are the system's folder for temporary files and the user's home folder, in this
    order.

    Args:
        write: function that writes to a path, and returns the path written.
        path: the requested path.

    Returns:
        The path written, and the error at the requested one.

    Raises:
        OSError: when no place can be written; the error is that of the requested path.
    """
    path = Path(path)
    try:
        return Written(write(path), None)
    except (OSError, InputError) as error:
        for place in (tempfile.gettempdir(), Path.home()):
            try:
                folder = Path(tempfile.mkdtemp(prefix="jaxid-", dir=place))
                return Written(write(folder / path.name), error)
            except OSError:
                continue
        raise


def _contents(study: Study, title: str, files: Sequence[str | Path]) -> dict[str, bytes]:
    """Return the contents of the files by name."""
    drawn = gallery(study)
    numbered = (
        (f"{index:02d}-{picture.name}.png", picture.png)
        for index, picture in enumerate(drawn.pictures, 1)
    )
    return {
        "study.html": html(study, title, drawn, files).encode(),
        "study.json": (study.to_json() + "\n").encode(),
        **dict(numbered),
    }


def _write_folder(write: Callable[[Path], None], folder: Path, exist: str) -> Path:
    """Write files into a temporary folder next to the target, and rename it when it is complete."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as temporary:
        complete = Path(temporary) / "complete"  # mkdir gives the user's usual rights
        complete.mkdir()
        write(complete)
        return _rename_to_free_name(complete, folder, exist)


def _rename_to_free_name(complete: Path, folder: Path, exist: str) -> Path:
    """Rename a complete folder to the first free name, and return its path."""
    for target in _names(folder) if exist == "number" else iter((folder,)):
        if os.path.lexists(target):
            continue
        try:
            return complete.rename(target)
        except OSError as error:  # another process has just taken the name
            if (
                error.errno not in (errno.EEXIST, errno.ENOTEMPTY, errno.ENOTDIR, errno.EACCES)
                or not target.exists()
            ):
                raise
    require_new(folder)
    raise InputError(f"{str(folder)!r} could not be written. Give another name.")


def _names(folder: Path) -> Iterator[Path]:
    return chain((folder,), (folder.with_name(f"{folder.name}-{number}") for number in count(2)))
