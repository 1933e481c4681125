"""Replacement of a model's polynomials, by dotted name."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

import equinox as eqx

from .._foundation.checks import require_known
from .polynomial import Polynomial

Step = tuple[str, str | int]  # ("attribute" or "item", name or index)
Model = TypeVar("Model", bound=eqx.Module)


def with_polynomials(model: Model, polynomials: Mapping[str, Polynomial]) -> Model:
    """Return the model with its polynomials of these names replaced by others, with any terms.

    The name of a polynomial is the name of its parameters without the term: `Cm` for an aircraft
    with the coefficients `Cm.alpha` and so on, `longitudinal.Cm` for a polynomial in a module that
    is not transparent.

    Args:
        model: any module, wrappers included.
        polynomials: by dotted name.

    Raises:
        InputError: when the model has no polynomial of a name; the message lists its polynomials.
    """
    paths = dict(_polynomials(model, "", ()))
    require_known("polynomial", polynomials, paths)
    if not polynomials:
        return model
    chosen = [paths[name] for name in polynomials]
    return eqx.tree_at(
        lambda tree: [_at(tree, path) for path in chosen], model, list(polynomials.values())
    )


def with_terms(model: Model, terms: Mapping[str, Sequence[str]]) -> Model:
    """Return the model with some of its polynomials in other terms (`Polynomial.with_terms`).

    Args:
        model: any module, wrappers included.
        terms: all terms of the result, by dotted name of the polynomial.

    Raises:
        InputError: when the model has no polynomial of a name.
    """
    known = polynomials_of(model)
    require_known("polynomial", terms, known)
    return with_polynomials(model, {name: known[name].with_terms(terms[name]) for name in terms})


def polynomials_of(model: eqx.Module) -> dict[str, Polynomial]:
    """Return the polynomials of a model by dotted name.

    Args:
        model: any module, wrappers included.
    """
    return {name: _at(model, path) for name, path in _polynomials(model, "", ())}


def _polynomials(node, name: str, path: tuple[Step, ...]) -> Iterator[tuple[str, tuple[Step, ...]]]:
    """Name and path of each polynomial below a node, with names as in `parameter_names`."""
    if isinstance(node, Polynomial):
        yield name, path
    elif isinstance(node, eqx.Module):
        transparent = getattr(node, "transparent", ())
        for field in dataclasses.fields(node):
            if not field.metadata.get("static", False):
                below = name if field.name in transparent else f"{name}.{field.name}".lstrip(".")
                yield from _polynomials(
                    getattr(node, field.name), below, (*path, ("attribute", field.name))
                )
    elif isinstance(node, tuple | list):
        for index, child in enumerate(node):
            label = getattr(child, "name", index)
            yield from _polynomials(child, f"{name}.{label}".lstrip("."), (*path, ("item", index)))
    elif isinstance(node, dict):
        for key in sorted(node):
            yield from _polynomials(node[key], f"{name}.{key}".lstrip("."), (*path, ("item", key)))


def _at(node: Any, path: tuple[Step, ...]) -> Any:
    """Return the node at a path."""
    for kind, key in path:
        node = getattr(node, str(key)) if kind == "attribute" else node[key]
    return node
