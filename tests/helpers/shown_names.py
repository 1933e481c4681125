"""The definitions of the package that code shows.

Code shows a definition that it names, and classes that it uses without naming them: the result of
a function that it names, the type of a field or the result of a method that it reads, and the
abstract base of a class that it shows.
"""

import ast
import importlib.util
import inspect
import types
import typing
from collections.abc import Iterable, Iterator

from public_names import definition, module_of

PACKAGE = "jaxid"


def shown_definitions(first: str, others: Iterable[str]) -> set[str]:
    """Return the paths of all definitions that the code of pages shows, as `package.file.name`.

    Args:
        first: code of the first page, whose imports hold on the other pages.
        others: code of each other page.
    """
    imported = dict(_imports(ast.parse(first)))
    dotted, attributes = set(), {"__call__"}
    for tree in map(ast.parse, (first, *others)):
        known = imported | dict(_imports(tree))
        dotted |= {path for node in ast.walk(tree) if (path := _path(node, known))}
        attributes |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    named = dict(found for path in dotted for found in _definitions(path))
    classes: set[type] = set()
    new = list(named.values())
    while new:
        used = {one for thing in new for one in _used(thing, attributes)}
        new = list(used - classes)
        classes |= used
    return set(named) | {f"{one.__module__}.{one.__qualname__}" for one in classes}


def _imports(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """Yield (name, dotted path) of the absolute imports from the package."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                name = alias.asname or alias.name.partition(".")[0]
                path = alias.name if alias.asname else name
                if _in_package(path):
                    yield name, path
        elif isinstance(node, ast.ImportFrom) and not node.level and _in_package(node.module or ""):
            for alias in node.names:
                yield alias.asname or alias.name, f"{node.module}.{alias.name}"


def _in_package(path: str) -> bool:
    return path.partition(".")[0] == PACKAGE


def _path(node: ast.AST, imported: dict[str, str]) -> str | None:
    """Return the dotted path of a name or an attribute that begins with an imported name."""
    if isinstance(node, ast.Name):
        return imported.get(node.id)
    if isinstance(node, ast.Attribute) and (base := _path(node.value, imported)):
        return f"{base}.{node.attr}"
    return None


def _definitions(dotted: str) -> Iterator[tuple[str, object]]:
    """Yield (path of the definition, object) of the modules in a path and of the name after them.

    A module that does not exist, such as one that the reader is to write, yields nothing.
    """
    path, *parts = dotted.split(".")
    module = module_of(path)
    for part in parts:
        path = f"{path}.{part}"
        if not hasattr(module, part) and importlib.util.find_spec(path) is None:
            return
        thing = getattr(module, part) if hasattr(module, part) else module_of(path)
        if not isinstance(thing, types.ModuleType):
            yield definition(module.__name__, part), thing
            return
        yield f"{module.__name__}.{part}", thing
        module = thing


def _used(thing: object, attributes: set[str]) -> Iterator[type]:
    """Yield the classes that a function returns; or those behind the attributes of a class, and its
    abstract bases.
    """
    if not isinstance(thing, type):
        function = inspect.unwrap(thing) if callable(thing) else thing
        yield from _classes(getattr(function, "__annotations__", {}).get("return"))
        return
    for base in thing.__mro__:
        if base is not thing and base.__name__.startswith("Abstract"):
            yield from _classes(base)
        fields = vars(base).get("__annotations__", {})
        for name in attributes:
            yield from _classes(fields.get(name))
            member = vars(base).get(name)
            method = getattr(member, "fget", getattr(member, "__func__", member))
            yield from _classes(getattr(method, "__annotations__", {}).get("return"))


def _classes(annotation: object) -> Iterator[type]:
    """Yield the classes of the package in an annotation."""
    if isinstance(annotation, type) and _in_package(annotation.__module__):
        yield annotation
    for part in typing.get_args(annotation):
        yield from _classes(part)
