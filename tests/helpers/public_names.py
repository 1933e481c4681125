"""The public names of a module, and the place where each is defined, from imports and source."""

import ast
import functools
import importlib
import types
from pathlib import Path


def module_of(dotted: str) -> types.ModuleType:
    """Return a module by its public name, such as `jaxid.hold`, or by its path."""
    parent, _, name = dotted.rpartition(".")
    attribute = getattr(importlib.import_module(parent), name, None) if parent else None
    return attribute if isinstance(attribute, types.ModuleType) else importlib.import_module(dotted)


def public_names(dotted: str) -> tuple[str, ...]:
    """Return the names of `__all__`; without it, those that a package imports from its files, or
    those that a single file defines.
    """
    module = module_of(dotted)
    if hasattr(module, "__all__"):
        return tuple(module.__all__)
    if hasattr(module, "__path__"):
        return tuple(_imports(module))
    return tuple(
        name
        for name, value in vars(module).items()
        if not name.startswith("_") and getattr(value, "__module__", "") == module.__name__
    )


def definition(dotted: str, name: str) -> str:
    """Return the path of a public name in the file that defines it, as `package.file.name`."""
    module = module_of(dotted)
    imported = _imports(module).get(name)
    if imported is None or isinstance(getattr(module, name), types.ModuleType):
        return f"{module.__name__}.{name}"
    stem, original = imported
    return definition(stem, original) if stem != module.__name__ else f"{stem}.{original}"


@functools.cache
def _imports(module: types.ModuleType) -> dict[str, tuple[str, str]]:
    """Return (module, name there) of the relative imports of a file, by the name that they make."""
    tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
    own = module.__name__
    package = own if hasattr(module, "__path__") else own.rpartition(".")[0]
    names = {}
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package.rsplit(".", node.level - 1)[0]
            stem = f"{base}.{node.module}" if node.module else base
            names |= {alias.asname or alias.name: (stem, alias.name) for alias in node.names}
    return names
