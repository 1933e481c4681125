"""Dotted names of a model's parameters, and the one flat vector in which they stand.

A name is the path of attributes to an array leaf, then the element: `k`, `A[0,1]`, `Cm.alpha^2`. A module shapes its names by
two optional class attributes: `transparent`, fields whose own name is left out of the path (a wrapper's inner model), and
`element_names`, a property that maps an array field to the names of its elements (a polynomial's terms).
"""

import dataclasses
import itertools
from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from .._foundation.checks import require_unique
from .._foundation.types import Array, Float


def parameter_names(model) -> tuple[str, ...]:
    """Names of all scalar parameters of a model, in the order of its flat vector.

    Args:
        model: any module whose numeric leaves are parameters.

    Returns:
        One dotted name for each element of each array leaf.

    Raises:
        InputError: when two parameters would have the same name.
    """
    names = tuple(_walk(model, ""))
    require_unique("parameter", names)
    return names


def flatten(model):
    """The flat vector of a model's parameters and the function that puts a vector back: `(vector, unflatten)`."""
    arrays, rest = eqx.partition(model, eqx.is_inexact_array)
    vector, unravel = ravel_pytree(arrays)
    return vector.astype(float), lambda values: eqx.combine(unravel(values), rest)


def array_leaves(model) -> list[Array]:
    """The array leaves of a model, in the order in which they stand in its flat vector."""
    return jax.tree.leaves(eqx.filter(model, eqx.is_inexact_array))


def with_array_leaves(model, leaves: list[Array]):
    """The model with other array leaves, in the same order."""
    arrays, rest = eqx.partition(model, eqx.is_inexact_array)
    return eqx.combine(jax.tree.unflatten(jax.tree.structure(arrays), leaves), rest)


def read(model, names: tuple[str, ...]) -> Float[Array, " parameter"]:
    """Values of the named parameters."""
    available = parameter_names(model)
    return flatten(model)[0][np.array([available.index(name) for name in names], int)]


def _walk(node, prefix: str) -> Iterator[str]:
    """Names below one node, in the order in which `jax.tree` visits its leaves."""
    if isinstance(node, eqx.Module):
        transparent = getattr(node, "transparent", ())
        elements = getattr(node, "element_names", {})
        for field in dataclasses.fields(node):
            if field.metadata.get("static", False):
                continue
            child = getattr(node, field.name, None)
            if field.name in elements:
                yield from (f"{prefix}.{name}".lstrip(".") for name in elements[field.name])
            else:
                yield from _walk(child, prefix if field.name in transparent else f"{prefix}.{field.name}".lstrip("."))
    elif isinstance(node, tuple | list):
        for index, child in enumerate(node):
            yield from _walk(child, f"{prefix}.{getattr(child, 'name', index)}".lstrip("."))
    elif isinstance(node, dict):
        for key in sorted(node):
            yield from _walk(node[key], f"{prefix}.{key}".lstrip("."))
    elif eqx.is_inexact_array(node) or (isinstance(node, float | int) and not isinstance(node, bool)):
        shape = jnp.shape(node)
        for index in itertools.product(*map(range, shape)):
            yield prefix + (f"[{','.join(map(str, index))}]" if shape else "")
