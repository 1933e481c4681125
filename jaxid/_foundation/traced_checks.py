"""Checks of values that may be traced: made on concrete values, skipped under `jit` and `vmap`."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from .checks import require


def require_value(value, holds: Callable[[np.ndarray], Any], message: str) -> None:
    """Refuse a value that does not meet a condition, unless it is traced.

    Args:
        value: a number, an array or a tree of them.
        holds: the condition on one array, element by element or as a whole; NaN never meets it.
        message: the refusal; `{}` in it becomes the value.

    Raises:
        InputError: when the value is known and the condition does not hold for all of it.
    """
    for leaf in jax.tree.leaves(value):
        if not isinstance(leaf, Tracer):
            array = np.asarray(leaf)
            require(bool(np.all(np.isfinite(array)) and np.all(holds(array))), message.format(leaf))
