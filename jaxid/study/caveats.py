"""Caveats of a study: test records that are predicted worse, check records beyond the range."""

from ..loop.assess import Assessment, Check
from ..loop.outcome import Outcome
from ..loop.wording import check_words, held_out_words
from .study import Side
from .study_records import TEST_BEYOND, StudyRecords, channels_beyond

# Chosen: share by which an output's error must grow to be named.
NAMED_GROWTH = 0.01


def caveats(assessment: Assessment, before: Side, after: Side, records: StudyRecords) -> list[str]:
    """Return a sentence for each set of test records to which the verdict objects, with the outputs
    whose error grows and the channels that leave their range; and without a cause one on check
    records beyond the range of the fitted ones.

    Args:
        assessment: the verdict.
        before, after: the model without the added effects and with them.
        records: training, check and test records.
    """
    worse = (
        name
        for objection in assessment.objections
        if objection.check is Check.CARRIES_OVER
        for name in objection.names
    )
    words = [_about_test(name, before, after, records) for name in worse]
    if records.beyond and assessment.outcome is not Outcome.EXPLAINED:
        words.append(check_words(records.beyond))
    return [sentence for sentence in words if sentence]


def _about_test(name: str, before: Side, after: Side, records: StudyRecords) -> str:
    """Return the sentence on one set of test records; may be empty."""
    old, new = before.rms[name], after.rms[name]
    grown = [channel for channel, rms in new.items() if rms > (1.0 + NAMED_GROWTH) * old[channel]]
    beyond = channels_beyond(records.used, records.tests[name], TEST_BEYOND)
    return held_out_words(name, grown, beyond)
