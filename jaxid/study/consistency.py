"""`consistency`: do the instruments of a record agree with each other, and if not, which of them errs and by how much."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_unique
from .._foundation.types import Array, Float
from ..data.record import Record
from ..data.stack import stack
from ..diagnosis.validation import root_mean_square
from ..estimation import Estimate, GaussNewton, OutputError, estimate
from ..estimation.input_noise import input_noise_covariance
from ..estimation.likelihoods import AbstractLikelihood
from ..models.base import AbstractModel, canonical
from ..models.free import INITIAL_STATE, free
from ..models.names import read
from ..simulation.inputs import Cubic
from .consistency_result import Channel, Consistency, SensorError

IMITATED = 1e-7  # share of a sensitivity that is left by rounding when it is a sum of others


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
    """Estimate the errors of the instruments with a model that holds nothing else uncertain, and tell which instruments disagree.

    The model says what must hold between the channels (for an aircraft `Kinematics`: rates and specific forces, integrated,
    give speed, air angles, attitude and altitude). The errors are estimated by maximum likelihood, each record with an
    initial state of its own. An error counts as found when it is significant by Holm's step-down test over all errors
    tried: were there none at all, the probability to name one is at most `level`. Its standard error is the one that the
    colour of the residuals is accounted for in.

    Args:
        model: its free parameters are errors of instruments, zero (or at values known before) at the start.
        records: one, several or a stack; each may hold more channels than the model, `model.prepared` chooses.
        errors: names of the parameters to try; those that `model.sensor_errors()` proposes where left out.
        per_record: those among them with a value of its own in each record; the colour of residuals is not accounted for in
            their standard errors.
        likelihood: how the misfit is measured; `OutputError(hold=Cubic())` by default, as measured inputs are smooth. Give
            another where an input jumps, or an output is free of noise as only a simulated one is (`FixedNoise`).
        solver: how to iterate.
        level: probability to name an instrument that has no error.
        input_noise: standard deviation of the white noise in each sample of an input, by name [its unit]. Output error does
            not know of it, and residuals hardly show it: what gyros and accelerometers of the report's base level add in 10 s
            leaves the 95 % intervals of white residuals covering 57 to 84 %. With it given they cover. A smoothed channel
            tells it (its scatter about the smooth curve); to smooth the inputs themselves does not help, as what
            is integrated is the slow part of the noise.
        skip: time at the start of each record whose outputs are not compared [s]. A channel that is late shows then what was
            before the record began; 0 is right for a record that begins in steady motion.

    Returns:
        The errors with what judges them, residuals before and after, a verdict in words, and what takes the errors out
        of a record.

    Raises:
        InputError: when no error is named and the model proposes none, a name is not a parameter or an input, a channel is
            missing, `skip` leaves no sample, or `input_noise` is given with errors of single records, which it does not reach.

    Source: V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, chapter 10; S. Holm, Scandinavian Journal of
    Statistics 6, 1979.
    """
    names = _names(model, errors)
    shared = tuple(name for name in names if name not in per_record)
    whole = _prepared(model, records, skip, per_record)
    likelihood, solver = likelihood or OutputError(hold=Cubic()), solver or GaussNewton()
    apart = (*per_record, INITIAL_STATE)
    before = estimate(model, free(model, per_record=(INITIAL_STATE,)), whole, likelihood, solver=solver)
    found = estimate(model, free(model, *shared, per_record=apart), whole, likelihood, solver=solver)
    lost = _lost(found)
    if lost:
        left = [name for name in shared if name not in lost]
        found = estimate(model, free(model, *left, per_record=apart), whole, likelihood, solver=solver)
    deviations = _deviations(model, found, whole, likelihood, input_noise or {}, per_record)
    return Consistency(
        model=model,
        estimate=found,
        errors=_judged(_rows(found, deviations, model, whole.names, shared), level),
        channels=_channels(before, found, whole),
        level=level,
        records=whole.names,
        noise_known=bool(input_noise),
    )


def _names(model: AbstractModel, errors: Sequence[str] | None) -> tuple[str, ...]:
    """The errors to try, groups written out."""
    names: Sequence[str] = model.sensor_errors() if errors is None else errors
    if errors is None:
        require(
            bool(names),
            f"{type(model).__name__} proposes no errors of instruments. Name the parameters that are such errors, or write "
            "its method `sensor_errors()`.",
        )
    return free(model, *names).shared


def _prepared(
    model: AbstractModel, records: Record | Sequence[Record], skip: float, per_record: Sequence[str]
) -> Record:
    """A stack with the model's channels, the outputs of the first `skip` seconds masked."""
    single = [records] if isinstance(records, Record) and not records.is_stack else list(records)
    require(bool(single), "There is no record to check. Give at least one.")
    if per_record:
        require_unique("record", (record.names[0] for record in single))
    prepared = stack([model.prepared(record) for record in single])
    if skip == 0.0:
        return prepared
    late = prepared.t >= prepared.t[:, :1] + skip
    require(
        bool(jnp.all(jnp.any(late, axis=1))),
        f"`skip` is {skip:g} s, and a record is not longer. Skip less: the longest delay is enough.",
    )
    mask = prepared.mask & late[..., None]
    return dataclasses.replace(prepared, mask=mask, z=jnp.where(mask, prepared.z, 0.0))


def _deviations(
    model, found: Estimate, records: Record, likelihood, input_noise, per_record
) -> Float[Array, " parameter"]:
    """Standard errors of the shared errors: colour of the residuals, and known noise of the inputs."""
    if not input_noise:
        return found.coloured_errors
    require(
        not per_record,
        "`input_noise` reaches errors that the records share, and some are one per record. Check the records one at a time.",
    )
    added = input_noise_covariance(model, found, records, likelihood, input_noise)
    return jnp.sqrt(found.coloured_errors**2 + jnp.diagonal(added))


def _lost(found: Estimate) -> tuple[str, ...]:
    """Shared errors that the records' own unknowns imitate altogether: their column is gone once those are eliminated."""
    left = jnp.sum(found.information.triangle**2, axis=0)
    imitated = jnp.sum(found.information.own.coupling**2, axis=(0, 1))
    gone = np.asarray(left <= IMITATED**2 * imitated)
    return tuple(name for name, is_gone in zip(found.names, gone, strict=True) if is_gone)


def _rows(
    found: Estimate,
    deviations: Float[Array, " parameter"],
    model: AbstractModel,
    records: tuple[str, ...],
    shared: tuple[str, ...],
) -> list[SensorError]:
    """Every error, those of one record each after those of all; one that is imitated stays at its start."""
    units, numbers = model.units(), zip(found.values, deviations, strict=True)
    known = {name: (float(value), float(error)) for name, (value, error) in zip(found.names, numbers, strict=True)}
    begin = dict(zip(shared, np.asarray(read(canonical(model), shared)).tolist(), strict=True))
    rows = [SensorError(name, None, *known.get(name, (begin[name], np.inf)), units.get(name, "")) for name in shared]
    for column, name in enumerate(found.free.per_record):
        if not name.startswith(f"{INITIAL_STATE}."):
            values = zip(records, found.own[:, column], found.own_errors[:, column], strict=True)
            rows += [SensorError(name, case, float(v), float(s), units.get(name, "")) for case, v, s in values]
    return rows


def _judged(rows: list[SensorError], level: float) -> tuple[SensorError, ...]:
    """The errors with their probability under chance, corrected for the number tried, `max_(j<=k) (m - j) p_(j)` (Holm)."""
    # Two sides of the normal distribution: 2 Phi(-z) = erfc(z / sqrt(2)).
    z = [abs(row.value) / row.standard_error if row.is_known else 0.0 for row in rows]
    p = np.array([math.erfc(size / math.sqrt(2.0)) for size in z])
    order = np.argsort(p, kind="stable")
    corrected = np.minimum(np.maximum.accumulate((p.size - np.arange(p.size)) * p[order]), 1.0)
    chance = dict(zip(order.tolist(), corrected.tolist(), strict=True))
    return tuple(row._replace(chance=chance[k], found=chance[k] < level) for k, row in enumerate(rows))


def _channels(before: Estimate, after: Estimate, records: Record) -> tuple[Channel, ...]:
    """Residuals without and with the errors, channel by channel."""
    rms = [root_mean_square(one.residuals, one.mask) for one in (before, after)]
    rows = zip(records.outputs, records.output_units, *rms, strict=True)
    return tuple(Channel(name, unit, float(b), float(a)) for name, unit, b, a in rows)
