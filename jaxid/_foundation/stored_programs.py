"""Programs on disk, which another process neither traces nor lowers again.

JAX's persistent cache spares a process the compilation of a program, but not its trace, which for
an aircraft with its candidates takes longer than all the rest of a fit. A program is therefore also
stored as JAX exports it (StableHLO), under a key of everything that its trace depends on: the
shapes of its arrays, all other values, the source of this package, versions and settings. A trace
runs the code of the classes of its arguments, so that a program is stored only if all of them are
classes of this package or of those whose versions are in the key. Code of these packages that is
replaced while a process runs is not in the key: such a process sets `configure(cache=False)`.
"""

import dataclasses
import enum
import functools
import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

PACKAGE = __name__.partition(".")[0]
# Packages whose code a trace may run; their versions are in the key.
VERSIONED = ("jax", "jaxlib", "equinox", "diffrax", "interpax", "lineax", "optimistix", "numpy")
# Folder of stored programs within that of JAX's persistent cache.
SUBFOLDER = "jaxid-exported"
SCALARS = (bool, int, float, complex, str, bytes)
DIGEST_BYTES = hashlib.sha256().digest_size


class _NotDescribedError(Exception):
    """A value whose effect on a trace is unknown."""


@dataclasses.dataclass
class _Store:
    """Where programs are stored, nowhere until `store_programs` is called; settings of JAX."""

    folder: Path | None = None
    settings: Callable[[], str] = str


_STORE = _Store()


def store_programs(folder: Path | None, settings: Callable[[], str] = str) -> None:
    """Store exported programs in a folder of their own within that of JAX's cache, or nowhere.

    Args:
        folder: folder of JAX's cache; None to store nothing.
        settings: function that returns all settings of JAX on which a trace may depend.
    """
    _STORE.folder = None if folder is None else folder / SUBFOLDER
    _STORE.settings = settings


def exported(
    function: Callable[..., Any], arguments: tuple, arrays: list, run: Callable[[list], Any]
) -> Callable[[list], Any] | None:
    """Return a program from disk, exported and stored before if it was not there.

    Args:
        function: the function of the program.
        arguments: its arguments.
        arrays: array leaves of the arguments.
        run: the function, of the arrays alone.

    Returns:
        The program as a function of the arrays; None if it cannot be stored.
    """
    if _STORE.folder is None or jax.default_backend() != "cpu":
        return None
    if not on_one_device(arrays):
        return None
    try:
        key = _key(function, arguments)
    except _NotDescribedError:
        return None
    path = _STORE.folder / key
    if (stored := _read(path)) is None:
        try:
            stored = bytes(jax.export.export(jax.jit(run))(arrays).serialize())
        except (ValueError, NotImplementedError):  # callbacks, and operations of no known format
            return None
        _write(path, stored)
    return jax.export.deserialize(bytearray(stored)).call


def on_one_device(arrays: list) -> bool:
    """Return True if all arrays of a list are known, none is traced, and each is on one device."""
    known = [array for array in arrays if array is not None]
    return not any(isinstance(a, Tracer) or len(a.devices()) > 1 for a in known)


def _key(function: Callable[..., Any], arguments: tuple) -> str:
    """Return the key of a program, in hexadecimal digits."""
    digest = hashlib.sha256(_code() + _STORE.settings().encode())
    for part in _described((function, arguments)):
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()


@functools.cache
def _code() -> bytes:
    """Return a digest of the source of this package, and of the versions of those that it uses."""
    digest = hashlib.sha256(repr(sys.version_info).encode())
    for name in VERSIONED:
        digest.update(f"{name} {metadata.version(name)}\0".encode())
    package = Path(__file__).parents[1]
    for path in sorted(package.rglob("*.py")):
        digest.update(str(path.relative_to(package)).encode() + path.read_bytes())
    return digest.digest()


def _described(node: Any) -> Iterator[str]:
    """Yield a description of all that a trace may use of a value: of an array its type.

    Raises:
        _NotDescribedError: if the class of the value, or of a part of it, is not one of the known
            packages.
    """
    if isinstance(node, jax.Array):
        yield f"{node.shape} {node.dtype} {node.weak_type}"
    elif isinstance(node, np.ndarray | np.generic) and node.dtype.kind in "biufcSU":
        yield f"{node.shape} {node.dtype} {hashlib.sha256(node.tobytes()).hexdigest()}"
    elif isinstance(node, enum.Enum):
        yield f"{_name(type(node))} {node.name}"
    elif node is None or type(node) in SCALARS:
        yield f"{type(node).__name__} {node!r}"
    else:
        name, parts = _apart(node)
        yield f"{name} {len(parts)}"
        for part in parts:
            yield from _described(part)


def _apart(node: Any) -> tuple[str, list]:
    """Return the name of a container or module and its parts, or that of a class or function."""
    if isinstance(node, dict):
        parts = [part for pair in node.items() for part in pair]
    elif isinstance(node, tuple | list):
        parts = list(node)
    elif dataclasses.is_dataclass(node) and not isinstance(node, type):
        parts = [getattr(node, field.name, None) for field in dataclasses.fields(node)]
    else:
        return _name(node), []
    kind = type(node)
    return kind.__name__ if kind in (dict, tuple, list) else _name(kind), parts


def _name(named: Any) -> str:
    """Return the full name of a class or function at the top level of a known package."""
    module, name = str(getattr(named, "__module__", "")), str(getattr(named, "__qualname__", ""))
    known = module.partition(".")[0] in (PACKAGE, *VERSIONED)
    if not known or getattr(sys.modules.get(module), name, None) is not named:
        raise _NotDescribedError
    return f"{module}.{name}"


def _read(path: Path) -> bytes | None:
    """Return what `_write` has written, or None if it is not there or damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    digest, stored = content[:DIGEST_BYTES], content[DIGEST_BYTES:]
    return stored if hashlib.sha256(stored).digest() == digest else None


def _write(path: Path, stored: bytes) -> None:
    """Write a program with its digest, whole or not at all; without it the next process traces."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            file.write(hashlib.sha256(stored).digest() + stored)
        os.replace(file.name, path)
    except OSError:
        return
