"""`StudyRecords`: the training, check and test records of a study."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import numpy as np

from .._foundation.checks import require
from .._foundation.host import to_device
from .._foundation.types import Bool
from ..data.record import Record
from ..data.stack import split_at, stack, unstack
from ..estimation.estimate import as_stack

# Chosen: share of the changing samples of a held-out record above which it is a part of another
# record: repeated flights of a coarse instrument agree in many samples, but not in nearly all.
SAME_ROWS = 0.9
# Chosen: share of a channel's range by which a test or a check record must exceed it to be named.
# Every record of other inputs exceeds it a little.
TEST_BEYOND, CHECK_BEYOND = 0.1, 0.25
Records = Record | Sequence[Record]


class StudyRecords(NamedTuple):
    """The records of a study.

    Attributes:
        fitted: training records of the search, a stack.
        complete: the complete training records, if a third of them is the check; else None.
        check: records that decide, a stack.
        tests: records that are reported, by name.
        has_tests: False if the check records are reported.
        beyond: channels in which the check records exceed the range of the fitted ones.
    """

    fitted: Record
    complete: Record | None
    check: Record
    tests: dict[str, Record]
    has_tests: bool
    beyond: tuple[str, ...]

    @property
    def used(self) -> Record:
        """Records of the final estimate."""
        return self.fitted if self.complete is None else self.complete


def study_records(
    train: Records,
    check: Records | None,
    test: Records | Mapping[str, Records] | None,
    window: int | None,
    *,
    starts_free: bool = False,
) -> StudyRecords:
    """Return the records as stacks; without check records the training records are cut.

    The check is their last third. Where it exceeds the range of the rest and the first third does
    not, it is the first third.

    Args:
        train, check, test, window: arguments of `close_loop`.
        starts_free: True if the initial state of each record is free, so that a fitted record may
            start in motion.
    """
    used = as_stack(train)
    fitted, complete = used, None
    if check is None:
        complete = used
        fitted, check = _cut_last_third(used, window)
        if starts_free and channels_beyond(fitted, check, CHECK_BEYOND):
            others = _cut_first_third(used, window)
            beyond = channels_beyond(*others, CHECK_BEYOND)
            fitted, check = (fitted, check) if beyond else others
    else:
        check = as_stack(check)
        _require_apart(used, check, "check record", "a training record")
    tests = _tests(test, check)
    if test is not None:
        for name, stacked in tests.items():
            _require_apart(used, stacked, f"record of the test set {name!r}", "a training record")
            _require_apart(check, stacked, f"record of the test set {name!r}", "a check record")
    beyond = channels_beyond(fitted, check, CHECK_BEYOND)
    return StudyRecords(fitted, complete, check, tests, test is not None, beyond)


def _require_apart(used: Record, held_out: Record, role: str, other: str) -> None:
    """Refuse a held-out record that has another use, as a whole or in part: its error is no error
    of prediction.
    """
    known = [(record.names[0], _samples(record)) for record in unstack(used)]
    for record in unstack(held_out):
        own = _samples(record)
        same = [name for name, rows in known if len(own & rows) > SAME_ROWS * len(own)]
        require(
            not same,
            f"The {role}, {record.names[0]!r}, is {other} or a part of one as well, "
            f"{', '.join(map(repr, same))}. Give records of no other use, or leave them out.",
        )


def _samples(record: Record) -> set[bytes]:
    """Return the samples of a record with their times, where a channel changes: records of rest
    and of coarse steps agree in the others.
    """
    u, z, mask = (np.asarray(part) for part in (record.u, record.z, record.mask))
    values = np.column_stack([u, np.where(mask, z, 0.0), mask])
    changes = np.any(np.diff(values, axis=0, prepend=np.nan) != 0, axis=1)
    rows = np.column_stack([np.asarray(record.t), values])[changes & mask.any(axis=-1)]
    return {row.tobytes() for row in rows}


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


def channels_beyond(used: Record, other: Record, share: float) -> tuple[str, ...]:
    """Return the inputs and outputs that leave the range of the fitted records.

    Args:
        used: the records that were fitted.
        other: other records; samples without a valid output do not count.
        share: share of the range by which they must leave it.
    """
    (low, high), (lowest, highest) = _range(used), _range(other)
    with np.errstate(invalid="ignore"):  # a channel without a sample has no range
        far = np.maximum(low - lowest, highest - high) > share * (high - low)
    names = (*used.inputs, *used.outputs)
    return tuple(name for name, is_far in zip(names, far, strict=True) if is_far)


def _range(records: Record) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest and the largest valid value of each input and output."""
    mask = np.asarray(records.mask)
    values = np.concatenate([np.asarray(records.u), np.asarray(records.z)], axis=-1)
    rows = np.broadcast_to(np.any(mask, axis=-1, keepdims=True), np.shape(records.u))
    valid = np.concatenate([rows, mask], axis=-1)
    axes = tuple(range(values.ndim - 1))
    return (
        np.min(values, axis=axes, where=valid, initial=np.inf),
        np.max(values, axis=axes, where=valid, initial=-np.inf),
    )


def _cut_last_third(train: Record, window: int | None) -> tuple[Record, Record]:
    """Return the first two thirds of each record, and the records with their last third valid.

    The check starts at the start of the record, so that it needs no initial state in the middle of
    a motion.
    """
    ends = [round(2 / 3 * record.t.shape[0]) for record in unstack(train)]
    row = np.arange(train.t.shape[1])[None]
    kept = (row >= np.array(ends)[:, None]) | (row < (window or 0))
    return _parts(train, ends, 0), _valid(train, kept)


def _cut_first_third(train: Record, window: int | None) -> tuple[Record, Record]:
    """Return the last two thirds of each record, and the records with their first third valid."""
    ends = [round(1 / 3 * record.t.shape[0]) for record in unstack(train)]
    kept = np.arange(train.t.shape[1])[None] < np.maximum(np.array(ends)[:, None], window or 0)
    return _parts(train, ends, 1), _valid(train, kept)


def _parts(train: Record, ends: Sequence[int], part: int) -> Record:
    """Return the first (0) or the second part (1) of each record."""
    cut = zip(unstack(train), ends, strict=True)
    return stack([split_at(record, end)[part] for record, end in cut])


def _valid(train: Record, kept: Bool[np.ndarray, "case time"]) -> Record:
    """Return the records with the valid samples of some rows only, and the first of each output,
    from which the model may read the initial state (`test_check_starts_as_its_record`).
    """
    mask = np.asarray(train.mask)
    first = np.cumsum(mask, axis=1) == 1
    valid = mask & (first | kept[..., None])
    return eqx.tree_at(lambda record: record.mask, train, to_device(valid))
