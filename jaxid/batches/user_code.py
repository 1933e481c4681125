"""Code of the user that a batch runs, as short texts.

The code is read from memory and not from files: from there a class of a notebook, of a script and
of a function can be read, and a file may have changed since its import.
"""

import contextlib
import dis
import functools
import hashlib
import itertools
import sys
import types
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.stored_programs import PACKAGE, SCALARS, VERSIONED

# Packages whose code counts by its name alone.
NAMED = {PACKAGE, *VERSIONED, "jaxtyping", *sys.stdlib_module_names}
CONSTANTS = (*SCALARS, type(None), type(...))
# Objects of Python that contain functions, with the attributes that hold these.
WRAPPERS: dict[type, tuple[str, ...]] = {
    property: ("fget",),
    staticmethod: ("__func__",),
    classmethod: ("__func__",),
    types.MethodType: ("__func__", "__self__"),
    functools.partial: ("func", "args", "keywords"),
    functools.cached_property: ("func",),
}
WRAPPED = ("__wrapped__", "__func__", "__self__")  # attributes of wrappers of JAX and Equinox
GENERATED = "<string>"  # file of the methods that `dataclasses` writes

Parts = list[Any]


def code_of(tree: Any) -> Iterator[str]:
    """Yield a description of the code outside of this package that a tree of modules runs.

    It contains the bytecode of the methods of each class and of its bases, and the functions,
    classes and values that this code uses, of the module and of an enclosing function. Numbers of
    the tree, comments and file names are not in it. Another version of Python has other bytecode.

    Args:
        tree: modules, functions, and containers of them.
    """
    waiting, known = [eqx.filter(tree, eqx.is_array_like, inverse=True)], {}
    while waiting:
        node = waiting.pop()
        text, parts = _described(node)
        if parts and not isinstance(node, tuple):  # equal tuples may be one object, or two
            if id(node) in known:
                parts = []
            known[id(node)] = node  # kept, so that no other object gets its identity
        yield f"{text} {len(parts)}\0"
        waiting.extend(reversed(parts))


def _described(node: Any) -> tuple[str, Parts]:
    """Return a text for a value itself, and its parts."""
    kind = type(node)
    if kind in CONSTANTS:
        return repr(node), []
    if isinstance(node, np.ndarray | np.generic | jax.Array):
        return _array(node)
    if isinstance(node, types.CodeType):
        return f"{node.co_code.hex()} {node.co_names}", list(node.co_consts)
    if kind in WRAPPERS:
        return kind.__name__, [getattr(node, name) for name in WRAPPERS[kind]]
    if isinstance(node, dict | types.MappingProxyType | set | frozenset | tuple | list):
        return _container(node)
    return _object(node)


def _container(node: Any) -> tuple[str, Parts]:
    """Return the name and the members of a container; the order of a set has no meaning."""
    kind = type(node).__name__
    if isinstance(node, set | frozenset):
        return f"{kind} {sorted(map(repr, node))}", []
    if isinstance(node, tuple | list):
        return kind, list(node)
    return kind, [part for pair in node.items() for part in pair]


def _object(node: Any) -> tuple[str, Parts]:
    """Return the description of a class, a function, a module of Python or an instance."""
    if isinstance(node, types.FunctionType):
        own = [] if _is_named(node) else _function(node)
        return _name(node), [*own, *_enclosed(node)]
    if isinstance(node, type):
        return _name(node), [] if _is_named(node) else _class(node)
    if isinstance(node, types.ModuleType):
        return _name(node), []
    kind = type(node)
    pairs = [part for name, value in _attributes(node) for part in (name, value)]
    return f"{_name(kind)} {getattr(node, '__name__', '')}", [kind, *pairs]


def _attributes(node: Any) -> list[tuple[str, Any]]:
    """Return the attributes of an instance; private ones only of a class of the user."""
    package = _package(type(node))
    if package in sys.stdlib_module_names:
        return []
    values = getattr(node, "__dict__", {})
    names = [n for n in sorted(values) if package not in NAMED or n in WRAPPED or n[0] != "_"]
    return [(name, values[name]) for name in names]


def _class(kind: type) -> Parts:
    """Return the bases, methods and values of a class."""
    written = {name: value for name, value in vars(kind).items() if _counts(name, value)}
    return [*kind.__bases__, *(part for name in sorted(written) for part in (name, written[name]))]


def _function(function: types.FunctionType) -> Parts:
    """Return the code of a function, its defaults, and the global values that it uses."""
    defaults = function.__defaults__, function.__kwdefaults__
    return [function.__code__, *defaults, *_globals(function)]


def _counts(name: str, attribute: Any) -> bool:
    """Return True for a method or value of a class that its author wrote."""
    if not name.startswith("__"):
        return name != "_abc_impl"
    return isinstance(attribute, types.FunctionType) and attribute.__code__.co_filename != GENERATED


def _enclosed(function: types.FunctionType) -> Parts:
    """Return the values that a function uses of the function around it."""
    values = []
    for cell in function.__closure__ or ():
        with contextlib.suppress(ValueError):  # a function that is not yet defined
            values.append(cell.cell_contents)
    return values


def _globals(function: types.FunctionType) -> Parts:
    """Return the global values that a function uses, also as attributes of the user's modules."""
    codes = _codes(function)
    instructions = itertools.chain.from_iterable(map(dis.get_instructions, codes))
    loaded = {one.argval for one in instructions if one.opname == "LOAD_GLOBAL"}
    names = {name for code in codes for name in code.co_names}
    values = _values(function.__globals__, loaded)
    modules = list(filter(_is_module_of_user, values))
    for module in modules:
        inner = _values(vars(module), names)
        values.extend(inner)
        modules.extend(m for m in inner if _is_module_of_user(m) and m not in modules)
    return values


def _codes(function: types.FunctionType) -> list[types.CodeType]:
    """Return the code of a function and of the functions inside it."""
    codes = [function.__code__]
    for code in codes:
        codes.extend(part for part in code.co_consts if isinstance(part, types.CodeType))
    return codes


def _values(space: dict[str, Any], names: set[str]) -> Parts:
    """Return the values of the names that exist in a module, by name."""
    return [space[name] for name in sorted(names) if name in space]


def _is_module_of_user(value: Any) -> bool:
    return isinstance(value, types.ModuleType) and not _is_named(value)


def _is_named(node: Any) -> bool:
    """Return True for a class, function or module whose name describes it."""
    return _package(node) in NAMED


def _package(node: Any) -> str:
    is_module = isinstance(node, types.ModuleType)
    name = node.__name__ if is_module else getattr(node, "__module__", None)
    return str(name).partition(".")[0]


def _name(node: Any) -> str:
    """Return the name of a class, function or module, without the module in the user's code: a
    script is a module of another name where it is imported.
    """
    name = getattr(node, "__qualname__", node.__name__)
    return f"{node.__module__}.{name}" if _is_named(node) and hasattr(node, "__module__") else name


def _array(values: Any) -> tuple[str, Parts]:
    """Return the description of an array; the parts of one of objects are these."""
    is_key = jnp.issubdtype(values.dtype, jax.dtypes.extended)
    values = np.asarray(jax.random.key_data(values) if is_key else values)
    heading = f"{values.shape} {values.dtype}"
    if values.dtype.hasobject:
        return heading, values.ravel().tolist()
    return f"{heading} {hashlib.sha256(values.tobytes()).hexdigest()}", []
