"""Who is to blame where sensitivities are not finite: a candidate whose slope at zero gain is
infinite spoils all others.

Forward derivatives carry every tangent through every effect: an infinite slope times the zero of a
tangent that does not concern it is not a number.
"""

import jax.numpy as jnp

from .._foundation.checks import InputError
from ..diagnosis.scores import sensitivities
from ..effects.augmented import Augmented
from ..estimation.problem import Problem
from ..models.free import Free, Parameters, initial_parameters
from .fit import Fitted
from .workbench import Workbench


def refusal(bench: Workbench, declared: Fitted) -> InputError:
    """The error to raise where no candidate has a finite sensitivity, which names those that spoil
    the others'.

    Args:
        bench: with the library.
        declared: the declared model's fit.
    """
    model, free = bench.model_and_free(declared)

    def spoiled(names: tuple[str, ...]) -> bool:
        augmented = Augmented(model, tuple(bench.effects[name] for name in names))
        columns = tuple(bench.columns.names[column] for column in bench.columns.chosen(names))
        asked = Free(columns, free.per_record)
        problem = Problem.of(augmented, asked, bench.records, bench.likelihood)
        begin = initial_parameters(problem.model, problem.positions, problem.records)
        _, S = sensitivities(problem, Parameters(begin.shared, declared.fit.parameters.rows))
        return not bool(jnp.all(jnp.isfinite(S)))

    def guilty(names: tuple[str, ...]) -> tuple[str, ...]:
        if not spoiled(names):
            return ()
        half = len(names) // 2
        return guilty(names[:half]) + guilty(names[half:]) if half else names

    names = " and of ".join(map(repr, guilty(tuple(bench.effects))))
    return InputError(
        f"On the training records the derivative at zero gain of {names} is not finite, so that "
        "nothing can be scored beside it. "
        "Keep it finite (a root of zero needs a floor), or leave the candidate out."
    )
