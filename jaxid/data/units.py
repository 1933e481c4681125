"""Units at the border: what a user writes (deg, ft/s, kt, lbf) becomes coherent SI with angles in radians."""

import difflib
import re
from fractions import Fraction
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from .._foundation.checks import InputError, require

# In the order in which they are printed, so that a torque reads N*m.
_NAMED = ("N", "Pa", "J", "W", "V", "ohm", "F", "C", "T", "H", "Wb", "Hz")
_BASE = {"kilogram": "kg", "ampere": "A", "meter": "m", "radian": "rad", "second": "s", "kelvin": "K"}
_BASE |= {"mole": "mol", "candela": "cd"}
_NO_UNIT = ("", "-", "1", "dimensionless")
# Words of the field that pint lacks, or reads as something else: to it `Nm` is nano-something, `kias` nothing.
_OWN_WORDS = {"psf": "lbf/ft**2", "gee": "standard_gravity", "Nm": "newton*meter"}
_OWN_WORDS |= dict.fromkeys(("kias", "kcas", "keas", "ktas", "KIAS", "KCAS", "KEAS", "KTAS"), "knot")
_COMMON = ["deg", "deg/s", "rad", "rad/s", "m", "ft", "m/s", "ft/s", "kt", "m/s^2", "g0", "N", "lbf", "Pa"]
_COMMON += ["psf", "psi", "N*m", "ft*lbf", "kg", "lb", "slug", "kg*m^2", "slug*ft^2", "s", "ms", "Hz", "rpm", "V", "mV"]


class _Meaning(NamedTuple):
    """`si_value = factor * value + offset`, exact; `kind` are the base units with their powers."""

    si: str
    factor: Fraction
    offset: Fraction
    kind: frozenset[tuple[str, Fraction]]


def to_si(values: Any, unit: str, channel: str) -> tuple[np.ndarray, str]:
    """Convert the values of a channel to the coherent SI unit of their kind.

    Named units stay named (lbf -> N, psf -> Pa, mV -> V), angles become radians (deg/s -> rad/s) and a unit that is
    SI already leaves the values as they are, bit for bit. Units without dimension end as "".

    Args:
        values: numbers of any shape [`unit`].
        unit: what they are measured in; "" for nothing known.
        channel: name used in the refusal.

    Returns:
        The values [the SI unit] and that unit, written like `kg*m^2` or `rad/s^2`.

    Raises:
        InputError: when the unit is unknown, ambiguous or logarithmic.
    """
    meaning = _understand(unit, channel)
    return _affine(np.asarray(values, float), meaning.factor, meaning.offset), meaning.si


def convert(values: Any, unit: str, to: str, channel: str = "") -> np.ndarray:
    """Convert values from one unit to another of the same kind.

    Args:
        values: numbers of any shape [`unit`].
        unit: what they are measured in.
        to: what they shall be measured in.
        channel: name used in the refusal.

    Returns:
        The values [`to`], of the same shape.

    Raises:
        InputError: when a unit is unknown, or the two measure different things (rad/s and Hz do).
    """
    a, b = _understand(unit, channel), _understand(to, channel)
    require(
        a.kind == b.kind,
        f"{_subject(channel)}{unit!r} cannot be converted to {to!r}: one is [{a.si}], the other [{b.si}]. "
        "Give a unit of the same kind.",
    )
    return _affine(np.asarray(values, float), a.factor / b.factor, (a.offset - b.offset) / b.factor)


def _affine(values: np.ndarray, factor: Fraction, offset: Fraction) -> np.ndarray:
    """`factor * value + offset`; what is one or zero is left out, so that signs of zero and last bits stay."""
    scaled = values if factor == 1 else values * float(factor)
    return np.asarray(scaled if offset == 0 else scaled + float(offset))


def _subject(channel: str) -> str:
    """The words that open a refusal."""
    return f"Channel {channel!r}: " if channel else ""


def _understand(unit: str, channel: str) -> _Meaning:
    """The meaning of a unit, or a refusal that names the channel."""
    text = unit.strip()
    require(
        not re.search(r"(?<![A-Za-z_])g(?![A-Za-z_0-9])", text),
        f"{_subject(channel)}the unit {unit!r} is ambiguous. Write 'g0' for the acceleration of gravity, 'gram' for "
        "the mass.",
    )
    try:
        return _meaning(text)
    except Exception as error:  # pint's parser ends in many kinds of error, from its own to those of the tokenizer
        words = [*_COMMON, *(word for word in _registry() if len(word) > 2 and not word.startswith("dB"))]
        near = difflib.get_close_matches(text, words, n=3, cutoff=0.6)
        hint = f"Did you mean {' or '.join(map(repr, near))}?" if near else f"Examples: {', '.join(_COMMON[:12])}."
        raise InputError(
            f"{_subject(channel)}the unit {unit!r} is not known, or not linear (as dB is). {hint} Write "
            "products as 'kg*m^2' and quotients as 'm/s^2'; leave the unit out, or give '', where there is none."
        ) from error


@cache
def _meaning(unit: str) -> _Meaning:
    """Translate factor by factor, so that a torque stays N*m and is not spelled out in kilograms."""
    if unit in _NO_UNIT:
        return _Meaning("", Fraction(1), Fraction(0), frozenset())
    registry = _registry()
    factors = registry.parse_units_as_container(_OWN_WORDS.get(unit, unit))
    powers: dict[str, Fraction] = {}
    scale, offset = Fraction(1), Fraction(0)
    for word, power in factors.items():
        name, factor, zero = _simple(word)
        if zero != 0:  # pint reads a temperature inside a product as a difference, so this one stands alone
            offset = zero
        scale *= factor**power
        for base, exponent in name.items():
            powers[base] = powers.get(base, Fraction(0)) + exponent * power
    powers = {base: power for base, power in powers.items() if power != 0}
    if powers == {"N": 1, "m": -2}:
        powers = {"Pa": Fraction(1)}
    return _Meaning(_spell(powers), Fraction(scale), offset, _kind(powers))


def _simple(word: str) -> tuple[dict[str, Fraction], Fraction, Fraction]:
    """SI units with powers, factor and offset of one simple unit, such as `foot`."""
    registry = _registry()
    zero, one, two = (registry.Quantity(Fraction(k), word).to_base_units() for k in (0, 1, 2))
    if two.magnitude - one.magnitude != one.magnitude - zero.magnitude:
        raise ValueError("the scale is not linear")
    items = frozenset((str(base), Fraction(power)) for base, power in one.unit_items())
    spelled = {_BASE.get(base, base): power for base, power in items}
    powers = {_named()[items]: Fraction(1)} if items in _named() else spelled
    return powers, Fraction(one.magnitude - zero.magnitude), Fraction(zero.magnitude)


def _kind(powers: dict[str, Fraction]) -> frozenset[tuple[str, Fraction]]:
    """Base units with powers; a hertz is no radian per second, so angles count."""
    if not powers:
        return frozenset()
    text = " * ".join(f"{base}**({power})" for base, power in powers.items())
    return frozenset(_registry().Quantity(Fraction(1), text).to_base_units().unit_items())


def _spell(powers: dict[str, Fraction]) -> str:
    """Write `{kg: 1, m: 2, s: -1}` as `kg*m^2/s`."""
    order = [*_NAMED, *_BASE.values()]
    ranked = sorted(powers.items(), key=lambda item: (order.index(item[0]) if item[0] in order else 99, item[0]))
    above = [_power(base, power) for base, power in ranked if power > 0]
    below = [_power(base, -power) for base, power in ranked if power < 0]
    return "/".join(["*".join(above) or "1", *below]) if powers else ""


def _power(base: str, power: Fraction) -> str:
    """Write one factor."""
    if power == 1:
        return base
    return f"{base}^{power}" if power.denominator == 1 else f"{base}^({power})"


@cache
def _registry() -> Any:
    """The one registry; with fractions, so that a foot is 0.3048 m and not a bit less."""
    import pint  # slow to import, and only units need it

    return pint.UnitRegistry(non_int_type=Fraction)  # pyright: ignore[reportArgumentType]  (pint takes any number)


@cache
def _named() -> dict[frozenset[tuple[str, Fraction]], str]:
    """Derived SI units by their base units."""
    registry = _registry()
    return {frozenset(registry.Quantity(Fraction(1), n).to_base_units().unit_items()): n for n in _NAMED}
