"""Stacks of records of common length, segments of a record, and the division of records into
training, check and test sets.
"""

import dataclasses
import itertools
import math
import operator
from collections.abc import Iterable, Sequence
from typing import NamedTuple, SupportsIndex

import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.host import on_host
from .record import Record, without_initial_state


class Split(NamedTuple):
    """Training, check and test records; no record is in two of the sets.

    Attributes:
        train: records to fit.
        check: records that decide which effects a model keeps.
        test: records that are only reported.
    """

    train: tuple[Record, ...]
    check: tuple[Record, ...]
    test: tuple[Record, ...]


def stack(records: Sequence[Record], pad_to: int | None = None) -> Record:
    """Return single records as one stack, padded to one length.

    Padding rows repeat the last time, so that `diff(t)` is zero, and the last input; their mask is
    False.

    Args:
        records: single records with the same channels, units and names of constants.
        pad_to: number of rows, so that several stacks share one compiled shape; the longest record
            when left out.

    Returns:
        The stack, with axes (case, time).

    Raises:
        InputError: when there is no record, a record is a stack or has other channels, or `pad_to`
            is too short.
    """
    records = tuple(records)
    require(len(records) > 0, "There is no record to stack. Give at least one.")
    first = records[0]
    for i, other in enumerate(records):
        _require_same_layout(first, other, i)
    longest = max(r.t.shape[0] for r in records)
    rows = longest if pad_to is None else pad_to
    require(
        rows >= longest,
        f"`pad_to` is {rows} and the longest record has {longest} samples. Give "
        f"at least {longest}.",
    )
    return _padded_stack(records, rows)


def _padded_stack(records: tuple[Record, ...], rows: int) -> Record:
    """The stack of records with the same layout, padded to a number of rows."""
    first = records[0]
    return Record(
        t=_padded([r.t for r in records], rows=rows, mode="edge"),
        u=_padded([r.u for r in records], rows=rows, mode="edge"),
        z=_padded([r.z for r in records], rows=rows, mode="constant"),
        mask=_padded([r.mask for r in records], rows=rows, mode="constant"),
        constants={key: _stacked([r.constants[key] for r in records]) for key in first.constants},
        inputs=first.inputs,
        outputs=first.outputs,
        input_units=first.input_units,
        output_units=first.output_units,
        names=tuple(r.names[0] for r in records),
    )


def require_single(record: Record, use: str) -> None:
    """Refuse a stack, and several records.

    Args:
        record: the record.
        use: participle for the message, such as "cut".

    Raises:
        InputError: unless it is a single record.
    """
    require(
        isinstance(record, Record) and not record.is_stack,
        f"Only a single record can be {use}, and this is a stack or a list. Take `stack[i]`.",
    )


def unstack(record: Record) -> list[Record]:
    """Return the records of a stack without their padding, the inverse of `stack`.

    A single record gives a list that holds only this record.
    """
    return list(record) if record.is_stack else [record]


def single_records(records: Record | Sequence[Record]) -> list[Record]:
    """Return one record, several records or stacks as a list of single records, without padding."""
    given = [records] if isinstance(records, Record) else records
    return [single for record in given for single in unstack(record)]


def split(
    records: Record | Sequence[Record],
    *,
    train: Iterable[str | int],
    check: Iterable[str | int] = (),
    test: Iterable[str | int] = (),
) -> Split:
    """Divide records into a training, a check and a test set.

    Args:
        records: single records, or a stack.
        train: names or indices of the records to fit.
        check: names or indices of the records that decide which effects a model keeps.
        test: names or indices of the records that are only reported.

    Returns:
        The three sets; a record without a set is left out.

    Raises:
        InputError: when a record is unknown, in two sets, or shares its name with another record,
            or when the training set is empty.
    """
    records = unstack(records) if isinstance(records, Record) else records
    chosen = {
        "train": _indices(records, train, "train"),
        "check": _indices(records, check, "check"),
        "test": _indices(records, test, "test"),
    }
    require(
        len(chosen["train"]) > 0,
        "`train` is empty, so there is nothing to fit. Name at least one record.",
    )
    part_of: dict[int, str] = {}
    for part, indices in chosen.items():
        for i in indices:
            require(
                i not in part_of,
                f"Record {i} ({records[i].names[0]!r}) is in `{part_of.get(i)}` and in `{part}`. "
                "Held-out data must not be used twice: leave it in one of them.",
            )
            part_of[i] = part
    return Split(**{part: tuple(records[i] for i in indices) for part, indices in chosen.items()})


def split_at(record: Record, where: float | SupportsIndex) -> tuple[Record, Record]:
    """Cut a single record in two.

    With `split_at(record, 2 / 3)` the last third can be the check record.

    Args:
        record: a single record.
        where: fraction of the samples that stay in the first part, between 0 and 1; or, as a
            whole number, the first row of the second part.

    Returns:
        The two parts; time continues in the second part.

    Raises:
        InputError: when the record is a stack, or a part would have fewer than 2 samples.
    """
    require_single(record, "cut")
    rows = record.t.shape[0]
    row = operator.index(where) if isinstance(where, SupportsIndex) else round(where * rows)
    require(
        2 <= row <= rows - 2,
        f"Record {record.names[0]!r}: a cut at {where!r} leaves parts of {row} and {rows - row} "
        "samples. Both need at least 2: give a fraction between 0 and 1, or a row (int) inside the "
        "record.",
    )
    return record.window(0, row), record.window(row)


def segment(record: Record, seconds: float | int) -> tuple[Record, ...]:
    """Cut a single record into pieces of equal duration, at most `seconds` long.

    Each piece is a record with its own initial state; constants `initial_state.<state>` are left
    out. If the motion is unstable, or stabilised by a pilot or controller whose input contains the
    response to disturbances, errors accumulate along a simulation, and after some seconds the
    output contains little information on the parameters. Pieces as long as one manoeuvre preserve
    this information.

        n = ceil(duration / seconds)
        piece k: rows with duration k / n <= t - t_0 < duration (k + 1) / n

    Args:
        record: a single record.
        seconds: longest duration of a piece [s].

    Returns:
        The pieces in their order, named after the record. Time continues from one piece to the
        next, and no sample is lost.

    Raises:
        InputError: when the record is a stack, `seconds` is not positive, or a piece would have
            fewer than 2 samples.
    """
    require_single(record, "cut")
    require(
        seconds > 0, f"The length of the pieces is {seconds} s. Give a positive number of seconds."
    )
    name, t = record.names[0], np.asarray(record.t)
    ratio = float(t[-1] - t[0]) / seconds
    require(
        ratio <= len(t),
        f"Record {name!r}: {len(t)} samples make at most {len(t) // 2} pieces of 2 samples, and "
        f"pieces of {seconds:g} s would be more. Give more seconds.",
    )
    count = max(1, math.ceil(ratio))
    edges = [*np.searchsorted(t, np.linspace(t[0], t[-1], count + 1)[:-1]), len(t)]
    fewest = int(np.min(np.diff(edges)))
    require(
        fewest >= 2,
        f"Record {name!r}: in {count} pieces of at most {seconds:g} s one has {fewest} samples, "
        "and 2 are needed. Give more seconds.",
    )
    pieces = (record.window(int(a), int(b)) for a, b in itertools.pairwise(edges))
    return tuple(
        dataclasses.replace(
            piece,
            names=(f"{name} ({k} of {count})",),
            constants=without_initial_state(piece.constants),
        )
        for k, piece in enumerate(pieces, 1)
    )


@on_host
def _padded(xp, arrays, rows: int, mode: str):
    """Stack arrays, each padded to a number of rows by its last row (`edge`) or by zeros."""
    widths = ([(0, rows - len(array))] + [(0, 0)] * (array.ndim - 1) for array in arrays)
    return xp.stack([xp.pad(*pair, mode=mode) for pair in zip(arrays, widths, strict=True)])


@on_host
def _stacked(xp, arrays):
    return xp.stack(arrays)


def _require_same_layout(first: Record, other: Record, i: int) -> None:
    """Refuse a record whose channels, units or constants differ from those of the first record."""
    where = f"Record {i} ({other.names[0]!r})"
    require(
        not other.is_stack, f"{where} is a stack already. `unstack` it, then stack all of them."
    )
    require_same_channels(first, other, where)
    odd = sorted(first.constants.keys() ^ other.constants.keys())
    require(
        not odd,
        f"{where}: constants {', '.join(map(repr, odd))} are in only one of this record and "
        "record 0. Give them to all records.",
    )


def require_same_channels(first: Record, other: Record, where: str) -> None:
    """Refuse a record whose channels or units differ from those of the first record.

    Args:
        first: record 0.
        other: another record.
        where: the number and the name of the other record, for the message.

    Raises:
        InputError: with the channels that differ.
    """
    for kind in ("inputs", "outputs"):
        ours, theirs = getattr(first, kind), getattr(other, kind)
        odd = sorted(set(ours) ^ set(theirs))
        difference = (
            f"differ in {', '.join(map(repr, odd))}" if odd else f"come in another order, {theirs}"
        )
        require(
            ours == theirs,
            f"{where}: its {kind} {difference} from record 0, {ours}. Give all records "
            "the same channels.",
        )
    names, units = (*first.inputs, *first.outputs), (*first.input_units, *first.output_units)
    for channel, ours, theirs in zip(
        names, units, (*other.input_units, *other.output_units), strict=True
    ):
        require(
            ours == theirs,
            f"{where}: channel {channel!r} {_unit_words(theirs)}, and in record 0 it "
            f"{_unit_words(ours)}. Give `units` for all.",
        )


def _unit_words(unit: str) -> str:
    return f"is in [{unit}]" if unit else "has no unit"


def _indices(records: Sequence[Record], wanted: Iterable[str | int], part: str) -> list[int]:
    """Indices of the named records."""
    require(
        not isinstance(wanted, str),
        f"`{part}` is the string {wanted!r}. Give a list of names or indices.",
    )
    names = [r.names[0] for r in records]
    indices = []
    for item in wanted:
        if isinstance(item, str):
            require_known("record", [item], names)
            require(
                names.count(item) == 1,
                f"The record name {item!r} in `{part}` is not unique. Choose by index.",
            )
            indices.append(names.index(item))
        else:
            n = len(records)
            require(
                -n <= item < n, f"There is no record {item} for `{part}`: choose from 0 to {n - 1}."
            )
            indices.append(int(np.arange(n)[item]))
    return indices
