"""Smoothing and derivatives of the channels of a record."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy

from ..._foundation.checks import InputError, require, require_known, require_unique
from ..record import Record
from ..stack import stack
from ..units import to_si
from .method import AbstractSmoother, Smoothed


def smooth(
    record: Record,
    channels: Sequence[str],
    method: AbstractSmoother,
    *,
    longest_gap: float | int = 0.0,
) -> Record:
    """Return the record with the named channels smoothed, and all other data unchanged.

    Missing samples of an output stay missing. A stack is smoothed case by case.

    Args:
        record: a record or a stack.
        channels: names of inputs or outputs.
        method: `LocalPolynomial()`, `SmoothingSpline()` or `Fourier()`. Without a cut-off, the
            cut-off is estimated from each channel.
        longest_gap: longest gap that is filled by a monotone cubic before smoothing, from the
            sample before it to the sample after it [s]; longer gaps are refused.

    Returns:
        A record with the same channels.

    Raises:
        InputError: when a channel is unknown, a gap is longer than `longest_gap` or at an end, or
            the method refuses.
    """
    names = _named(channels, record)
    if record.is_stack:
        cases = [smooth(case, names, method, longest_gap=longest_gap) for case in record]
        return stack(cases, pad_to=record.t.shape[-1])
    u, z, mask = np.array(record.u), np.array(record.z), np.asarray(record.mask)
    for name in names:
        value = _run(record, name, method, longest_gap).value
        if name in record.inputs:
            u[:, record.inputs.index(name)] = value
        else:
            k = record.outputs.index(name)
            z[:, k] = np.where(mask[:, k], value, 0.0)
    return eqx.tree_at(lambda r: (r.u, r.z), record, (jnp.asarray(u), jnp.asarray(z)))


def differentiate(
    record: Record,
    channels: Mapping[str, str],
    method: AbstractSmoother,
    *,
    longest_gap: float | int = 0.0,
) -> Record:
    """Return the record with derivatives of channels as further outputs.

    An example is angular accelerations from measured rates:

        differentiate(flight, {"p": "pdot", "q": "qdot", "r": "rdot"}, Fourier())

    The derivative is missing at the samples where the channel is missing. A stack is processed case
    by case.

    Args:
        record: a record or a stack.
        channels: name of the derivative by name of the channel, an input or an output.
        method: as in `smooth`; `method(t, z).derivative_noise` is the noise of the derivative.
        longest_gap: as in `smooth` [s].

    Returns:
        A record with the same channels, followed by the derivatives [the channel's unit per second;
        no unit if the channel has none].

    Raises:
        InputError: when a channel is unknown, a derivative's name is already in use, a gap is
            longer than `longest_gap` or at an end, or the method refuses.
    """
    names = _named(tuple(channels), record)
    require_unique(
        "channel", (*record.inputs, *record.outputs, *record.constants, *channels.values())
    )
    if record.is_stack:
        cases = [differentiate(case, channels, method, longest_gap=longest_gap) for case in record]
        return stack(cases, pad_to=record.t.shape[-1])
    valid = np.stack([~np.isnan(np.asarray(record.channel(name))) for name in names], axis=1)
    rates = np.stack([_run(record, name, method, longest_gap).derivative for name in names], axis=1)
    units = dict(
        zip(
            (*record.inputs, *record.outputs),
            (*record.input_units, *record.output_units),
            strict=True,
        )
    )
    return Record(
        t=record.t,
        u=record.u,
        z=jnp.asarray(np.concatenate([record.z, np.where(valid, rates, 0.0)], axis=1)),
        mask=jnp.asarray(np.concatenate([record.mask, valid], axis=1)),
        constants=record.constants,
        inputs=record.inputs,
        outputs=(*record.outputs, *channels.values()),
        input_units=record.input_units,
        output_units=(*record.output_units, *(_rate_of(units[name]) for name in names)),
        names=record.names,
    )


def _named(channels: Sequence[str], record: Record) -> tuple[str, ...]:
    """Names of channels as a tuple; unknown and repeated names are refused."""
    require(
        not isinstance(channels, str),
        f"`channels` is the string {channels!r}. Give a tuple: ({channels!r},).",
    )
    require(len(channels) > 0, "There is no channel to smooth. Name at least one.")
    require_known("channel", channels, (*record.inputs, *record.outputs))
    require_unique("channel", channels)
    return tuple(channels)


def _run(record: Record, name: str, method: AbstractSmoother, longest_gap: float | int) -> Smoothed:
    """Smooth one channel; error messages name the channel."""
    where = f"Record {record.names[0]!r}, channel {name!r}"
    t = np.asarray(record.t)
    z = _bridged(t, np.asarray(record.channel(name)), longest_gap, where)
    try:
        return method(t, z)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _bridged(t: np.ndarray, z: np.ndarray, longest_gap: float | int, where: str) -> np.ndarray:
    """Samples with their gaps filled by a monotone cubic; a gap that is too long or at an end is
    refused.
    """
    valid = np.flatnonzero(~np.isnan(z))
    if len(valid) == len(z):
        return z
    require(
        len(valid) > 0 and bool(valid[0] == 0 and valid[-1] == len(z) - 1),
        f"{where}: samples are missing at an end. Cut the record with `window` to the rows where "
        "they are valid.",
    )
    before, after = valid[:-1], valid[1:]
    length = np.where(after - before > 1, t[after] - t[before], 0.0)
    worst = int(np.argmax(length))
    require(
        bool(length[worst] <= longest_gap * (1 + 1e-9)),
        f"{where}: {after[worst] - before[worst] - 1} samples are missing after row "
        f"{before[worst]} (t = {t[before[worst]]:.6g} s), a gap of {length[worst]:.4g} s, and "
        f"`longest_gap` is {longest_gap}. Cut the record there, or increase `longest_gap` to have "
        "it filled.",
    )
    return np.where(np.isnan(z), scipy.interpolate.PchipInterpolator(t[valid], z[valid])(t), z)


def _rate_of(unit: str) -> str:
    """Unit of the derivative of a channel; "" if the channel has no unit."""
    return to_si(1.0, f"({unit})/s", "rate")[1] if unit else ""
