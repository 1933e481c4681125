"""Dotted names of a model's parameters, and the flat vector of their values.

A name is the path of attributes to an array leaf, then the element: `k`, `A[0,1]`, `Cm.alpha^2`. A
module controls its names by two optional class attributes: `transparent`, fields whose name is left
out of the path (a wrapper's inner model), and `element_names`, a property that maps an array field
to the names of its elements (a polynomial's terms).
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
from .._foundation.host import is_integer_array, on_host
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
    """Return `(vector, unflatten)`: the flat vector of a model's parameters, and the function that
    returns the model for such a vector.
    """
    arrays, static = eqx.partition(model, eqx.is_inexact_array)
    vector, unravel = ravel_pytree(arrays)
    return vector.astype(float), lambda values: eqx.combine(unravel(values), static)


def flat_vector(model) -> Float[Array, " parameter"]:
    """The flat vector of a model's parameters; compiles nothing where the values are known."""
    return _joined(array_leaves(model))


@on_host
def _joined(xp, leaves, at=slice(None)):
    """Return arrays as one vector, or the elements at some positions of it."""
    return xp.concatenate([xp.zeros(0), *(xp.ravel(leaf) for leaf in leaves)])[at]


def array_leaves(model) -> list[Array]:
    """The array leaves of a model, in the order of its flat vector."""
    return jax.tree.leaves(eqx.filter(model, eqx.is_inexact_array))


def with_array_leaves(model, leaves: list[Array]):
    """The model with other array leaves, in the same order."""
    arrays, static = eqx.partition(model, eqx.is_inexact_array)
    return eqx.combine(jax.tree.unflatten(jax.tree.structure(arrays), leaves), static)


def read_parameters(model, names: tuple[str, ...]) -> Float[Array, " parameter"]:
    """Values of the named parameters."""
    available = parameter_names(model)
    at = np.array([available.index(name) for name in names], int)
    return _joined(array_leaves(model), at=at)


def _walk(node, prefix: str) -> Iterator[str]:
    """Names of the parameters below a node, in the order of the leaves of `jax.tree`."""
    if isinstance(node, eqx.Module):
        yield from _walk_fields(node, prefix)
    elif isinstance(node, tuple | list):
        for index, child in enumerate(node):
            yield from _walk(child, _below(prefix, getattr(child, "name", index)))
    elif isinstance(node, dict):
        for key in sorted(node):
            yield from _walk(node[key], _below(prefix, key))
    elif (
        eqx.is_inexact_array(node)
        or is_integer_array(node)
        or (isinstance(node, float | int | np.integer) and not isinstance(node, bool))
    ):
        yield from _elements(prefix, jnp.shape(node))


def _walk_fields(module: eqx.Module, prefix: str) -> Iterator[str]:
    """Names below the fields of a module, with its `transparent` and `element_names`."""
    transparent = getattr(module, "transparent", ())
    elements = getattr(module, "element_names", {})
    for field in dataclasses.fields(module):
        if field.metadata.get("static", False):
            continue
        if field.name in elements:
            yield from (_below(prefix, name) for name in elements[field.name])
        else:
            inner = prefix if field.name in transparent else _below(prefix, field.name)
            yield from _walk(getattr(module, field.name, None), inner)


def _elements(prefix: str, shape: tuple[int, ...]) -> Iterator[str]:
    """Names of the elements of an array; the name of a scalar is the prefix."""
    for index in itertools.product(*map(range, shape)):
        yield prefix + (f"[{','.join(map(str, index))}]" if shape else "")


def _below(prefix: str, name) -> str:
    return f"{prefix}.{name}".lstrip(".")
