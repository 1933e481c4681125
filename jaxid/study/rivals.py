"""Effects that the records cannot tell from the one that was named, and how well another record
would.
"""

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
    """Return the chi-square by which a planned record would separate each rival from the model
    found; 6 and more decides.

    It is `expected_chi_square` with R of `study.noise`. An input that makes the smallest of them
    large is one to fly next.

    Args:
        study: with alternatives.
        plan: time, inputs and, for the initial state, its first outputs; the other outputs are not
            looked at. A record or a stack.

    Returns:
        Chi-squares by name of the rival.

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
    named = study.after.model, Free(())  # nothing of it is refitted
    found = {}
    for rival in study.alternatives:
        left = sum(
            expected_chi_square(named, (rival.model, rival.free), record, likelihood)
            for record in unstack(plan)
        )
        # one may stand in the place of several
        found[rival.name] = min(left, found.get(rival.name, left))
    return found
