"""Caveats of a study: test records that are predicted worse, check records beyond the range, and
products and ratios that are determined although their parameters are not.
"""

import itertools
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from ..estimation.result import Estimate
from ..loop.assess import Assessment, Check
from ..loop.evidence import DETERMINED
from ..loop.outcome import Outcome
from ..loop.wording import check_words, held_out_words
from .study import Side
from .study_records import TEST_BEYOND, StudyRecords, channels_beyond
from .wording import combination_words

# Chosen: share by which an output's error must grow to be named.
NAMED_GROWTH = 0.01
# Chosen: share of the relative errors of two parameters that the error of their product or ratio
# has at most where only that is determined.
COMBINED_ERROR = 0.2


class Combination(NamedTuple):
    """A product or ratio of two parameters that is determined although neither of them is.

    Attributes:
        first, second: names of the parameters.
        power: exponent of the second: 1 for a product, -1 for a ratio.
        value, standard_error: estimate of `first * second**power`.
    """

    first: str
    second: str
    power: float
    value: float
    standard_error: float


def caveats(assessment: Assessment, before: Side, after: Side, records: StudyRecords) -> list[str]:
    """Return a sentence for each set of test records to which the verdict objects, with the outputs
    whose error grows and the channels that leave their range; without a cause one on check records
    beyond the range of the fitted ones; and one for each product or ratio that alone is determined.

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
    return [sentence for sentence in (*words, *_about_combinations(before, after)) if sentence]


def _about_test(name: str, before: Side, after: Side, records: StudyRecords) -> str:
    """Return the sentence on one set of test records; may be empty."""
    old, new = before.rms[name], after.rms[name]
    grown = [channel for channel, rms in new.items() if rms > (1.0 + NAMED_GROWTH) * old[channel]]
    beyond = channels_beyond(records.used, records.tests[name], TEST_BEYOND)
    return held_out_words(name, grown, beyond)


def _about_combinations(before: Side, after: Side) -> list[str]:
    """Return a sentence for each combination that alone is determined."""
    added = set(after.estimate.names) - set(before.estimate.names)
    return [combination_words(*one) for one in known_combinations(after.estimate, added)]


def known_combinations(estimate: Estimate, added: Collection[str]) -> list[Combination]:
    """Return the products and ratios that are determined although neither parameter is: a gain and
    a coefficient near zero, or a gain and a short time constant.

        (error/value)^2 = r_a^2 + r_b^2 +- 2 C_ab/(a b)        + for a product, - for a ratio

    Args:
        estimate: joint estimate of all parameters.
        added: names of those that effects added; one of each pair is among them.
    """
    values, combinations = np.asarray(estimate.values), []
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.asarray(estimate.covariance) / np.outer(values, values)
    errors = np.sqrt(np.diagonal(relative))
    unknown = np.flatnonzero(np.isfinite(errors) & (errors * DETERMINED > 1.0))
    for i, j in itertools.combinations(unknown.tolist(), 2):
        names, power = (estimate.names[i], estimate.names[j]), -np.sign(relative[i, j])
        variance = errors[i] ** 2 + errors[j] ** 2 + 2.0 * power * relative[i, j]
        error = np.sqrt(max(variance, 0.0))
        allowed = min(COMBINED_ERROR * min(errors[i], errors[j]), 1.0 / DETERMINED)
        if error < allowed and set(names) & set(added):
            value = values[i] * values[j] ** power
            combinations.append(
                Combination(*names, float(power), float(value), float(abs(value) * error))
            )
    return combinations
