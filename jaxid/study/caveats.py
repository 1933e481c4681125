"""Caveats of a study: test records that are predicted worse with the added effects."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np

from ..data.record import Record
from ..loop.assess import Assessment, Check
from ..loop.wording import held_out_words
from .study import Side

# Chosen: share of an input's range by which a test record must exceed it to be named.
BEYOND_SHARE = 0.1


def caveats(
    assessment: Assessment, before: Side, after: Side, tests: Mapping[str, Record], used: Record
) -> list[str]:
    """Return a sentence for each set of test records to which the verdict objects, with the outputs
    whose error grows and the inputs that leave their range.

    Args:
        assessment: the verdict.
        before, after: the model without the added effects and with them.
        tests: records by name of set.
        used: the records that were fitted.
    """
    grown = {
        name: [n for n, rms in after.rms[name].items() if rms > before.rms[name][n]]
        for objection in assessment.objections
        if objection.check is Check.CARRIES_OVER
        for name in objection.names
    }
    words = (
        held_out_words(name, worse, inputs_beyond(used, tests[name]))
        for name, worse in grown.items()
    )
    return [sentence for sentence in words if sentence]


def inputs_beyond(used: Record, test: Record) -> tuple[str, ...]:
    """Return the inputs that leave the range of the fitted records by more than a tenth of it.

    Args:
        used: the records that were fitted.
        test: other records.
    """
    low, high = jnp.min(used.u, axis=(0, 1)), jnp.max(used.u, axis=(0, 1))
    beyond = jnp.maximum(low - jnp.min(test.u, axis=(0, 1)), jnp.max(test.u, axis=(0, 1)) - high)
    far = np.asarray(beyond > BEYOND_SHARE * (high - low))
    return tuple(name for name, is_far in zip(used.inputs, far, strict=True) if is_far)
