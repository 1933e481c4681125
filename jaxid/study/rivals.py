"""Effects that the records cannot tell from the one that was named, and how well another record would."""

import dataclasses
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp

from .._foundation.checks import require
from ..data.record import Record
from ..diagnosis.scores import left_over, sensitivities, whitened
from ..estimation.estimate import as_stack, check_channels
from ..estimation.problem import Problem
from ..models.base import AbstractModel
from ..models.free import Free, start
from ..models.noise import FixedNoise

if TYPE_CHECKING:
    from .study import Study


@dataclasses.dataclass(frozen=True)
class Rival:
    """An effect that does as well as one that was added.

    Attributes:
        name, sentence: what it is.
        instead_of: names of the effects in whose place it stands.
        chi_square: by how much worse the training records are fitted with it.
        model: with it in their place, and its own estimated values.
        free: what was estimated.
    """

    name: str
    sentence: str
    instead_of: tuple[str, ...]
    chi_square: float
    model: AbstractModel
    free: Free


def told_apart(study: "Study", plan: Record) -> dict[str, float]:
    r"""Chi-square by which a planned record would tell each rival from what was named; 6 and more is a decision.

        chi-square = min over the rival's parameters of sum_i (y_i - y_rival,i)' R^-1 (y_i - y_rival,i)

    by its linear model about the estimate, with y as the named model says and R of `study.noise`. An input that makes the
    smallest of them large is one to fly next.

    Args:
        study: with rivals.
        plan: time, inputs and, for the initial state, its first outputs; the other outputs are not looked at.

    Returns:
        Chi-squares by name of the rival. (T-optimality: Atkinson & Fedorov, Biometrika 62, 1975, pp. 57-70.)

    Raises:
        InputError: when the study has no rivals, or the plan other channels than its records.
    """
    require(len(study.rivals) > 0, "The study has no rivals: there is nothing to tell apart.")
    plan = as_stack(plan)
    check_channels(study.after.model, plan)
    noise = FixedNoise(jnp.array([study.noise[name] ** 2 for name in study.outputs]))
    likelihood = dataclasses.replace(study.likelihood, noise=noise)

    def problem_of(model, free, records):
        problem = Problem.of(model, free, records, likelihood)
        return problem, start(problem.model, problem.positions, problem.records)

    named, begin = problem_of(study.after.model, Free((), study.after.estimate.free.per_record), plan)
    expected = eqx.tree_at(lambda one: one.z, plan, jnp.where(plan.mask, named.outputs(begin), plan.z))
    found = {}
    for rival in study.rivals:
        problem, begin = problem_of(rival.model, rival.free, expected)
        left = float(left_over(*whitened(problem, *sensitivities(problem, begin)), len(rival.free.shared)))
        found[rival.name] = min(left, found.get(rival.name, left))  # one may stand in the place of several
    return found
