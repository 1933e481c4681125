"""Signals of a fit, and the choice between one program for all sets of effects and one for each."""

import jax
import jax.numpy as jnp

from .._foundation.compiler import fast_compile_jit
from .._foundation.types import Array, Bool
from ..effects.augmented import Augmented
from ..effects.shape_initialisation import RECORD
from ..estimation.problem import Problem
from ..models.base import AbstractModel
from ..models.free import Parameters
from ..simulation.steppers import rate
from .thresholds import COMPILE_COST, COMPILE_COST_PER_OPERATION


def use_reduced_model(model: Augmented, samples: int) -> bool:
    """True if each set of effects is fitted faster by a program of its own than by the program of
    the complete library.

    The program of the complete library is compiled once, but evaluates every absent effect in each
    of its passes. Separate programs are faster if

        samples * (operations of the library)
            > COMPILE_COST + COMPILE_COST_PER_OPERATION * (operations of the declared model)

    in operations of the right-hand side; the right side of the inequality is the cost of compiling
    a separate program. This holds for a small model with many candidates and long records, and not
    for an aircraft, whose declared equations are most of the work.

    Args:
        model: the declared model with the complete library.
        samples: number of samples of a record.
    """
    declared = operations(model.model)
    return (
        samples * (operations(model) - declared)
        > COMPILE_COST + COMPILE_COST_PER_OPERATION * declared
    )


def operations(model: AbstractModel) -> int:
    """Return the number of elementary operations in a model's right-hand side.

    Every later program reuses the trace made here.
    """
    t, x, u = jnp.zeros(()), jnp.zeros(len(model.states)), jnp.zeros(len(model.inputs))
    return _count(jax.make_jaxpr(lambda *instant: rate(model, *instant))(t, x, u).jaxpr)


def _count(program) -> int:
    inner = [
        [getattr(value, "jaxpr", value) for value in equation.params.values()]
        for equation in program.eqns
    ]
    called = [[part for part in parts if hasattr(part, "eqns")] for parts in inner]
    return sum(sum(map(_count, parts)) if parts else 1 for parts in called)


@fast_compile_jit
def signals_of(
    problem: Problem, parameters: Parameters
) -> tuple[dict[str, Array], Bool[Array, "case time"]]:
    """Return every signal of the model at every sample, with time and record number, and a mask of
    the samples that are not padding.
    """

    def of_one(own, case, number):
        solution, model = problem.solve_one(own, parameters.shared, case)
        when = {"t": solution.t, RECORD: jnp.full_like(solution.t, number)}
        return when | jax.vmap(model.signals)(solution.t, solution.x, case[1].u)

    signals = jax.vmap(of_one)(
        parameters.rows, problem.cases(), jnp.arange(problem.records.n_cases)
    )
    moving = jnp.diff(problem.records.t, axis=1) > 0
    return signals, jnp.concatenate([jnp.ones((moving.shape[0], 1), bool), moving], axis=1)
