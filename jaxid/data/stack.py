"""Several records as one stack of common length, and back; one in pieces; which are fitted and which are held out."""

import dataclasses
import itertools
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.types import Array
from .record import Record


class Split(NamedTuple):
    """Records to fit, records that decide what is kept, records that are reported: none of them in two places."""

    train: tuple[Record, ...]
    check: tuple[Record, ...]
    test: tuple[Record, ...]


def stack(records: Sequence[Record], pad_to: int | None = None) -> Record:
    """Put single records on top of each other, padded to one length.

    Padding rows repeat the last time, so that `diff(t)` is zero, and the last input; their mask is False.

    Args:
        records: single records with the same channels, units and names of constants.
        pad_to: number of rows, so that several stacks share one compiled shape; the longest record when left out.

    Returns:
        The stack, with axes (case, time).

    Raises:
        InputError: when there is no record, one of them is a stack or has other channels, or `pad_to` is too short.
    """
    records = tuple(records)
    require(len(records) > 0, "There is no record to stack. Give at least one.")
    first = records[0]
    for i, other in enumerate(records):
        _require_alike(first, other, i)
    longest = max(r.t.shape[0] for r in records)
    rows = longest if pad_to is None else pad_to
    require(
        rows >= longest, f"`pad_to` is {rows} and the longest record has {longest} samples. Give at least {longest}."
    )
    return Record(
        t=jnp.stack([_pad(r.t, rows, repeat=True) for r in records]),
        u=jnp.stack([_pad(r.u, rows, repeat=True) for r in records]),
        z=jnp.stack([_pad(r.z, rows) for r in records]),
        mask=jnp.stack([_pad(r.mask, rows) for r in records]),
        constants={key: jnp.stack([r.constants[key] for r in records]) for key in first.constants},
        inputs=first.inputs,
        outputs=first.outputs,
        input_units=first.input_units,
        output_units=first.output_units,
        names=tuple(r.names[0] for r in records),
    )


def unstack(record: Record) -> list[Record]:
    """The records of a stack without their padding: the inverse of `stack`; a single record gives a list of itself."""
    return list(record)


def split(
    records: Sequence[Record],
    *,
    train: Iterable[str | int],
    check: Iterable[str | int] = (),
    test: Iterable[str | int] = (),
) -> Split:
    """Divide records, whole, into those to fit, those that decide and those that are reported.

    Args:
        records: single records.
        train: names or indices of the records to fit.
        check: names or indices of the records that decide what a model keeps.
        test: names or indices of the records that are only reported.

    Returns:
        The three sets; a record that is named nowhere is left out.

    Raises:
        InputError: when a record is unknown, in two sets, or named as another one is, or when nothing is to be fitted.
    """
    chosen = {
        "train": _indices(records, train, "train"),
        "check": _indices(records, check, "check"),
        "test": _indices(records, test, "test"),
    }
    require(len(chosen["train"]) > 0, "`train` is empty, so there is nothing to fit. Name at least one record.")
    owner: dict[int, str] = {}
    for part, indices in chosen.items():
        for i in indices:
            require(
                i not in owner,
                f"Record {i} ({records[i].names[0]!r}) is in `{owner.get(i)}` and in `{part}`. Held-out data must not "
                "be seen twice: leave it in one of them.",
            )
            owner[i] = part
    return Split(**{part: tuple(records[i] for i in indices) for part, indices in chosen.items()})


def split_at(record: Record, where: float | int) -> tuple[Record, Record]:
    """Cut a single record in two, such as `split_at(record, 2 / 3)` where the last third shall decide.

    Args:
        record: a single record.
        where: fraction of the samples that stay in the first part, between 0 and 1; or, as an `int`, the row that opens
            the second part.

    Returns:
        The two parts; time goes on in the second.

    Raises:
        InputError: when the record is a stack, or a part would have fewer than 2 samples.
    """
    require(not record.is_stack, "Only a single record can be cut, and this is a stack. Take `stack[i]`.")
    rows = record.t.shape[0]
    row = where if isinstance(where, int) else round(where * rows)
    require(
        2 <= row <= rows - 2,
        f"Record {record.names[0]!r}: a cut at {where!r} leaves parts of {row} and {rows - row} samples. Both need at "
        "least 2: give a fraction between 0 and 1, or a row (int) inside the record.",
    )
    return record.window(0, row), record.window(row)


def cut(record: Record, seconds: float | int) -> tuple[Record, ...]:
    """Cut a single record into pieces of equal time, none longer than asked, each a record with a first state of its own.

    Where a motion is unstable, or held by a pilot or a controller whose input carries what disturbs it, errors add up along a
    simulation, and after some seconds it says little of the parameters. Pieces as long as one manoeuvre keep what they say.

        n = ceil(duration / seconds),    piece k: rows of duration k / n <= t - t_0 < duration (k + 1) / n

    Args:
        record: a single record.
        seconds: longest piece [s].

    Returns:
        The pieces in their order, named after the record; time goes on from one to the next, and no sample is lost.

    Raises:
        InputError: when the record is a stack, `seconds` is not positive, or a piece would have fewer than 2 samples.
    """
    require(not record.is_stack, "Only a single record can be cut, and this is a stack. Take `stack[i]`.")
    require(seconds > 0, f"Pieces of {seconds} s cannot be. Give a positive number of seconds.")
    name, t = record.names[0], np.asarray(record.t)
    count = max(1, math.ceil((t[-1] - t[0]) / seconds))
    edges = [*np.searchsorted(t, np.linspace(t[0], t[-1], count + 1)[:-1]), len(t)]
    fewest = int(np.min(np.diff(edges)))
    require(
        fewest >= 2,
        f"Record {name!r}: in {count} pieces of at most {seconds:g} s one has {fewest} samples, and 2 are needed. Give more "
        "seconds.",
    )
    pieces = (record.window(int(a), int(b)) for a, b in itertools.pairwise(edges))
    return tuple(dataclasses.replace(piece, names=(f"{name} ({k} of {count})",)) for k, piece in enumerate(pieces, 1))


def _pad(array: Array, rows: int, repeat: bool = False) -> Array:
    """Rows added below: the last one again, or zeros (False)."""
    width = [(0, rows - array.shape[0])] + [(0, 0)] * (array.ndim - 1)
    return jnp.pad(array, width, mode="edge") if repeat else jnp.pad(array, width)


def _require_alike(first: Record, other: Record, i: int) -> None:
    """Refuse a record that does not fit on top of the first one, and say by what."""
    where = f"Record {i} ({other.names[0]!r})"
    require(not other.is_stack, f"{where} is a stack already. `unstack` it, then stack all of them.")
    for kind in ("inputs", "outputs"):
        ours, theirs = getattr(first, kind), getattr(other, kind)
        odd = sorted(set(ours) ^ set(theirs))
        found = f"differ in {', '.join(map(repr, odd))}" if odd else f"come in another order, {theirs}"
        require(
            ours == theirs, f"{where}: its {kind} {found} from record 0, {ours}. Give all records the same channels."
        )
    names, units = (*first.inputs, *first.outputs), (*first.input_units, *first.output_units)
    for channel, ours, theirs in zip(names, units, (*other.input_units, *other.output_units), strict=True):
        require(
            ours == theirs,
            f"{where}: channel {channel!r} is in [{theirs}], and in [{ours}] in record 0. Give `units` for all.",
        )
    odd = sorted(first.constants.keys() ^ other.constants.keys())
    require(
        not odd,
        f"{where}: constants {', '.join(map(repr, odd))} stand in only one of it and record 0. Give them to all.",
    )


def _indices(records: Sequence[Record], wanted: Iterable[str | int], part: str) -> list[int]:
    """Indices of the records named, each once."""
    require(not isinstance(wanted, str), f"`{part}` is the string {wanted!r}. Give a list of names or indices.")
    names = [r.names[0] for r in records]
    found = []
    for item in wanted:
        if isinstance(item, str):
            require_known("record", [item], names)
            require(names.count(item) == 1, f"The record name {item!r} in `{part}` is not unique. Choose by index.")
            found.append(names.index(item))
        else:
            n = len(records)
            require(-n <= item < n, f"There is no record {item} for `{part}`: choose from 0 to {n - 1}.")
            found.append(int(np.arange(n)[item]))
    return found
