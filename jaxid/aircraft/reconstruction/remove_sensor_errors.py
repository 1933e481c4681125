"""Removal of known sensor errors from a record."""

import dataclasses

import interpax
import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import require
from ..._foundation.types import Bool, Float
from ...data.record import Record
from ...data.stack import stack
from ..instruments.channels import PerChannel
from ..instruments.instruments import Instruments


def remove_sensor_errors(
    record: Record, instruments: Instruments, input_bias: PerChannel, input_scale: PerChannel
) -> Record:
    """Return the record without scale error, bias and delay of its instruments.

        inputs: (measured - bias)/(1 + scale),      outputs: (z(t + delay) - bias)/(1 + scale)

    Args:
        record: a record or a stack; channels without a declared error are unchanged.
        instruments: instruments of the outputs, with their errors.
        input_bias, input_scale: errors of the signals that a model takes as its inputs; in the
            record these may be inputs or outputs.

    Raises:
        InputError: if an instrument has a lag.
    """
    if record.is_stack:
        return stack(
            [remove_sensor_errors(part, instruments, input_bias, input_scale) for part in record]
        )
    _require_no_lag(instruments)
    u, z, mask = (np.array(part) for part in (record.u, record.z, record.mask))
    for columns, names in ((u, record.inputs), (z, record.outputs)):
        for name in set(input_bias.channels) & set(names):
            k = names.index(name)
            columns[:, k] = (columns[:, k] - float(input_bias[name])) / (
                1.0 + float(input_scale[name])
            )
    for name in set(instruments.channels) & set(record.outputs):
        k = record.outputs.index(name)
        delay = float(instruments.delay[name]) if name in instruments.delay.channels else 0.0
        if delay:
            z[:, k], mask[:, k] = advance(np.asarray(record.t), z[:, k], mask[:, k], delay)
        z[:, k] = (z[:, k] - float(instruments.bias[name])) / (1.0 + float(instruments.scale[name]))
    z = np.where(mask, z, 0.0)
    return dataclasses.replace(record, u=jnp.asarray(u), z=jnp.asarray(z), mask=jnp.asarray(mask))


def _require_no_lag(instruments: Instruments) -> None:
    for name in instruments.lag.channels:
        lag = float(instruments.lag[name])
        require(
            lag == 0.0,
            f"{name} lags by {lag:.3g} s. Removing a lag amplifies the noise by a derivative, so "
            "it is not done here: smooth the channel first, or estimate a delay instead.",
        )


def advance(
    t: Float[np.ndarray, " time"],
    z: Float[np.ndarray, " time"],
    mask: Bool[np.ndarray, " time"],
    delay: float,
) -> tuple[Float[np.ndarray, " time"], Bool[np.ndarray, " time"]]:
    """Return a delayed channel shifted to the times of its samples, `z(t + delay)`.

    The samples are interpolated by a cubic spline.

    Args:
        t: sample times [s].
        z: samples [any unit].
        mask: True where a sample is valid.
        delay: delay of the channel, negative for an advance [s].

    Returns:
        Values, zero where there are none, and the mask: True where the samples on both sides are
        valid.
    """
    requested = t + delay
    after = np.clip(np.searchsorted(t, requested, side="right"), 1, t.size - 1)
    known = mask[after - 1] & mask[after] & (requested >= t[0]) & (requested <= t[-1])
    if not known.any():
        return np.zeros_like(z), known
    with jax.numpy_rank_promotion("allow"):  # interpax promotes ranks inside
        spline = interpax.interp1d(
            np.where(known, requested, t[mask][0]), t[mask], z[mask], method="cubic2"
        )
    return np.where(known, spline, 0.0), known
