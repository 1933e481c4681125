"""Check of measured channels against their rates, which shows a wrong unit or sign.

The equation of a position, an angle or an altitude often has no parameter: its rate is known from
other measured channels, and its integral must move as the channel does.
"""

import dataclasses
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.compiler import fast_compile_jit
from ...data.record import Record
from ...data.units import to_si
from ...models.base import AbstractModel
from ...models.names import flatten
from .channels import Measured
from .findings import Finding, FindingKind
from .thresholds import RATE_FACTOR, RATE_SHARE, UNIT_TOLERANCE

NO_CHANGE = 1e-12  # chosen: relative change of a rate up to which it is rounding
# Units of a channel, and of its rate, that are mistaken for the SI unit.
MISTAKEN = {
    "m": (("ft", "mm", "cm", "km"), ("ft/s", "km/h", "mm/s", "cm/s")),
    "rad": (("deg",), ("deg/s", "rpm")),
}


def rates_and_channels(record: Measured, rates: dict[str, np.ndarray]) -> Iterator[Finding]:
    """Findings on channels that do not move as the integral of their rate.

        z = c + d t + s integral of rate dt,    by least squares

    The trend d allows for a constant error of the rate, so that a steady climb alone shows nothing.
    A finding needs a share of `RATE_SHARE` of the motion that the integral explains, and a factor s
    that is negative or beyond `RATE_FACTOR`.

    Args:
        record: the record.
        rates: rate by name of the channel, shape (time,), from `measured_rates`.
    """
    table = dict(zip(record.inputs, record.u.T, strict=True))
    table |= dict(zip(record.outputs, record.z.T, strict=True))
    for name, rate in rates.items():
        z = table[name]
        valid = np.isfinite(z)
        steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(record.t)
        both = np.stack([z, np.concatenate([[0.0], np.cumsum(steps)])], axis=1)[valid]
        trend = np.stack([np.ones(valid.sum()), record.t[valid]], axis=1)
        moved, integral = (both - trend @ np.linalg.lstsq(trend, both, rcond=None)[0]).T
        power = (moved @ moved) * (integral @ integral)
        product = moved @ integral
        if not power > 0 or product**2 < RATE_SHARE * power:
            continue
        ratio = float(product / (integral @ integral))
        if not 1.0 / RATE_FACTOR < ratio < RATE_FACTOR:
            numbers = {"ratio": ratio, "share": float(product**2 / power)}
            words = likely_cause(ratio, record.units[name])
            yield Finding(FindingKind.RATE, record.name, (name,), numbers, (words,))


def likely_cause(ratio: float, unit: str) -> str:
    """Return the unit or sign that explains a ratio of a channel to its integrated rate, in words.

    Args:
        ratio: the ratio.
        unit: unit of the channel, "" if unknown.
    """
    causes = [
        words
        for kind, words, expected in _causes()
        if unit in ("", kind) or not kind
        if abs(np.log(max(ratio / expected, 1e-300))) < UNIT_TOLERANCE
    ]
    return ", or ".join(causes) or "a unit, or another quantity than its name states"


def _causes() -> Iterator[tuple[str, str, float]]:
    """Unit of the channel, cause in words, and the ratio that it gives."""
    for kind, (of_channel, of_rate) in MISTAKEN.items():
        yield from ((kind, f"it is in {u}", 1.0 / float(to_si(1.0, u, "")[0])) for u in of_channel)
        yield from ((kind, f"its rate is in {u}", float(to_si(1.0, u, "")[0])) for u in of_rate)
    yield "", "time is in ms", 1e-3
    yield "", "one of them has the opposite sign", -1.0


def measured_rates(
    model: AbstractModel, record: Record, measured: Measured
) -> dict[str, np.ndarray]:
    """Return the rates of channels that follow from the measured channels without a parameter.

    These are the equations of measured states, and the model's `input_rates`, that change neither
    with the parameters nor with states that are not measured.

    Args:
        model: the model.
        record: a single record with the channels of the model.
        measured: the same record as NumPy arrays.
    """
    filled = [_filled(measured.t, column) for column in measured.z.T]
    z = jnp.asarray(np.stack(filled, axis=1))
    rates, fixed = _rates(model, record.anonymous(), z)
    channels = (*measured.inputs, *measured.outputs)
    return {
        name: np.asarray(rate)
        for name, rate in rates.items()
        if name in channels and bool(fixed[name]) and np.isfinite(rate).all()
    }


def _filled(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return a channel with missing samples interpolated."""
    valid = np.isfinite(values)
    return np.interp(t, t[valid], values[valid]) if valid.any() else np.zeros(len(t))


@fast_compile_jit
def _rates(model: AbstractModel, record: Record, z):
    """Return rates by name, and whether each depends on measured channels only."""
    vector, unflatten = flatten(model)
    keys = jax.random.split(jax.random.key(0), 2)
    other = vector * jax.random.uniform(keys[0], vector.shape, minval=0.8, maxval=1.2)

    def state(t, u, z):
        mask = jnp.ones((1, z.size), bool)
        sample = dataclasses.replace(record, t=t[None], u=u[None], z=z[None], mask=mask)
        return jnp.asarray(model.initial_state(sample), float)

    def rates(vector, t, x, u):
        chosen = unflatten(vector)
        return dict(zip(model.states, chosen.rhs(t, x, u), strict=True)) | chosen.input_rates(
            t, x, u
        )

    t, u, along = record.t, record.u, jax.vmap(rates, in_axes=(None, 0, 0, 0))
    x = jax.vmap(state)(t, u, z)
    unknown = jnp.all(x == x[:1], axis=0)  # a state that does not follow the record
    moved = x + jnp.where(unknown, jax.random.uniform(keys[1], unknown.shape), 0.0)[None]
    value, changed = along(vector, t, x, u), along(other, t, moved, u)

    def is_fixed(name):
        difference, size = (jnp.max(jnp.abs(x)) for x in (value[name] - changed[name], value[name]))
        return difference <= NO_CHANGE * size

    return value, {name: is_fixed(name) for name in value}
