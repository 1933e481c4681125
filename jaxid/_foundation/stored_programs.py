"""Programs on disk, which another process neither traces nor lowers again.

JAX's persistent cache spares a process the compilation of a program, but not its trace, which for
an aircraft with its candidates takes longer than all the rest of a fit. A program is therefore also
stored as JAX exports it (StableHLO), under a key of everything that its trace depends on: the
shapes of its arrays, all other values, the source of this package, versions and settings. A trace
runs the code of the classes of its arguments, so that a program is stored only if all of them are
classes of this package or of those whose versions are in the key. If the source has changed since
its import, nothing is stored. Code of these packages that is replaced in memory is not in the key:
such a process leaves `configure` out, or calls it with `cache=False`.
"""

import dataclasses
import enum
import functools
import hashlib
import os
import pickle
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .host import are_known, to_device

PACKAGE = __name__.partition(".")[0]
# Packages whose code a trace may run; their versions are in the key.
VERSIONED = (
    *("jax", "jaxlib", "equinox", "diffrax", "interpax", "lineax", "optimistix"),
    *("numpy", "scipy"),
)
EQUINOX_SETTINGS = "EQX_"  # beginning of the environment variables that change Equinox's traces
IMPORTED = time.time()  # [s]
# Name of the folder of stored programs, inside the folder of JAX's persistent cache.
SUBFOLDER = "jaxid-exported"
# Of callbacks, operations of no known format, results that cannot be pickled, and flatbuffers, by
# which JAX writes, where it is not installed.
NOT_EXPORTED = (
    *(ValueError, NotImplementedError, pickle.PicklingError, AttributeError, TypeError),
    ImportError,
)
SCALARS = (bool, int, float, complex, str, bytes)
DIGEST_BYTES = hashlib.sha256().digest_size


class _NotDescribedError(Exception):
    """A value or source whose effect on a trace is unknown."""


@dataclasses.dataclass
class _Store:
    """Where programs are stored, nowhere until `store_programs` is called; settings of JAX."""

    folder: Path | None = None
    settings: Callable[[], tuple] = tuple


_STORE = _Store()


def store_programs(folder: Path | None, settings: Callable[[], tuple] = tuple) -> None:
    """Store exported programs in a subfolder of the folder of JAX's cache, or nowhere.

    Args:
        folder: folder of JAX's cache; None to store nothing.
        settings: function that returns all settings of JAX on which a trace may depend.
    """
    _STORE.folder = None if folder is None else folder / SUBFOLDER
    _STORE.settings = settings


class _Position(NamedTuple):
    """Stands for an array among the results of a program.

    Attributes:
        number: its number.
    """

    number: int


class StoredProgram(NamedTuple):
    """A compiled function of arrays, from disk.

    Attributes:
        jitted: function of the arrays, whose results are arrays.
        form: its result, in which positions stand for the arrays.
    """

    jitted: Any
    form: Any

    def __call__(self, arrays: list) -> Any:
        """Return the result for some arrays."""
        results = _uncommitted(self.jitted(arrays))
        return jax.tree.map(
            lambda leaf: results[leaf.number] if isinstance(leaf, _Position) else leaf,
            self.form,
            is_leaf=lambda leaf: isinstance(leaf, _Position),
        )

    def lower(self, arrays: list) -> Any:
        """Return the lowered program for some arrays."""
        return self.jitted.lower(arrays)


def _uncommitted(arrays: list[jax.Array]) -> list[jax.Array]:
    """Return arrays that may be used with arrays on any device, but for random keys, and for traced
    arrays, which a program called under another `jit` returns.

    JAX commits the results of an exported program to their device.
    """

    def known(array: jax.Array) -> jax.Array | np.ndarray:
        is_key = jnp.issubdtype(array.dtype, jax.dtypes.extended)
        return array if is_key or isinstance(array, Tracer) else np.asarray(array)

    return to_device([known(array) for array in arrays])


def stored_program(
    function: Callable[..., Any],
    arguments: Any,
    arrays: list,
    run: Callable[[list], Any],
    options: dict[str, bool | int] | None,
) -> StoredProgram | None:
    """Return a program from disk, exported and stored before if it was not there.

    Args:
        function: the function of the program.
        arguments: its arguments.
        arrays: array leaves of the arguments.
        run: the function, of the arrays alone.
        options: compiler options.

    Returns:
        The program; None if it cannot be stored.
    """
    if _STORE.folder is None or jax.default_backend() != "cpu" or not are_known(arrays):
        return None
    try:
        path = _STORE.folder / _key(function, arguments, arrays)
        if (content := _read(path)) is None:
            content = _exported(run, arrays)
            _write(path, content)
    except (_NotDescribedError, *NOT_EXPORTED):
        return None
    form, program = pickle.loads(content)
    called = jax.export.deserialize(bytearray(program)).call
    return StoredProgram(jax.jit(called, compiler_options=options), form)


def _exported(run: Callable[[list], Any], arrays: list) -> bytes:
    """Return a program with the form of its result, as bytes."""
    forms = []

    def results(arrays):
        leaves, structure = jax.tree.flatten(run(arrays))
        is_array = [eqx.is_array(leaf) for leaf in leaves]
        places = map(_Position, np.cumsum(is_array) - 1)
        both = zip(leaves, places, is_array, strict=True)
        forms.append(jax.tree.unflatten(structure, [p if a else leaf for leaf, p, a in both]))
        return [leaf for leaf, a in zip(leaves, is_array, strict=True) if a]

    results.__name__ = getattr(run, "__name__", results.__name__)
    program = bytes(jax.export.export(jax.jit(results))(arrays).serialize())
    return pickle.dumps((forms[-1], program))


def storing() -> bool:
    """Return True if programs are stored."""
    return _STORE.folder is not None


def split_leaves(arguments: Any) -> tuple[list, tuple]:
    """Split the leaves of some arguments into arrays and static leaves.

    Returns:
        The arrays, None at the static leaves; and the static leaves, None at the arrays, with the
        tree structure of both.
    """
    leaves, structure = jax.tree.flatten(arguments)
    is_array = [eqx.is_array(leaf) for leaf in leaves]
    arrays = [leaf if known else None for leaf, known in zip(leaves, is_array, strict=True)]
    static = tuple(None if known else leaf for leaf, known in zip(leaves, is_array, strict=True))
    return arrays, (static, structure)


def joined_leaves(arrays: list, others: tuple) -> Any:
    """Return the arguments that `split_leaves` has split."""
    static, structure = others
    both = zip(arrays, static, strict=True)
    return jax.tree.unflatten(structure, [b if a is None else a for a, b in both])


def types_of(arrays: list, others: tuple) -> tuple:
    """Return a key of the program for some split arguments, within this process."""
    known = (a for a in arrays if a is not None)
    types = tuple((a.shape, a.dtype, getattr(a, "weak_type", False)) for a in known)
    return others, types, _STORE.settings()


def _key(function: Callable[..., Any], arguments: Any, arrays: list) -> str:
    """Return the key of a program, in hexadecimal digits."""
    digest = hashlib.sha256(_code() + repr(_STORE.settings()).encode())
    for part in _described((function, arguments), frozenset(map(id, arrays))):
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()


@functools.cache
def _code() -> bytes:
    """Return a digest of the source of this package, and of the versions and the settings of those
    that it uses.

    Raises:
        _NotDescribedError: if the source is not in files, or has changed since its import.
    """
    digest = hashlib.sha256(repr(sys.version_info).encode())
    environment = sorted(os.environ.items())
    digest.update(repr([(n, v) for n, v in environment if n.startswith(EQUINOX_SETTINGS)]).encode())
    for name in VERSIONED:
        digest.update(f"{name} {metadata.version(name)}\0".encode())
    package = Path(__file__).parents[1]
    paths = sorted(package.rglob("*.py"))
    if not paths or max(path.stat().st_mtime for path in paths) > IMPORTED:
        raise _NotDescribedError
    for path in paths:
        digest.update(str(path.relative_to(package)).encode() + path.read_bytes())
    return digest.digest()


def _described(node: Any, traced: frozenset[int]) -> Iterator[str]:
    """Yield a description of all that a trace may use of a value.

    Args:
        node: the value.
        traced: identities of the arrays whose values a trace does not see.

    Raises:
        _NotDescribedError: if the class of the value, or of a part of it, is not one of the known
            packages.
    """
    if id(node) in traced and node is not None:
        yield f"{node.shape} {node.dtype} {getattr(node, 'weak_type', False)}"
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
            yield from _described(part, traced)


def _apart(node: Any) -> tuple[str, list]:
    """Return the name of a container or module and its parts; a class or function has no parts."""
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
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            file = Path(folder) / path.name
            file.write_bytes(hashlib.sha256(stored).digest() + stored)
            file.replace(path)
    except OSError:
        return
