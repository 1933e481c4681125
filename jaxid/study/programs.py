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
from ..models.free import Parameters
from ..models.names import flatten


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
