"""`StudyRecords`: the training, check and test records of a study."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require
from ..data.record import Record
from ..data.stack import split_at, stack, unstack
from ..estimation.estimate import as_stack

Records = Record | Sequence[Record]


class StudyRecords(NamedTuple):
    """The records of a study.

    Attributes:
        fitted: training records of the search, a stack.
        complete: the complete training records, if their last third is the check; else None.
        check: records that decide, a stack.
        tests: records that are reported, by name.
        own_tests: False if the check records are reported.
    """

    fitted: Record
    complete: Record | None
    check: Record
    tests: dict[str, Record]
    own_tests: bool

    @property
    def used(self) -> Record:
        """Records of the final estimate."""
        return self.fitted if self.complete is None else self.complete


def study_records(
    train: Records,
    check: Records | None,
    test: Records | Mapping[str, Records] | None,
    window: int | None,
) -> StudyRecords:
    """Return the records as stacks; without check records the training records are cut.

    Args:
        train, check, test, window: arguments of `close_loop`.
    """
    fitted, complete = as_stack(train), None
    if check is None:
        complete = fitted
        fitted, check = _cut_last_third(fitted, window)
    check = as_stack(check)
    tests = _tests(test, check)
    if test is not None:
        for name, stacked in tests.items():
            _require_apart(fitted if complete is None else complete, stacked, name)
    return StudyRecords(fitted, complete, check, tests, test is not None)


def _require_apart(train: Record, test: Record, name: str) -> None:
    """Refuse a test record that is a training record: its error is no error of prediction."""
    fitted = {_samples(record): record.names[0] for record in unstack(train)}
    for record in unstack(test):
        same = fitted.get(_samples(record))
        require(
            same is None,
            f"The record {record.names[0]!r} of the test set {name!r} is a training record, "
            f"{same!r}. Give `test` records that are not used for fitting, or leave it out.",
        )


def _samples(record: Record) -> tuple[bytes, ...]:
    """Return the samples of a record, equal for equal records."""
    parts = (record.t, record.u, record.z, record.mask)
    return tuple(np.asarray(part).tobytes() for part in parts)


def _tests(test, check: Record) -> dict[str, Record]:
    """Return the sets of records to report, by name."""
    if test is None:
        return {"check": check}
    if isinstance(test, Mapping):
        require(
            len(test) > 0, "`test` is empty. Give at least one set of records, or leave it out."
        )
        return {name: as_stack(records) for name, records in test.items()}
    return {"test": as_stack(test)}


def _cut_last_third(train: Record, window: int | None) -> tuple[Record, Record]:
    """Return the first two thirds of each record, and the records with their last third valid.

    The check starts at the start of the record, so that it needs no initial state in the middle of
    a motion.
    """
    records = unstack(train)
    ends = [round(2 / 3 * record.t.shape[0]) for record in records]
    first = stack([split_at(record, end)[0] for record, end in zip(records, ends, strict=True)])
    row = jnp.arange(train.t.shape[1])[None]
    kept = (row >= jnp.array(ends)[:, None]) | (row < (window or 0))
    return first, eqx.tree_at(lambda record: record.mask, train, train.mask & kept[..., None])
