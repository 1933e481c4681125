"""Classes and functions that a study file names as `module:name`; checked before any call."""

import importlib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, get_args, get_type_hints

from ..._foundation.checks import InputError, require, require_known


class Product(NamedTuple):
    """Kind of object that a named class or function must return.

    Attributes:
        base: base class, `AbstractModel` or `Effect`.
        is_collection: True for a tuple of such objects; a class is then not accepted.
        description: description, used in error messages.
    """

    base: type
    is_collection: bool
    description: str


def named_object(name: str, folder: Path, product: Product, hint: str = "") -> Callable[..., Any]:
    """Return the class or function that `module:name` refers to; it is not called.

    The module is a file or package in `folder`, or an installed package. Modules of the standard
    library, and names that are both in the folder and installed, are refused before the import.
    While a module of the folder is imported, the folder stands at the end of `sys.path`, so that
    the module finds its neighbours and no neighbour replaces an installed package.

    Accepted are a concrete subclass of `product.base`, unless a collection is wanted, and a Python
    function that is defined in the named module or package. A function of an installed package must
    declare its return type: `product.base` or a subclass, or a collection of these.

    Args:
        name: text `module:name`.
        folder: folder of the study file.
        product: object that the class or function must return.
        hint: text appended to the error messages about the module.

    Raises:
        InputError: if the module or the name does not exist, the module raises an exception, or the
            object is not of an accepted kind.
    """
    module, _, attribute = name.partition(":")
    parts = module.split(".")
    require(
        all(part.isidentifier() for part in (*parts, attribute)),
        f"found {name!r}, and `module:name` is wanted.{hint}",
    )
    is_local = _is_in_folder(parts[0], folder, hint)
    imported = _import(module, folder, is_local, hint)
    require_known(
        f"name in the module {module!r}:",
        [attribute],
        [n for n in vars(imported) if not n.startswith("_")],
    )
    named = getattr(imported, attribute)
    _check_kind(name, named, product, is_local)
    return named


def call(name: str, function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    """Return the result of a named function; an exception in it becomes an `InputError`.

    Args:
        name: text `module:name`, for the error message.
        function: the class or function.
        arguments, named: its arguments.

    Raises:
        InputError: if the function raises an exception; the message names its type, file and line.
    """
    try:
        return function(*arguments, **named)
    except InputError:
        raise
    except (Exception, SystemExit) as error:
        raise InputError(f"{name} raises {_described(error)} Correct it there.") from error


def _is_in_folder(top: str, folder: Path, hint: str) -> bool:
    """True if a module or package is in the folder, False if it is installed."""
    local = {path.resolve() for path in (folder / f"{top}.py", folder / top / "__init__.py")}
    is_local = any(path.is_file() for path in local)
    remedy = f" Rename {top}.py." if is_local else " Name a module with a model."
    require(
        top not in sys.stdlib_module_names,
        f"{top!r} is a module of Python's standard library, and has no models.{remedy}{hint}",
    )
    importlib.invalidate_caches()
    try:
        spec = importlib.util.find_spec(top)
    except ValueError:  # a module without a specification, such as `__main__`
        raise InputError(
            f"{top!r} cannot be imported by name. Give the module's own name."
        ) from None
    if not is_local:
        require(
            spec is not None,
            f"there is no module {top!r} in the file's folder, and none is installed. Put "
            f"{top}.py there.{hint}",
        )
        return False
    origin = None if spec is None else spec.origin
    require(
        spec is None or (origin is not None and Path(origin).resolve() in local),
        f"{top!r} is in the file's folder, and another module {top!r} is installed"
        f"{f' ({origin})' if origin else ''}. Rename the one in the folder.",
    )
    return True


def _import(module: str, folder: Path, is_local: bool, hint: str) -> ModuleType:
    """Import a module that is in the folder, or installed."""
    try:
        with _at_end_of_path(folder if is_local else None):
            return importlib.import_module(module)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        require(
            f"{module}.".startswith(f"{missing}."),
            f"{module}.py imports {missing!r}, which is not installed. Install it.",
        )
        raise InputError(
            f"there is no module {missing!r} in the file's folder, and none is installed.{hint}"
        ) from error
    except (Exception, SystemExit) as error:
        raise InputError(
            f"the import of {module!r} raises {_described(error)} Correct it there."
        ) from error


@contextmanager
def _at_end_of_path(folder: Path | None) -> Iterator[None]:
    """Context in which a folder, if any, is the last entry of `sys.path`."""
    if folder is None:
        yield
        return
    entry = str(folder)
    sys.path.append(entry)
    try:
        yield
    finally:
        last = len(sys.path) - 1 - sys.path[::-1].index(entry) if entry in sys.path else None
        if last is not None:
            del sys.path[last]


def _check_kind(name: str, named: Any, product: Product, is_local: bool) -> None:
    """Refuse, before any call, an object that is no model class and no function for models."""
    if inspect.isclass(named) and not product.is_collection:
        require(
            issubclass(named, product.base),
            f"{name} is a class, and no subclass of {product.base.__name__}. Make it a subclass.",
        )
        require(
            not inspect.isabstract(named), f"{name} is an abstract class. Name a concrete subclass."
        )
        return
    wanted = "a function" if product.is_collection else "a model class or a function"
    require(
        inspect.isfunction(named),
        f"{name} is neither a class nor a function written in Python; {wanted} is wanted. Name one."
        if not inspect.isclass(named)
        else f"{name} is a class, and {wanted} is wanted. Name one.",
    )
    top, home = name.partition(":")[0].partition(".")[0], str(named.__module__)
    require(
        home.partition(".")[0] == top,
        f"{name} is a function of the module {home!r}, and one that is defined in {top!r} is "
        f"wanted. Write a function there.",
    )
    require(
        is_local or _returns(named, product),
        f"{name} is a function of an installed package and does not declare that it returns "
        f"{product.description}. Name another, or call it in a "
        "function of your own, in a module beside the study file.",
    )


def _returns(function: Callable[..., Any], product: Product) -> bool:
    """True if the annotation of the returned value is the base class, or a collection of it."""
    try:
        declared = get_type_hints(function).get("return")
    except (NameError, TypeError, AttributeError):
        return False
    kinds = get_args(declared) if product.is_collection else (declared,)
    return any(inspect.isclass(kind) and issubclass(kind, product.base) for kind in kinds)


def _described(error: BaseException) -> str:
    """Type, message, file and line of an exception, as the end of a sentence."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    if isinstance(error, SyntaxError) and error.filename:
        place = f" ({Path(error.filename).name}, line {error.lineno})"
    message = error.msg if isinstance(error, SyntaxError) else str(error)
    return f"{type(error).__name__}{place}: {message.strip().rstrip('.')}."
