"""The small programs of a workbench, and how its large ones are compiled together."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.types import Array, Bool, Float, Int
from ..estimation.problem import Problem
from ..models.augmented import Augmented
from ..models.base import AbstractModel
from ..models.free import Parameters
from ..models.names import flatten
from ..simulation.steppers import rate

# What a fit costs to compile, in operations that the 24 passes of a refit carry through one sample: 3 s and 10 ms for each
# operation of its model, at 0.3 us an operation and sample (0.15 to 0.6); on two cores, models of 6 to 1,435 operations.
COMPILED, COMPILED_EACH = 400_000, 1400


def compile_together(programs: Sequence[tuple[Any, tuple]]) -> None:
    """Compile programs side by side, each for its arguments, so that calling them with such does not.

    XLA compiles one program on little more than one core, and outside of Python's lock. Programs that run beside each other could
    lock up on few cores; these only come into being.

    Args:
        programs: functions under `eqx.filter_jit`, with what they are going to be called with.
    """
    with ThreadPoolExecutor() as beside:
        for done in [beside.submit(program.lower(*arguments).compile) for program, arguments in programs]:
            done.result()


def pays_to_compile(model: Augmented, samples: int) -> bool:
    """Whether every set of effects is better fitted by a program of its own than by one for the whole library.

    One program for all is compiled once, and carries every effect that is absent through each of its passes:

        samples * (operations of the library)  >  COMPILED + COMPILED_EACH * (operations of the declared model)

    in operations of the right-hand side; the right side is what a program of its own costs to compile. It pays for a small model
    with many candidates and long records, and not for an aircraft, whose own equations are most of the work.

    Args:
        model: the declared model with the whole library.
        samples: of a record.
    """
    declared = operations(model.model)
    return samples * (operations(model) - declared) > COMPILED + COMPILED_EACH * declared


def operations(model: AbstractModel) -> int:
    """Number of elementary operations in a model's right-hand side; its trace is the one that every program then takes."""
    t, x, u = jnp.zeros(()), jnp.zeros(len(model.states)), jnp.zeros(len(model.inputs))
    return _count(jax.make_jaxpr(lambda *instant: rate(model, *instant))(t, x, u).jaxpr)


def _count(program) -> int:
    inner = [[getattr(one, "jaxpr", one) for one in equation.params.values()] for equation in program.eqns]
    called = [[one for one in parts if hasattr(one, "eqns")] for parts in inner]
    return sum(sum(map(_count, parts)) if parts else 1 for parts in called)


@eqx.filter_jit
def placed(model: Augmented, at: Int[Array, " column"], values: Float[Array, " column"]) -> Augmented:
    """A model with values at positions of its flat vector; compiled, as it is asked for before each program runs."""
    vector, unflatten = flatten(model)
    return unflatten(vector.at[at].set(values))


@eqx.filter_jit
def signals_of(problem: Problem, parameters: Parameters) -> tuple[dict[str, Array], Bool[Array, "case time"]]:
    """Every signal of the model at every sample, the time with them, and which samples are real time."""
    solutions = problem.solve(parameters)
    signals = jax.vmap(jax.vmap(problem.model.signals))(solutions.t, solutions.x, problem.records.u)
    signals = {"t": solutions.t} | signals
    moving = jnp.diff(problem.records.t, axis=1) > 0
    return signals, jnp.concatenate([jnp.ones((moving.shape[0], 1), bool), moving], axis=1)
