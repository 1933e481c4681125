"""Caveats of a study: test records that are predicted worse with the added effects."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np

from ..data.record import Record
from ..diagnosis.heldout_error import difference_error, mean_log
from ..loop.wording import worse_words
from .study import Side

# Chosen: share of an input's range by which a test record must exceed it to be named.
BEYOND_SHARE = 0.1


def caveats(
    before: Side, after: Side, tests: Mapping[str, Record], used: Record
) -> tuple[str, ...]:
    """Return a sentence for each set of test records whose error grows by more than its standard
    error.

    Args:
        before, after: the model without the added effects and with them.
        tests: records by name of set.
        used: the records that were fitted.
    """
    sentences = []
    for name, old in before.tests.items():
        new = after.tests[name]
        if mean_log(new) - mean_log(old) > difference_error(old, new):
            channels = [n for n, rms in after.rms[name].items() if rms > before.rms[name][n]]
            sentences.append(worse_words(name, channels, inputs_beyond(used, tests[name])))
    return tuple(sentences)


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
