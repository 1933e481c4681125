"""Choice between one program for all sets of effects and one for each."""

import jax
import jax.numpy as jnp

from ..effects.augmented import Augmented
from ..models.base import AbstractModel
from ..simulation.steppers import rate

# Measured: cost of compiling a fit, in operations that the 24 passes of a refit do per sample:
# 3 s and 10 ms per operation of its model, at 0.3 us per operation and sample (0.15 to 0.6), on
# two cores, for models of 6 to 1,435 operations.
COMPILE_COST, COMPILE_COST_PER_OPERATION = 400_000, 1400


def use_reduced_model(model: Augmented, samples: int) -> bool:
    """True if each set of effects is fitted faster by a program of its own than by the program of
    the complete library.

    The program of the complete library is compiled once, and skips absent effects by a branch for
    each group of them. Separate programs are faster if

        samples * (operations with all effects absent - operations of the declared model)
            > COMPILE_COST + COMPILE_COST_PER_OPERATION * (operations of the declared model)

    in operations of the right-hand side; the right side of the inequality is the cost of compiling
    a separate program. This holds for a small model on long records, and not for an aircraft, whose
    declared equations are most of the work.

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
    """Return the number of elementary operations in a model's right-hand side, where a branch
    counts as one.

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
