"""Other polynomials in the place of a model's own, by dotted name."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

import equinox as eqx

from .._foundation.checks import require_known
from .polynomial import Polynomial

Step = tuple[str, str | int]  # ("attribute" or "item", which)
Model = TypeVar("Model", bound=eqx.Module)


def with_polynomials(model: Model, polynomials: Mapping[str, Polynomial]) -> Model:
    """The model with other polynomials, of any terms, where it has polynomials of these names.

    The name is that of the polynomial's parameters without their terms: `Cm` of an aircraft, whose coefficients are called
    `Cm.alpha` and so on, `longitudinal.Cm` where a module that is not transparent holds it.

    Args:
        model: any module, wrappers included.
        polynomials: by dotted name.

    Raises:
        InputError: when the model has no polynomial of a name; those that it has are listed.
    """
    paths = dict(_polynomials(model, "", ()))
    require_known("polynomial", polynomials, paths)
    if not polynomials:
        return model
    chosen = [paths[name] for name in polynomials]
    return eqx.tree_at(lambda tree: [_at(tree, path) for path in chosen], model, list(polynomials.values()))


def polynomials_of(model: eqx.Module) -> dict[str, Polynomial]:
    """The polynomials of a model by dotted name.

    Args:
        model: any module, wrappers included.
    """
    return {name: _at(model, path) for name, path in _polynomials(model, "", ())}


def _polynomials(node, name: str, path: tuple[Step, ...]) -> Iterator[tuple[str, tuple[Step, ...]]]:
    """Name and path of each polynomial below a node, named as `parameter_names` names what is in it."""
    if isinstance(node, Polynomial):
        yield name, path
    elif isinstance(node, eqx.Module):
        transparent = getattr(node, "transparent", ())
        for field in dataclasses.fields(node):
            if not field.metadata.get("static", False):
                below = name if field.name in transparent else f"{name}.{field.name}".lstrip(".")
                yield from _polynomials(getattr(node, field.name), below, (*path, ("attribute", field.name)))
    elif isinstance(node, tuple | list):
        for index, child in enumerate(node):
            label = getattr(child, "name", index)
            yield from _polynomials(child, f"{name}.{label}".lstrip("."), (*path, ("item", index)))
    elif isinstance(node, dict):
        for key in sorted(node):
            yield from _polynomials(node[key], f"{name}.{key}".lstrip("."), (*path, ("item", key)))


def _at(node: Any, path: tuple[Step, ...]) -> Any:
    """What stands at a path."""
    for kind, which in path:
        node = getattr(node, str(which)) if kind == "attribute" else node[which]
    return node
