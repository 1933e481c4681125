"""Smoothing and derivatives of the channels of a record."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require, require_known, require_unique
from .record import Record
from .smoothing_method import AbstractSmoother, Smoothed
from .stack import stack
from .units import to_si


def smooth(
    record: Record, channels: Sequence[str], method: AbstractSmoother, *, longest_gap: float | int = 0.0
) -> Record:
    """The record with the named channels replaced by their smoothed values; all else stays as it is.

    Samples of an output that were missing stay missing. A stack is smoothed case by case.

    Args:
        record: a record or a stack.
        channels: names of inputs or outputs.
        method: `LocalPolynomial()`, `SmoothingSpline()` or `Fourier()`, with a cut-off or without: then it is estimated from
            each channel.
        longest_gap: gaps of at most this length, from the sample before to the sample after, are bridged by a monotone cubic
            for the smoother to run over [s]; others are refused.

    Returns:
        A record with the same channels.

    Raises:
        InputError: when a channel is unknown, a gap is longer than `longest_gap` or at an end, or the method refuses.
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
    record: Record, channels: Mapping[str, str], method: AbstractSmoother, *, longest_gap: float | int = 0.0
) -> Record:
    """The record with derivatives of channels as further outputs, such as angular accelerations of measured rates.

        differentiate(flight, {"p": "pdot", "q": "qdot", "r": "rdot"}, Fourier())

    A sample that is missing in the channel is missing in its derivative. A stack is treated case by case.

    Args:
        record: a record or a stack.
        channels: name of the derivative by name of the channel, an input or an output.
        method: as in `smooth`; how much noise it leaves says `method(t, z).derivative_noise`.
        longest_gap: as in `smooth` [s].

    Returns:
        A record with the channels of this one unchanged, and the derivatives after them [the channel's unit per second; none
        where the channel has none].

    Raises:
        InputError: when a channel is unknown, a derivative's name is there already, a gap is longer than `longest_gap` or at
            an end, or the method refuses.
    """
    names = _named(tuple(channels), record)
    require_unique("channel", (*record.inputs, *record.outputs, *record.constants, *channels.values()))
    if record.is_stack:
        cases = [differentiate(case, channels, method, longest_gap=longest_gap) for case in record]
        return stack(cases, pad_to=record.t.shape[-1])
    valid = np.stack([~np.isnan(np.asarray(record.channel(name))) for name in names], axis=1)
    rates = np.stack([_run(record, name, method, longest_gap).derivative for name in names], axis=1)
    units = dict(zip((*record.inputs, *record.outputs), (*record.input_units, *record.output_units), strict=True))
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
    """The names of channels as a tuple, each there and once."""
    require(not isinstance(channels, str), f"`channels` is the string {channels!r}. Give a tuple: ({channels!r},).")
    require(len(channels) > 0, "There is no channel to smooth. Name at least one.")
    require_known("channel", channels, (*record.inputs, *record.outputs))
    require_unique("channel", channels)
    return tuple(channels)


def _run(record: Record, name: str, method: AbstractSmoother, longest_gap: float | int) -> Smoothed:
    """The method at work on one channel; its refusals name the channel."""
    where = f"Record {record.names[0]!r}, channel {name!r}"
    t = np.asarray(record.t)
    z = _bridged(t, np.asarray(record.channel(name)), longest_gap, where)
    try:
        return method(t, z)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _bridged(t: np.ndarray, z: np.ndarray, longest_gap: float | int, where: str) -> np.ndarray:
    """The samples with their gaps filled by a monotone cubic; a gap too long, or at an end, is refused."""
    there = np.flatnonzero(~np.isnan(z))
    if len(there) == len(z):
        return z
    require(
        len(there) > 0 and bool(there[0] == 0 and there[-1] == len(z) - 1),
        f"{where}: samples are missing at an end. Cut the record with `window` to the rows where they are valid.",
    )
    before, after = there[:-1], there[1:]
    length = np.where(after - before > 1, t[after] - t[before], 0.0)
    worst = int(np.argmax(length))
    require(
        bool(length[worst] <= longest_gap * (1 + 1e-9)),
        f"{where}: {after[worst] - before[worst] - 1} samples are missing after row {before[worst]} (t = "
        f"{t[before[worst]]:.6g} s), a gap of {length[worst]:.4g} s, and `longest_gap` is {longest_gap}. Cut the record "
        "there, or allow gaps of this length to be bridged.",
    )
    from scipy.interpolate import PchipInterpolator  # slow to import, and only gaps need it

    return np.where(np.isnan(z), PchipInterpolator(t[there], z[there])(t), z)


def _rate_of(unit: str) -> str:
    """The unit of a rate; what has no unit, or an unknown one, has a rate without."""
    return to_si(1.0, f"({unit})/s", "rate")[1] if unit else ""
