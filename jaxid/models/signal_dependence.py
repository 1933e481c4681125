"""Dependence of the equations of a model on each signal: none, or by a difference of two signals.

Interactions of two parts (a spring, heat, a flow) are functions of the difference of two states.
"""

import itertools
from collections.abc import Collection, Iterable, Mapping
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.compiler import fast_compile_jit
from .._foundation.types import Array, Bool
from .base import AbstractModel, equations_of, right_hand_sides
from .names import flatten, parameter_names

RANDOM_POINTS = (
    3  # random points of evaluation (chosen): an accidental equality at all is improbable
)
OPPOSITE_RTOL = (
    1e-9  # relative sum of two slopes that counts as zero (chosen, above rounding errors)
)
Signal = TypeVar("Signal", Array, np.ndarray)  # at an instant, or a time history


def with_differences(signals: Mapping[str, Signal], names: Iterable[str]) -> dict[str, Signal]:
    """Return the signals, and the named differences `a-b` of two of them."""
    extended = dict(signals)
    for name in names:
        first, _, second = name.partition("-")
        if name not in signals and first in signals and second in signals:
            extended[name] = signals[first] - signals[second]
    return extended


def differences(
    model: AbstractModel, equations: tuple[str, ...], free: Collection[str] = ()
) -> dict[str, tuple[str, ...]]:
    """Return the differences of states and inputs on which equations of a model depend, with the
    equations that depend on both signals.

    An equation depends on two signals only by their difference if its slopes in them are opposite
    for all parameters, states and inputs. This is tested at three random points. A parameter that
    is zero and not free stays zero.

    Args:
        model: the declared model.
        equations: states whose equations are tested.
        free: names of the free parameters.

    Returns:
        Equations by name of the difference, such as `{"T-outside": ("T",)}`.
    """
    if not equations:
        return {}
    channels = model.states + model.inputs
    rows = [equations_of(model).index(name) for name in equations]
    opposite, depends = (np.asarray(array)[rows] for array in _all_slopes(model, free))
    in_any_equation = np.asarray(np.any(opposite, axis=0))
    pairs = itertools.combinations(range(len(channels)), 2)
    pairs = [(a, b) for a, b in pairs if in_any_equation[a, b]]
    return {
        f"{channels[a]}-{channels[b]}": tuple(
            state for state, row in zip(equations, depends, strict=True) if row[a] and row[b]
        )
        for a, b in pairs
    }


def absent_signals(
    model: AbstractModel, equations: tuple[str, ...], free: Collection[str] = ()
) -> dict[str, tuple[str, ...]]:
    """Return the states and inputs on which each equation of a model does not depend.

    An equation depends on a signal whose coefficient is a free parameter that begins at zero.

    Args:
        model: the declared model.
        equations: states whose equations are tested.
        free: names of the free parameters.

    Returns:
        Signals by equation, such as `{"v": ("T",)}`.
    """
    if not equations:
        return {}
    channels, depends = model.states + model.inputs, np.asarray(_all_slopes(model, free)[1])
    return {
        state: tuple(
            name
            for name, used in zip(channels, depends[equations_of(model).index(state)], strict=True)
            if not used
        )
        for state in equations
    }


def _all_slopes(model: AbstractModel, free: Collection[str]):
    """Return the slopes (`_slopes`) of a model with the named free parameters."""
    return _slopes(model, np.array([name in free for name in parameter_names(model)], bool))


@fast_compile_jit
def _slopes(
    model: AbstractModel, free: Bool[Array, " parameter"]
) -> tuple[Bool[Array, "state channel channel"], Bool[Array, "state channel"]]:
    """Pairs of opposite slopes, and slopes that are not zero, at all of some random points.

    A slope is the derivative of an equation by a state or input.
    """
    vector, unflatten = flatten(model)
    sizes = jnp.where(free & (vector == 0), 1.0, vector)
    count = len(model.states) + len(model.inputs)

    def slopes_at(key):
        value_key, point_key = jax.random.split(key)
        other = unflatten(
            sizes * jax.random.uniform(value_key, vector.shape, minval=0.8, maxval=1.2)
        )
        point = jax.random.uniform(point_key, (count,), minval=0.5, maxval=1.5)
        return jax.jacfwd(
            lambda xu: right_hand_sides(other, jnp.zeros(()), *jnp.split(xu, [len(model.states)]))
        )(point)

    slopes = jax.vmap(slopes_at)(jax.random.split(jax.random.key(0), RANDOM_POINTS))
    depends = slopes != 0
    sums = jnp.abs(slopes[..., None] + slopes[..., None, :])
    opposite = depends[..., None] & (sums <= OPPOSITE_RTOL * jnp.abs(slopes[..., None]))
    return jnp.all(opposite, axis=0), jnp.all(depends, axis=0)
