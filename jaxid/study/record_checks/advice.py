"""`advice`: findings on records before a model is fitted to them."""

from collections.abc import Iterator, Sequence

import numpy as np

from ..._foundation.checks import InputError, require, require_float64
from ...data.record import Record
from ...data.stack import single_records
from ...estimation.likelihoods import AbstractLikelihood, OutputError
from ...models.base import AbstractModel, canonical
from ...models.equation_shapes import check_equations
from ...models.free import Free
from .channels import Measured, longest_piece, measured, single_channels, time_base
from .determination import determination, selection, undetermined
from .findings import Advice, Finding, FindingKind
from .frequencies import excitations, modes
from .rates import measured_rates, rates_and_channels
from .relations import collinear_inputs, delay_and_drift, feedback, offset_at_rest
from .response import Response, response
from .sizes import units_between_records
from .unit_checks import units_of_channels


def advice(
    records: Record | Sequence[Record],
    model: AbstractModel,
    free: Free | None = None,
    likelihood: AbstractLikelihood | None = None,
) -> Advice:
    """Return findings on records before a model is fitted to them.

    They concern the time base, missing samples, units, coarse steps, saturation, offsets, drift,
    delays, feedback, the frequencies of the inputs, and the parameters that all records together
    determine. A channel whose rate follows from other channels without a parameter, such as an
    altitude or an angle, is compared with the integral of that rate. Delays, drift and feedback are
    tested in linear regressions of each output on its past and on the inputs; strong nonlinearity
    can be taken for one of them. Of a record with a hole in time the longest piece is examined.
    Nothing is changed, and nothing is fitted.

    Args:
        records: one record, several records, or a stack.
        model: the model at its present values: its modes, response and sensitivities are compared
            with the records.
        free: the parameters of the later fit; by default all of a model with at most 40.
        likelihood: the likelihood of the later fit: its hold and stepper simulate, and its noise,
            if known, gives the expected standard errors (by default linear interpolation, one step
            between samples, and noise estimated from the records). Process noise is left out.

    Returns:
        The findings as data; `print` shows them as a table.

    Raises:
        InputError: when a record lacks a channel of the model, or JAX is in 32 bit.
    """
    require_float64()
    model, simulating = canonical(model), _simulating(likelihood)
    check_equations(model)
    singles = [_selected(model, record) for record in single_records(records)]
    require(len(singles) > 0, "There is no record to advise on. Give at least one.")
    findings: list[Finding] = []
    excitation = []
    finite = True
    pieces, responses = [], []
    for number, record in enumerate(singles):
        findings += time_base(measured(record, number))
        piece = longest_piece(record)
        arrays = measured(piece, number)
        at = response(model, piece, arrays, simulating)
        finite = finite and bool(np.isnan(at.ends))
        findings += _findings(arrays, piece, model, at)
        excitation += excitations(arrays)
        pieces.append(piece)
        responses.append((arrays, at))
    findings += units_between_records(responses)
    chosen = selection(model, free) if finite else None
    information = None if chosen is None else determination(model, chosen, pieces, simulating)
    if information is not None:
        findings += undetermined(information)
    return Advice(tuple(findings), tuple(excitation), information)


def _simulating(likelihood: AbstractLikelihood | None) -> OutputError:
    """Return output error with the hold, the stepper and the known noise of a likelihood."""
    if isinstance(likelihood, OutputError):
        return canonical(likelihood)
    parts = {name: getattr(likelihood, name, None) for name in ("hold", "stepper")}
    return OutputError(**{name: part for name, part in parts.items() if part is not None})


def _findings(record: Measured, piece: Record, model: AbstractModel, at: Response) -> list[Finding]:
    """Return the findings on one record but for its time base, in the order of `FindingKind`."""
    observed = [*single_channels(record), *collinear_inputs(record)]
    observed += units_of_channels(record, model.units(), at)
    if model.states:
        observed += rates_and_channels(record, measured_rates(model, piece, record))
    observed += modes(record, at)
    if not np.isnan(at.ends):
        numbers = {"seconds": at.ends - float(record.t[0])}
        observed.append(Finding(FindingKind.DIVERGENCE, record.name, (), numbers))
    observed += _dynamic(record, at) if model.states and record.inputs else []
    order = list(FindingKind)
    return sorted(observed, key=lambda finding: order.index(finding.kind))


def _dynamic(record: Measured, at: Response) -> Iterator[Finding]:
    """Findings that need equal steps and the linear response of the model."""
    if record.is_uniform and at.is_finite:
        yield from offset_at_rest(record, at)
        yield from delay_and_drift(record, at)
        yield from feedback(record, at)


def _selected(model: AbstractModel, record: Record) -> Record:
    """Return a record with the channels of the model in its order."""
    if (record.inputs, record.outputs) == (model.inputs, model.outputs):
        return record
    try:
        return model.prepared(record)
    except InputError as error:
        raise InputError(f"Record {record.names[0]!r} does not fit the model: {error}") from error
