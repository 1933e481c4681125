"""Locks on the files of a store, so that no two processes write the same cases.

The operating system releases the locks of a process that ends, however it ends.
"""

import contextlib
import errno
from collections.abc import Iterator, Sequence
from pathlib import Path

from .._foundation.checks import InputError

# One byte of it for each file of a variable; in a folder that zarr does not list.
LOCK_FILE = "status/.locks"
HELD = (errno.EACCES, errno.EAGAIN)
NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)


@contextlib.contextmanager
def locked(folder: Path, files: Sequence[int]) -> Iterator[bool]:
    """Hold the locks of some files; the value is False where the system has no locks.

    Args:
        folder: folder of the store.
        files: numbers of the files.

    Raises:
        InputError: when another process holds one of them.
        OSError: when the folder cannot be written to.
    """
    with (folder / LOCK_FILE).open("ab") as handle:
        yield all([_lock(folder, handle, int(number)) for number in files])


def _lock(folder: Path, handle, number: int) -> bool:
    """Lock one byte, which is released when the file is closed."""
    try:
        import fcntl
    except ImportError:  # Windows
        return False
    try:
        fcntl.lockf(handle, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, number)
    except OSError as error:
        if error.errno in NO_LOCKS:
            return False
        if error.errno in HELD:
            raise InputError(
                f"Another process writes to the store {str(folder)!r} (its file {number}). Wait "
                "for it or stop it; several processes need a `part` each, all with one count."
            ) from error
        raise
    return True
