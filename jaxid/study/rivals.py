"""`discrimination`: how well a planned record would separate the alternatives of a study."""

import dataclasses

import jax.numpy as jnp

from .._foundation.checks import require
from ..data.record import Record
from ..data.stack import unstack
from ..design.explanations import expected_chi_square
from ..estimation.estimate import as_stack, check_channels, check_sampling
from ..models.free import Free
from ..models.noise import FixedNoise
from .study import Study


def discrimination(study: Study, plan: Record) -> dict[str, float]:
    """Return the chi-square by which each alternative would fit a planned record worse than the
    study's model.

    It is `expected_chi_square` with R of `study.noise`; 6 and more decides. Fly next an input that
    makes the smallest of them large.

    Args:
        study: a study with alternatives.
        plan: time, inputs and, for the initial state, its first outputs; the other outputs do not
            matter. A record or a stack.

    Returns:
        Chi-squares by name of the alternative.

    Raises:
        InputError: if the study has no alternatives, or the plan other channels than its records.
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
    true = study.after.model, Free(())  # nothing of it is refitted
    worse: dict[str, float] = {}
    for other in study.alternatives:
        chi_square = sum(
            expected_chi_square(true, (other.model, other.free), record, likelihood)
            for record in unstack(plan)
        )
        # an alternative may replace several effects in turn
        worse[other.name] = min(chi_square, worse.get(other.name, chi_square))
    return worse
