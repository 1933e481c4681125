"""Structural dependence of the results of a function on its arguments."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
from jax.extend.core import Jaxpr, Literal

# Parameter of an equation that holds the program of a called function, by name of the primitive.
CALLS = {"jit": "jaxpr", "pjit": "jaxpr", "closed_call": "call_jaxpr", "core_call": "call_jaxpr"}


def depends_on(function: Callable[..., Any], arguments: Sequence[Any]) -> tuple[bool, ...]:
    """Return for each argument whether the function's results can depend on its arrays.

    The operations of the traced function are followed from the arguments to the results. Loops and
    branches count as one operation, whose results depend on everything that enters it: the answer
    can be true without need, and is never false without reason.

    Args:
        function: a function of the arguments that JAX can trace.
        arguments: trees of arrays.
    """
    program = jax.make_jaxpr(function)(*arguments).jaxpr
    sets, number = [], 0
    for argument in arguments:
        count = len(jax.tree.leaves(argument))
        sets.append(set(range(number, number + count)))
        number += count
    reached = set().union(*_sources(program, [{index} for index in range(number)]))
    return tuple(bool(indices & reached) for indices in sets)


def _sources(program: Jaxpr, inputs: Sequence[set[int]]) -> list[set[int]]:
    """Return for each result of a program the inputs on which it depends."""
    known = dict(zip(program.invars, inputs, strict=True))

    def of(variable) -> set[int]:
        return set() if isinstance(variable, Literal) else known.get(variable, set())

    for operation in program.eqns:
        sources = [of(variable) for variable in operation.invars]
        inner = operation.params.get(CALLS.get(operation.primitive.name, ""))
        if inner is None:
            results = [set().union(*sources)] * len(operation.outvars)
        else:
            results = _sources(getattr(inner, "jaxpr", inner), sources)
        known.update(zip(operation.outvars, results, strict=True))
    return [of(variable) for variable in program.outvars]


def returns_argument(function: Callable[[Any], Any], argument: Any) -> bool:
    """Return True if the traced function returns its only argument unchanged."""
    program = jax.make_jaxpr(function)(argument).jaxpr
    return program.outvars == program.invars
