"""Caveats of a study: test records that are predicted worse with the added effects."""

from collections.abc import Mapping

from ..data.record import Record
from ..loop.assess import Assessment, Check
from ..loop.wording import held_out_words
from .study import Side
from .study_records import TEST_BEYOND, channels_beyond

# Chosen: share by which an output's error must grow to be named.
NAMED_GROWTH = 0.01


def caveats(
    assessment: Assessment, before: Side, after: Side, tests: Mapping[str, Record], used: Record
) -> list[str]:
    """Return a sentence for each set of test records to which the verdict objects, with the outputs
    whose error grows and the channels that leave their range.

    Args:
        assessment: the verdict.
        before, after: the model without the added effects and with them.
        tests: records by name of set.
        used: the records that were fitted.
    """
    grown = {
        name: [
            n
            for n, rms in after.rms[name].items()
            if rms > (1.0 + NAMED_GROWTH) * before.rms[name][n]
        ]
        for objection in assessment.objections
        if objection.check is Check.CARRIES_OVER
        for name in objection.names
    }
    words = (
        held_out_words(name, worse, channels_beyond(used, tests[name], TEST_BEYOND))
        for name, worse in grown.items()
    )
    return [sentence for sentence in words if sentence]
