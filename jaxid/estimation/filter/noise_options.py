"""Declarations of noise for `FilterError`: values that are estimated or fixed."""

import equinox as eqx
import numpy as np

from ..._foundation.checks import InputError, require
from ..._foundation.traced_checks import require_value
from ..._foundation.types import Array, Float
from ...models.base import as_float


class Fixed(eqx.Module):
    """A standard deviation or correlation time that is known and not estimated.

    Args:
        value: the number, in the unit of the noise.
    """

    value: Float[Array, ""]

    def __init__(self, value):
        self.value = as_float(value)


Number = Float[Array, ""] | Fixed
COLOURED = "noise_"  # and the output: names of the coloured parts of a sensor's noise


class FirstOrder(eqx.Module):
    """A disturbance with memory, the output of a first-order filter of white noise.

        d(d)/dt = -d/T + sqrt(2/T) s w,    var(d) = s^2,    autocovariance s^2 exp(-|tau|/T)

    Dryden's model of the gust along the flight path has this form, with T = scale length / speed.
    Sampled every h seconds, it is an autoregression of first order with the coefficient exp(-h/T).

    Args:
        deviation: standard deviation s [unit of the disturbance]: the start of its estimate, or
            `Fixed(s)`.
        correlation_time: T [s]: the start of its estimate, or `Fixed(T)`.
    """

    deviation: Number
    correlation_time: Number

    def __init__(self, deviation, correlation_time):
        self.deviation, self.correlation_time = number(deviation), number(correlation_time)


def number(value) -> Number:
    """Return a number as an array; `Fixed` unchanged.

    Raises:
        InputError: for anything else.
    """
    if isinstance(value, Fixed):
        return value
    require(
        not isinstance(value, str) and np.shape(value) == (),
        f"A noise is {value!r}. Give one number (the start of its estimate), `Fixed(number)`, or "
        "`FirstOrder(deviation, correlation_time)`.",
    )
    return as_float(value)


def value_of(option: Number) -> Float[Array, ""]:
    """Return the value, fixed or not."""
    return option.value if isinstance(option, Fixed) else option


def sensor_parts(name: str, option) -> tuple[Number | None, dict[str, FirstOrder]]:
    """Return the white part of a sensor's noise, None if it is not given, and its coloured parts by
    name: `noise_NAME`, or `noise_NAME_1`, ... of several.

    Args:
        name: the output.
        option: a number, a `FirstOrder`, or a sequence of them with at most one number.
    """
    parts = option if isinstance(option, (tuple, list)) else (option,)
    white = [part for part in parts if not isinstance(part, FirstOrder)]
    coloured = [part for part in parts if isinstance(part, FirstOrder)]
    require(
        len(parts) > 0,
        f"The noise of sensor {name!r} has no parts. Give one, or leave the sensor out: its white "
        "noise is then estimated.",
    )
    require(
        len(white) <= 1,
        f"The noise of sensor {name!r} has {len(white)} white parts. Give one number, and "
        "`FirstOrder` for the parts with memory.",
    )
    keys = [f"{COLOURED}{name}_{number}" for number in range(1, len(coloured) + 1)]
    if len(coloured) == 1:
        keys = [f"{COLOURED}{name}"]
    return number(white[0]) if white else None, dict(zip(keys, coloured, strict=True))


def check_number(option: Number, name: str, *, zero: bool) -> None:
    """Refuse a deviation or time that is negative, not finite, or zero where it cannot be.

    Args:
        option: the declaration.
        name: its name, for the message.
        zero: True if a fixed zero is permitted.
    """
    may_be_zero = zero and isinstance(option, Fixed)
    require_value(
        value_of(option),
        lambda v: np.isfinite(v) & ((v > 0) | (may_be_zero & (v == 0))),
        f"{name} is {{}}. Give a positive number"
        + (", or `Fixed(0.0)` for none." if zero else "."),
    )


def check_option(option, name: str, kinds: tuple[type, ...]) -> None:
    """Refuse an option of another kind."""
    if not isinstance(option, kinds):
        raise InputError(
            f"{name} is a {type(option).__name__}. Give a number (the start of its estimate), "
            "`Fixed(number)`, or, for a disturbance, `FirstOrder(deviation, correlation_time)`."
        )
