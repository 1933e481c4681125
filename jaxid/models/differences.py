"""What the equations of a model know of each signal: not at all, or by its difference from another one.

What acts between two parts (a spring, heat, a flow) is a function of the difference of two states.
"""

from collections.abc import Iterable, Mapping
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Bool
from .base import AbstractModel, equations_of, right_hand_sides
from .names import flatten

ARBITRARY = 3  # points at which a model is asked: an accident at one of them is none at the others
ROUNDING = 1e-9  # of a slope: two that add up to less are opposite
Signal = TypeVar("Signal", Array, np.ndarray)  # at an instant, or all its samples


def with_differences(signals: Mapping[str, Signal], names: Iterable[str]) -> dict[str, Signal]:
    """Signals, and those of the named ones that are differences `a-b` of two of them."""
    found = dict(signals)
    for name in names:
        first, _, second = name.partition("-")
        if name not in signals and first in signals and second in signals:
            found[name] = signals[first] - signals[second]
    return found


def differences(model: AbstractModel, equations: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Differences of states and inputs on which equations of a model depend, and the equations that depend on both signals.

    An equation knows two signals by their difference only where its slopes in them are opposite, whatever the parameters, the
    states and the inputs are; that is asked at three arbitrary points.

    Args:
        model: the declared model.
        equations: states whose equations are asked.

    Returns:
        Equations by name of the difference, such as `{"T-outside": ("T",)}`.
    """
    if not equations:
        return {}
    channels, rows = model.states + model.inputs, [equations_of(model).index(name) for name in equations]
    opposite, depends = (np.asarray(one)[rows] for one in _slopes(model))
    pairs = [(a, b) for a in range(len(channels)) for b in range(a + 1, len(channels)) if opposite[:, a, b].any()]
    return {
        f"{channels[a]}-{channels[b]}": tuple(
            state for state, row in zip(equations, depends, strict=True) if row[a] and row[b]
        )
        for a, b in pairs
    }


def absent_signals(model: AbstractModel, equations: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """States and inputs on which an equation of a model does not depend.

    Args:
        model: the declared model.
        equations: states whose equations are asked.

    Returns:
        Signals by equation, such as `{"v": ("T",)}`.
    """
    if not equations:
        return {}
    channels, depends = model.states + model.inputs, np.asarray(_slopes(model)[1])
    return {
        state: tuple(
            name for name, one in zip(channels, depends[equations_of(model).index(state)], strict=True) if not one
        )
        for state in equations
    }


@eqx.filter_jit
def _slopes(model: AbstractModel) -> tuple[Bool[Array, "state channel channel"], Bool[Array, "state channel"]]:
    """Which slopes of the rates in states and inputs are opposite, and which there are, at all of some arbitrary points."""
    vector, unflatten = flatten(model)
    count = len(model.states) + len(model.inputs)

    def at(key):
        of_values, of_point = jax.random.split(key)
        other = unflatten(vector * jax.random.uniform(of_values, vector.shape, minval=0.8, maxval=1.2))
        point = jax.random.uniform(of_point, (count,), minval=0.5, maxval=1.5)
        return jax.jacfwd(lambda xu: right_hand_sides(other, jnp.zeros(()), *jnp.split(xu, [len(model.states)])))(point)

    slopes = jax.vmap(at)(jax.random.split(jax.random.key(0), ARBITRARY))
    depends = slopes != 0
    left = jnp.abs(slopes[..., None] + slopes[..., None, :])
    opposite = depends[..., None] & (left <= ROUNDING * jnp.abs(slopes[..., None]))
    return jnp.all(opposite, axis=0), jnp.all(depends, axis=0)
