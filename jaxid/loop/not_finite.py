"""Refusal of candidates whose derivative at zero gain is not finite.

Forward derivatives carry every tangent through every effect: an infinite slope times the zero of a
tangent that does not concern it is not a number, and spoils all columns.
"""

import dataclasses

import numpy as np

from .._foundation.checks import InputError
from .fit import LoopFit


def check_finite(declared: LoopFit) -> None:
    """Refuse a library without any finite column, and name the candidates that spoil it.

    Args:
        declared: fit of the declared model.

    Raises:
        InputError: if no candidate has a finite sensitivity.
    """
    problem = declared.problem
    if not problem.effects or bool(np.any(np.asarray(declared.motion.sensitivities[1]))):
        return
    names = " and of ".join(map(repr, _spoiling(declared, tuple(problem.effects))))
    raise InputError(
        f"On the training records the derivative at zero gain of {names} is not finite, so that "
        "no other candidate can be scored. "
        "Keep it finite (a root of zero needs a floor), or leave the candidate out."
    )


def _spoiling(declared: LoopFit, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the candidates among `names` whose derivative is not finite."""
    problem, own = declared.problem, len(declared.problem.free.per_record)
    library = tuple(problem.effects[name] for name in names)
    alone = dataclasses.replace(problem, library=library, excluded=frozenset())
    S = dataclasses.replace(declared, problem=alone).motion.sensitivities[1]
    if bool(np.any(np.asarray(S)[..., own:])):
        return ()
    half = len(names) // 2
    return _spoiling(declared, names[:half]) + _spoiling(declared, names[half:]) if half else names
