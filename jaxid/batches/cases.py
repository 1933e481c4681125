"""Cases of a batch as arrays on the host, each checked by itself, in buckets of one shape.

A case is one estimate: its records, its model, and the values at which its iteration starts.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from .._foundation.checks import InputError, require, require_known
from .._foundation.types import Numbers
from ..data.record import Record
from ..estimation.argument_checks import check_free, check_model
from ..estimation.estimate import as_stack
from ..estimation.likelihoods import AbstractLikelihood
from ..models.base import AbstractModel, canonical
from ..models.free import Free, with_values_at
from ..models.names import parameter_names
from .checks import CaseChecks

# Records are padded to the length of a longer one if they have at least this share of its samples,
# so that both share one compiled program (chosen).
SHORTEST_SHARE = 0.8

CaseRecords = Record | Sequence[Record]
Starts = Mapping[str, Numbers | Sequence[float]] | Numbers


class CaseArrays(NamedTuple):
    """Model, free parameters and records of one case, or of many with a leading axis.

    Attributes:
        model: the model, whose values are the start of the free parameters.
        free: the free parameters.
        records: a stack without names.
    """

    model: AbstractModel
    free: Free
    records: Record


class Case(NamedTuple):
    """One estimate of a batch.

    Attributes:
        index: position in the batch.
        name: names of its records, joined by a comma.
        refusal: the reason for which the case cannot be estimated; empty for all others.
        parameters: arrays of the model and the free parameters; empty for a refused case.
        records: arrays of the records on the host, in the order of the fields of `Record`.
        structure: structure of its `CaseArrays`.
    """

    index: int
    name: str
    refusal: str
    parameters: Sequence[Numbers] = ()
    records: Sequence[np.ndarray] = ()
    structure: Any = None

    @property
    def arrays(self) -> CaseArrays:
        """Model, free parameters and records; not of a refused case."""
        return self.structure.unflatten([*self.parameters, *self.records])


class Bucket(NamedTuple):
    """Cases that share one compiled program.

    Attributes:
        cases: the cases, none of them refused.
        rows: number of samples to which their records are padded.
    """

    cases: list[Case]
    rows: int

    def batch(self, cases: Sequence[Case]) -> CaseArrays:
        """Return the padded arrays of some cases of the bucket with a leading axis."""
        columns = zip(*(_padded(case, self.rows) for case in cases), strict=True)
        return cases[0].structure.unflatten([np.stack(column) for column in columns])


def read_cases(
    model: AbstractModel,
    free: Free,
    cases: Record | Sequence[CaseRecords],
    likelihood: AbstractLikelihood,
    models: AbstractModel | Sequence[AbstractModel] | None,
    starts: Starts | None,
) -> list[Case]:
    """Return the cases of a batch; one that cannot be estimated carries its refusal.

    The arguments are those of `estimate_many`.

    Raises:
        InputError: when there is no case, the number of models or starts differs, a
            parameter does not exist, or every case is refused.
    """
    if isinstance(cases, Record) or jax.default_backend() != "cpu":
        cases = jax.device_get(cases)  # all at once
    groups = list(cases)
    require(len(groups) > 0, "There is no case to estimate. Give at least one record.")
    check_model(model)
    check_free(free)
    free = canonical(free)
    free.positions(model)  # refuses names that do not exist, before any case is read
    values = _start_values(model, free, starts, len(groups))
    own_models, checks = _models(model, models, values, len(groups)), CaseChecks(likelihood)
    read = [
        _read(index, case_model, free, records, checks)
        for index, (case_model, records) in enumerate(zip(own_models, groups, strict=True))
    ]
    require(
        not all(case.refusal for case in read),
        f"Every case was refused. The first one, {read[0].name!r}: {read[0].refusal}",
    )
    return read


def buckets(cases: Sequence[Case]) -> list[Bucket]:
    """Return the cases that are not refused in buckets of one shape, long records first."""
    groups: dict[object, list[Case]] = {}
    for case in cases:
        if not case.refusal:
            groups.setdefault(_layout(case), []).append(case)
    return [bucket for group in groups.values() for bucket in _by_length(group)]


def _by_length(cases: list[Case]) -> Iterable[Bucket]:
    """Yield buckets of cases whose records have similar numbers of samples."""
    remaining = sorted(cases, key=lambda case: -_rows(case))
    while remaining:
        longest = _rows(remaining[0])
        count = sum(_rows(case) >= SHORTEST_SHARE * longest for case in remaining)
        yield Bucket(sorted(remaining[:count], key=lambda case: case.index), longest)
        remaining = remaining[count:]


def _rows(case: Case) -> int:
    return case.records[0].shape[1]


def _layout(case: Case) -> object:
    """Return the structure of a case and the shapes of its arrays, lengths of records left out."""
    shapes = tuple(leaf.shape for leaf in case.parameters)
    return case.structure, shapes, case.records[0].shape[0]


def _padded(case: Case, rows: int) -> list[Numbers]:
    """Return the arrays of a case with its records padded as by `stack`."""
    missing = rows - _rows(case)
    if not missing:
        return [*case.parameters, *case.records]

    def pad(values, mode):
        return np.pad(values, [(0, 0), (0, missing)] + [(0, 0)] * (values.ndim - 2), mode=mode)

    t, u, z, mask, *constants = case.records
    padded = pad(t, "edge"), pad(u, "edge"), pad(z, "constant"), pad(mask, "constant")
    return [*case.parameters, *padded, *constants]


def _read(
    index: int, model: AbstractModel, free: Free, records: CaseRecords, checks: CaseChecks
) -> Case:
    """Return one case, with all checks of `estimate`."""
    name = f"case {index}"
    try:
        if not isinstance(records, Record):
            records = as_stack(jax.device_get(records))
        name = ", ".join(records.names)
        anonymous = checks.without_names(model, records)
        prepared = checks.prepared(model, free, anonymous)
    except InputError as error:
        return Case(index, name, str(error))
    if prepared[0] is not model or prepared[1] is not free:
        prepared = canonical(prepared)
    case_model, case_free = prepared
    leaves, structure = jax.tree.flatten(CaseArrays(case_model, case_free, anonymous))
    first = len(leaves) - len(jax.tree.leaves(anonymous))
    return Case(index, name, "", leaves[:first], leaves[first:], structure)


def _models(
    model: AbstractModel,
    models: AbstractModel | Sequence[AbstractModel] | None,
    values: np.ndarray | None,
    count: int,
) -> Iterable[AbstractModel]:
    """Yield the model of each case, with the values at which its iteration starts."""
    if models is None:
        each: Sequence[AbstractModel] = [canonical(model)] * count
    elif isinstance(models, AbstractModel):
        each = _unstacked(canonical(models), canonical(model), count)
    else:
        require(
            len(models) == count,
            f"There are {count} cases and {len(models)} models. Give one model per case.",
        )
        each = [canonical(one) for one in models]
    if values is None:
        yield from each
        return
    at = np.flatnonzero(~np.isnan(values[0]))
    for one, row in zip(each, values, strict=True):
        yield with_values_at(one, at, row[at])


def _unstacked(models: AbstractModel, model: AbstractModel, count: int) -> list[AbstractModel]:
    """Return the models of a batched model, whose leaves have a leading axis."""
    for batched, single in zip(jax.tree.leaves(models), jax.tree.leaves(model), strict=True):
        expected = (count, *np.shape(single))
        require(
            np.shape(batched) == expected,
            f"A leaf of the batched `models` has shape {np.shape(batched)} and must have "
            f"{expected}: the {count} cases first. Give a model whose arrays all have that axis, "
            "or a sequence of models.",
        )
    leaves = jax.tree.map(np.asarray, models)
    return [canonical(jax.tree.map(lambda leaf, i=i: leaf[i], leaves)) for i in range(count)]


def _start_values(
    model: AbstractModel, free: Free, starts: Starts | None, count: int
) -> np.ndarray | None:
    """Return a row of values for each case, NaN for parameters without a given start."""
    if starts is None:
        return None
    names = parameter_names(canonical(model))
    if not isinstance(starts, Mapping):
        columns = np.asarray(starts, float)
        require(
            columns.shape == (count, len(free.shared)),
            f"`starts` has shape {columns.shape} and must have {(count, len(free.shared))}: one "
            f"row per case, one column per parameter ({', '.join(free.shared)}).",
        )
        starts = dict(zip(free.shared, columns.T, strict=True))
    require_known("parameter (in `starts`)", starts, names)
    values = np.full((count, len(names)), np.nan)
    for name, column in starts.items():
        column = np.asarray(column, float)
        require(
            column.shape == (count,) and bool(np.all(np.isfinite(column))),
            f"The starts of {name!r} must be {count} finite numbers, one per case; they have shape "
            f"{column.shape}.",
        )
        values[:, names.index(name)] = column
    return values
