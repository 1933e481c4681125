"""Checks that records and likelihood belong to an estimate, before any computation."""

from collections.abc import Sequence

from .._foundation.checks import require
from ..data.record import Record
from ..estimation.estimate import as_stack, check_channels
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.result import Estimate


def stack_of_estimate(
    estimate: Estimate, records: Record | Sequence[Record], likelihood: AbstractLikelihood
) -> Record:
    """Return the records of an estimate as a stack.

    Args:
        estimate: from `estimate`, of one case.
        records, likelihood: as in the estimate.

    Raises:
        InputError: for records with other channels than the model, and for a likelihood whose noise
            parameters the estimate does not have.
    """
    records = as_stack(records)
    check_channels(estimate.model, records)
    prepared, _ = likelihood.prepared(estimate.model, estimate.free, records)
    require(
        type(prepared) is type(estimate.model),
        f"The estimate has no noise parameters of {type(likelihood).__name__}. Give the likelihood "
        "with which it was estimated.",
    )
    return records
