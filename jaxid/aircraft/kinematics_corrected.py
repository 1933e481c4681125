"""A record with known errors of its instruments taken out."""

import dataclasses

import interpax
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require
from .._foundation.types import Bool, Float
from ..data.record import Record
from ..data.stack import stack
from .instrument_channels import PerChannel
from .instruments import Instruments


def without_errors(record: Record, instruments: Instruments, input_bias: PerChannel, input_scale: PerChannel) -> Record:
    """The record as the same instruments, without scale error, bias and delay, would have made it.

        inputs: (measured - bias)/(1 + scale),      outputs: (z(t + delay) - bias)/(1 + scale)

    Args:
        record: one or a stack; channels that are not named by the errors stay as they are.
        instruments: of outputs, with their errors.
        input_bias, input_scale: of signals that a model takes as its inputs, inputs or outputs of the record.

    Raises:
        InputError: when an instrument has a lag.
    """
    if record.is_stack:
        return stack([without_errors(one, instruments, input_bias, input_scale) for one in record])
    for name in instruments.lag.channels:
        require(
            float(instruments.lag[name]) == 0.0,
            f"{name} lags by {float(instruments.lag[name]):.3g} s. Taking a lag out raises the noise with its derivative, so "
            "it is not done here: smooth the channel first, or estimate a delay in its place.",
        )
    u, z, mask = (np.array(part) for part in (record.u, record.z, record.mask))
    for name in input_bias.channels:
        for at, names in ((u, record.inputs), (z, record.outputs)):
            if name in names:
                k = names.index(name)
                at[:, k] = (at[:, k] - float(input_bias[name])) / (1.0 + float(input_scale[name]))
    for name in set(instruments.channels) & set(record.outputs):
        k = record.outputs.index(name)
        late = float(instruments.delay[name]) if name in instruments.delay.channels else 0.0
        if late:
            z[:, k], mask[:, k] = earlier(np.asarray(record.t), z[:, k], mask[:, k], late)
        z[:, k] = (z[:, k] - float(instruments.bias[name])) / (1.0 + float(instruments.scale[name]))
    z = np.where(mask, z, 0.0)
    return dataclasses.replace(record, u=jnp.asarray(u), z=jnp.asarray(z), mask=jnp.asarray(mask))


def earlier(
    t: Float[np.ndarray, " time"], z: Float[np.ndarray, " time"], mask: Bool[np.ndarray, " time"], delay: float
) -> tuple[Float[np.ndarray, " time"], Bool[np.ndarray, " time"]]:
    """A channel that was recorded late, as it was at the times of its samples: `z(t + delay)`, by a cubic spline.

    Args:
        t: time [s].
        z: samples [any].
        mask: True where they are valid.
        delay: by how much it is late, negative for early [s].

    Returns:
        Values, zero where there are none, and the mask: True where the samples on both sides are valid.
    """
    asked = t + delay
    after = np.clip(np.searchsorted(t, asked, side="right"), 1, t.size - 1)
    known = mask[after - 1] & mask[after] & (asked >= t[0]) & (asked <= t[-1])
    if not known.any():
        return np.zeros_like(z), known
    with jax.numpy_rank_promotion("allow"):  # interpax promotes ranks inside
        spline = interpax.interp1d(np.where(known, asked, t[mask][0]), t[mask], z[mask], method="cubic2")
    return np.where(known, spline, 0.0), known
