"""Small array functions on the host: NumPy for known arrays, `jax.numpy` for traced ones.

Outside `jit`, every operation of `jax.numpy` compiles one program per shape, 10 to 30 ms each.
Operations on a few numbers are therefore left to NumPy.
"""

import contextlib
import functools
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer


def on_host(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return `function(xp, *arrays, **options)` as a function of the arrays and options.

    The namespace `xp` is NumPy if all arrays are known, and `jax.numpy` if one of them is traced or
    stands on a device that the user chose. The results are JAX arrays in both cases. A division by
    zero or an invalid value gives inf or NaN without a warning, as in JAX.

    Args:
        function: a function of a namespace, of trees of arrays, and of options that are not arrays.
    """

    @functools.wraps(function)
    def call(*arrays, **options):
        if not are_known(arrays):
            return function(jnp, *arrays, **options)
        with np.errstate(all="ignore"):
            return to_device(function(np, *jax.tree.map(np.asarray, arrays), **options))

    return call


@on_host
def columns_at(xp, values, at: tuple[int, ...]):
    """Return some columns, the last axis of an array, in the given order."""
    return values[..., xp.asarray(at, int)]


@on_host
def as_columns(xp, arrays, *, shape: tuple[int, ...]):
    """Return arrays of numbers, each of this shape, as the columns of one, along a new last axis;
    there may be none.
    """
    if not arrays:
        return xp.zeros((*shape, 0))
    return xp.stack([xp.asarray(array, float) for array in arrays], axis=-1)


def to_device(tree):
    """Return a tree with its NumPy arrays as JAX arrays of the same type, without compilation.

    `jnp.asarray` compiles a program for a NumPy scalar, and without a type. JAX may use the memory
    of the NumPy array, so that a user's array must be copied before. In 32 bit, which every
    function with records refuses, doubles become single. All arrays are given to JAX in one call:
    one by one, 60 small ones take two and a half times as long.
    """
    leaves, structure = jax.tree.flatten(tree)
    given = [np.asarray(leaf) for leaf in leaves if not isinstance(leaf, jax.Array)]
    placed = iter(jax.device_put(given))
    both = [leaf if isinstance(leaf, jax.Array) else next(placed) for leaf in leaves]
    return jax.tree.unflatten(structure, both)


def on_cpu() -> AbstractContextManager[Any]:
    """Return a context in which JAX's default device is the CPU, if JAX has one.

    On a GPU, small arrays that are read and checked one by one would travel to it and back, each in
    some 20 microseconds.
    """
    if jax.default_backend() == "cpu":
        return contextlib.nullcontext()
    try:
        return jax.default_device(jax.local_devices(backend="cpu")[0])
    except RuntimeError:  # JAX_PLATFORMS leaves the CPU out
        return contextlib.nullcontext()


def is_integer_array(leaf) -> bool:
    """Return True for an array of signed integers, such as `jnp.array(4)` given for a parameter."""
    return isinstance(leaf, jax.Array | np.ndarray) and jnp.issubdtype(
        leaf.dtype, jnp.signedinteger
    )


def are_known(tree) -> bool:
    """Return True if no leaf of a tree is traced or stands on a device that the user chose."""
    return not any(
        isinstance(leaf, Tracer) or getattr(leaf, "committed", False)
        for leaf in jax.tree.leaves(tree)
    )
