"""`consistency`: test whether the instruments of a record agree with each other, and estimate the
errors of those that do not.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_level, require_unique
from .._foundation.types import Array, Float
from ..data.record import Record
from ..data.stack import single_records, stack
from ..diagnosis.validation import root_mean_square
from ..estimation import Estimate, GaussNewton, OutputError, estimate
from ..estimation.input_noise import check_input_noise, input_noise_covariance
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.solver import solver_or_default
from ..models.base import AbstractModel, canonical
from ..models.free import INITIAL_STATE, free
from ..models.names import read_parameters
from ..simulation.hold import Cubic
from .consistency_result import Channel, Consistency, SensorError

# Chosen: share of a sensitivity that is outside the span of others, below which it is a linear
# combination of them. Above what rounding leaves, below any share that data can resolve.
COLLINEAR_SHARE = 1e-7


def consistency(
    model: AbstractModel,
    records: Record | Sequence[Record],
    errors: Sequence[str] | None = None,
    *,
    per_record: Sequence[str] = (),
    likelihood: AbstractLikelihood | None = None,
    solver: GaussNewton | None = None,
    level: float = 0.05,
    input_noise: Mapping[str, float] | None = None,
    skip: float = 0.0,
) -> Consistency:
    """Estimate the errors of the instruments with a model that has no other uncertainty, and test
    which instruments disagree.

    The model relates the channels to each other (for an aircraft `Kinematics`: rates and specific
    forces, integrated, give speed, air angles, attitude and altitude). The errors are estimated by
    maximum likelihood, with one initial state for each record. An error is significant by Holm's
    step-down test over all errors tried: if no instrument has an error, the probability that one is
    named is at most `level`. Its standard error is corrected for the colour of the residuals.

    Args:
        model: its free parameters are errors of instruments; at the start they are zero, or have
            values known from elsewhere.
        records: one, several or a stack; each may hold more channels than the model,
            `model.prepared` selects the channels.
        errors: names of the parameters to try; by default those of `model.sensor_errors()`.
        per_record: those with one value for each record, or groups of them; their standard errors
            are not corrected for the colour of the residuals.
        likelihood: measure of the misfit; `OutputError(hold=Cubic())` by default, because measured
            inputs are smooth. Give another if an input jumps, or if an output has no noise, as in a
            simulation (`FixedNoise`).
        solver: the Gauss-Newton solver.
        level: probability of naming an instrument that has no error.
        input_noise: standard deviation of the white noise in each sample of an input, by name [its
            unit]. Output error neglects it, and the residuals hardly show it: with the noise that
            gyros and accelerometers of the report's base level add in 10 s, the 95 % intervals from
            white residuals cover 57 to 84 %. If it is given, they cover 95 %. It can be taken from
            the scatter of a channel about its smoothed curve. Smoothing the inputs themselves does
            not help, because the slow part of the noise is the part that is integrated.
        skip: time at the start of each record whose outputs are not compared [s]. A delayed
            channel starts with values from before the record. Zero is right for a record that
            begins in steady motion.

    Returns:
        The errors with their significance, the residuals before and after, a verdict in words, and
        a method that removes the errors from a record.

    Raises:
        InputError: if no error is named and the model proposes none, a name is not a parameter or
            an input, a channel is missing, `skip` leaves no sample, or `input_noise` is given with
            per-record errors or a likelihood that is no output error, for which it is not
            implemented.

    Source: V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, chapter 10; S. Holm,
    Scandinavian Journal of Statistics 6, 1979.
    """
    require_level(level, 0.01)
    require(skip >= 0, f"`skip` is {skip:g} s; it must not be negative.")
    names = _names(model, errors)
    per_record = free(model, per_record=per_record).per_record if per_record else ()
    shared = tuple(name for name in names if name not in per_record)
    prepared = _prepared(model, records, skip, per_record)
    likelihood, solver = likelihood or OutputError(hold=Cubic()), solver_or_default(solver)
    if input_noise:
        _check_input_noise(model, likelihood, input_noise, per_record)
    by_record = (*per_record, INITIAL_STATE)
    before = estimate(
        model, free(model, per_record=(INITIAL_STATE,)), prepared, likelihood, solver=solver
    )
    after = estimate(
        model, free(model, *shared, per_record=by_record), prepared, likelihood, solver=solver
    )
    imitated = _imitated(after)
    if imitated:
        kept = [name for name in shared if name not in imitated]
        after = estimate(
            model, free(model, *kept, per_record=by_record), prepared, likelihood, solver=solver
        )
    deviations = _deviations(model, after, prepared, likelihood, input_noise)
    return Consistency(
        model=model,
        estimate=after,
        errors=_tested(_rows(after, deviations, model, prepared.names, shared), level),
        channels=_channels(before, after, prepared),
        level=level,
        records=prepared.names,
        noise_known=bool(input_noise),
    )


def _names(model: AbstractModel, errors: Sequence[str] | None) -> tuple[str, ...]:
    """Return the names of the errors to try, groups expanded."""
    names: Sequence[str] = model.sensor_errors() if errors is None else errors
    if errors is None:
        require(
            bool(names),
            f"{type(model).__name__} proposes no errors of instruments. Name the parameters that "
            "are such errors, or write its method `sensor_errors()`.",
        )
    return free(model, *names).shared


def _prepared(
    model: AbstractModel, records: Record | Sequence[Record], skip: float, per_record: Sequence[str]
) -> Record:
    """Return a stack with the model's channels, the outputs of the first `skip` seconds masked."""
    single = single_records(records)
    require(bool(single), "There is no record to check. Give at least one.")
    if per_record:
        require_unique("record", (record.names[0] for record in single))
    prepared = stack([model.prepared(record) for record in single])
    if skip == 0.0:
        return prepared
    late = prepared.t >= prepared.t[:, :1] + skip
    require(
        bool(jnp.all(jnp.any(late, axis=1))),
        f"`skip` is {skip:g} s, and a record is not longer. Skip less: the longest delay is "
        "enough.",
    )
    mask = prepared.mask & late[..., None]
    return dataclasses.replace(prepared, mask=mask, z=jnp.where(mask, prepared.z, 0.0))


def _check_input_noise(model, likelihood, input_noise, per_record: tuple[str, ...]) -> None:
    """Refuse a noise of the inputs that cannot be added to the errors of the estimate."""
    require(
        not per_record,
        "`input_noise` applies to errors that all records share, and some are one per record. "
        "Check the records one at a time.",
    )
    check_input_noise(model, likelihood, input_noise)


def _deviations(
    model, fitted: Estimate, records: Record, likelihood, input_noise
) -> Float[Array, " parameter"]:
    """Standard errors of the shared errors, for the colour of the residuals and the known noise of
    the inputs.
    """
    if not input_noise:
        return fitted.corrected_errors
    added = input_noise_covariance(model, fitted, records, likelihood, input_noise)
    return jnp.sqrt(fitted.corrected_errors**2 + jnp.diagonal(added))


def _imitated(fitted: Estimate) -> tuple[str, ...]:
    """Shared errors that the per-record parameters imitate completely.

    Their columns vanish when the per-record parameters are eliminated.
    """
    remaining = jnp.sum(fitted.information.triangle**2, axis=0)
    eliminated = jnp.sum(fitted.information.own.coupling**2, axis=(0, 1))
    vanished = np.asarray(remaining <= COLLINEAR_SHARE**2 * eliminated)
    return tuple(name for name, gone in zip(fitted.names, vanished, strict=True) if gone)


def _rows(
    fitted: Estimate,
    deviations: Float[Array, " parameter"],
    model: AbstractModel,
    records: tuple[str, ...],
    shared: tuple[str, ...],
) -> list[SensorError]:
    """All errors, the shared ones first, then the per-record ones.

    An error that the initial states imitate keeps its starting value.
    """
    units, numbers = model.units(), zip(fitted.values, deviations, strict=True)
    known = {
        name: (float(value), float(error))
        for name, (value, error) in zip(fitted.names, numbers, strict=True)
    }
    initial = dict(
        zip(shared, np.asarray(read_parameters(canonical(model), shared)).tolist(), strict=True)
    )
    rows = [
        SensorError(name, None, *known.get(name, (initial[name], np.inf)), units.get(name, ""))
        for name in shared
    ]
    for column, name in enumerate(fitted.free.per_record):
        if not name.startswith(f"{INITIAL_STATE}."):
            values = zip(records, fitted.own[:, column], fitted.own_errors[:, column], strict=True)
            rows += [
                SensorError(name, case, float(v), float(s), units.get(name, ""))
                for case, v, s in values
            ]
    return rows


def _tested(rows: list[SensorError], level: float) -> tuple[SensorError, ...]:
    """The errors with their p-values, corrected for the number of tests, `max_(j<=k) (m - j)
    p_(j)` (Holm).
    """
    # Two-sided test of a normal variable: 2 Phi(-z) = erfc(z / sqrt(2)).
    z = [abs(row.value) / row.standard_error if row.is_known else 0.0 for row in rows]
    p = np.array([math.erfc(size / math.sqrt(2.0)) for size in z])
    order = np.argsort(p, kind="stable")
    corrected = np.minimum(np.maximum.accumulate((p.size - np.arange(p.size)) * p[order]), 1.0)
    chance = dict(zip(order.tolist(), corrected.tolist(), strict=True))
    return tuple(
        row._replace(chance=chance[k], significant=chance[k] < level) for k, row in enumerate(rows)
    )


def _channels(before: Estimate, after: Estimate, records: Record) -> tuple[Channel, ...]:
    """Residuals without and with the errors, for each channel."""
    rms = [root_mean_square(fit.residuals, fit.mask) for fit in (before, after)]
    rows = zip(records.outputs, records.output_units, *rms, strict=True)
    return tuple(Channel(name, unit, float(b), float(a)) for name, unit, b, a in rows)
