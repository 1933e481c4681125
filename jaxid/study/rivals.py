"""Effects that the records cannot tell from the one that was named, and how well another record
would.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp

from .._foundation.checks import require
from ..data.record import Record
from ..diagnosis.scores import sensitivities, unexplained_chi_square, whitened
from ..estimation.estimate import as_stack, check_channels, check_sampling
from ..estimation.problem import Problem
from ..models.free import Free, initial_parameters
from ..models.noise import FixedNoise
from .study import Study


def discrimination(study: Study, plan: Record) -> dict[str, float]:
    r"""Chi-square by which a planned record would tell each rival from what was named; 6 and more
    is a decision.

        chi-square = min over the rival's parameters of sum_i (y_i - y_rival,i)' R^-1 (y_i -
        y_rival,i)

    by its linear model about the estimate, with y as the named model says and R of `study.noise`.
    An input that makes the smallest of them large is one to fly next.

    Args:
        study: with alternatives.
        plan: time, inputs and, for the initial state, its first outputs; the other outputs are not
            looked at.

    Returns:
        Chi-squares by name of the rival. (T-optimality: Atkinson & Fedorov, Biometrika 62, 1975,
        pp. 57-70.)

    Raises:
        InputError: when the study has no alternatives, or the plan other channels than its records.
    """
    require(
        len(study.alternatives) > 0,
        "The study has no alternatives: there is nothing to distinguish.",
    )
    plan = as_stack(plan)
    check_channels(study.after.model, plan)
    check_sampling(study.after.model, plan, study.likelihood)
    noise = FixedNoise(jnp.array([study.noise[name] ** 2 for name in study.outputs]))
    likelihood = dataclasses.replace(study.likelihood, noise=noise)

    def problem_of(model, free, records):
        problem = Problem.of(model, free, records, likelihood)
        return problem, initial_parameters(problem.model, problem.positions, problem.records)

    named, begin = problem_of(
        study.after.model, Free((), study.after.estimate.free.per_record), plan
    )
    expected = eqx.tree_at(
        lambda one: one.z, plan, jnp.where(plan.mask, named.outputs(begin), plan.z)
    )
    found = {}
    for rival in study.alternatives:
        problem, begin = problem_of(rival.model, rival.free, expected)
        left = float(
            unexplained_chi_square(
                *whitened(problem, *sensitivities(problem, begin)), len(rival.free.shared)
            )
        )
        # one may stand in the place of several
        found[rival.name] = min(left, found.get(rival.name, left))
    return found
