"""Conversion of users' units (deg, ft/s, kt, lbf) to coherent SI units, angles in radians."""

import difflib
import re
from fractions import Fraction
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from .._foundation.checks import InputError, require

# Derived SI units in the order in which they are printed: a torque is N*m.
_DERIVED_UNITS = ("N", "Pa", "J", "W", "V", "ohm", "farad", "coulomb", "T", "H", "Wb", "Hz")
_BASE_SYMBOLS = {
    "kilogram": "kg",
    "ampere": "A",
    "meter": "m",
    "radian": "rad",
    "second": "s",
    "kelvin": "K",
}
_BASE_SYMBOLS |= {"mole": "mol", "candela": "cd"}
_NO_UNIT = ("", "-", "1", "dimensionless")
# Units of the field that pint does not know (`kias`), or that it parses as another unit (`Nm`, with
# the prefix nano).
_ALIASES = {"psf": "lbf/ft**2", "gee": "standard_gravity", "Nm": "newton*meter"}
_ALIASES |= {"pct": "percent", "Pct": "percent", "PCT": "percent", "mb": "millibar"}
_ALIASES |= dict.fromkeys(("kias", "kcas", "keas", "ktas", "KIAS", "KCAS", "KEAS", "KTAS"), "knot")
_GRAVITY = "Write 'g0' for the acceleration of gravity"
# Units of pint that usually stand for another unit in flight data, with the remedy.
_AMBIGUOUS = {
    "g": f"{_GRAVITY}, 'gram' for the mass.",
    "G": f"{_GRAVITY}, 'gauss' for the magnetic flux density.",
    "Gs": f"{_GRAVITY}, 'gigasecond' for the time.",
    "U": "'U' is a revolution (Umdrehung) in German, and the enzyme unit in biochemistry. Write "
    "'rpm' for revolutions in a minute.",
    "C": "Write 'degC' for the temperature, 'coulomb' for the charge.",
    "F": "Write 'degF' for the temperature, 'farad' for the capacitance.",
    "R": "Write 'degR' for the temperature; 'R' is the gas constant as well.",
    "M": "Give a Mach number no unit (''); write 'molar' for the concentration.",
    "nm": "Write 'nmi' for nautical miles, 'nanometer' for the length.",
}
_COMMON_UNITS = [
    "deg",
    "deg/s",
    "rad",
    "rad/s",
    "m",
    "ft",
    "m/s",
    "ft/s",
    "kt",
    "m/s^2",
    "g0",
    "N",
    "lbf",
    "Pa",
]
_COMMON_UNITS += [
    "psf",
    "psi",
    "N*m",
    "ft*lbf",
    "kg",
    "lb",
    "slug",
    "kg*m^2",
    "slug*ft^2",
    "s",
    "ms",
    "Hz",
    "rpm",
    "V",
    "mV",
]


class _Conversion(NamedTuple):
    """Exact conversion of one unit to SI, `si_value = factor * value + offset`.

    Attributes:
        si: the SI unit.
        factor: exact factor.
        offset: exact offset [SI unit].
        kind: base units with their powers.
    """

    si: str
    factor: Fraction
    offset: Fraction
    kind: frozenset[tuple[str, Fraction]]


def to_si(values: Any, unit: str, channel: str) -> tuple[np.ndarray, str]:
    """Convert the values of a channel to the coherent SI unit of their kind.

    Derived units remain derived units (lbf -> N, psf -> Pa, mV -> V), and angles become radians
    (deg/s -> rad/s). Values whose unit is an SI unit stay unchanged, bit for bit. The SI unit of a
    quantity without dimension is "".

    Args:
        values: numbers of any shape [`unit`].
        unit: unit of the values; "" when unknown.
        channel: name of the channel, used in the error message.

    Returns:
        The values [the SI unit] and the SI unit, in the form `kg*m^2` or `rad/s^2`.

    Raises:
        InputError: when the unit is unknown, ambiguous or logarithmic.
    """
    conversion = _checked_conversion(unit, channel)
    return _affine(np.asarray(values, float), conversion.factor, conversion.offset), conversion.si


def convert(values: Any, unit: str, to: str, channel: str = "") -> np.ndarray:
    """Convert values from one unit to another of the same kind.

    Args:
        values: numbers of any shape [`unit`].
        unit: unit of the values.
        to: unit of the result.
        channel: name of the channel, used in the error message.

    Returns:
        The values [`to`], of the same shape.

    Raises:
        InputError: when a unit is unknown, or the units are of different kinds (as rad/s and Hz).
    """
    a, b = _checked_conversion(unit, channel), _checked_conversion(to, channel)
    require(
        a.kind == b.kind,
        f"{_subject(channel)}{unit!r} cannot be converted to {to!r}: one is [{a.si}], the other "
        f"[{b.si}]. Give a unit of the same kind.",
    )
    return _affine(np.asarray(values, float), a.factor / b.factor, (a.offset - b.offset) / b.factor)


def is_unit(text: str) -> bool:
    """Return True for a text that is parsed as a unit; a word may be one, as `min` or `R`."""
    try:
        _registry().parse_units_as_container(_ALIASES.get(text, text))
    except Exception:  # pint raises many types of exception
        return False
    return text != ""


def is_si(text: str) -> bool:
    """Return True for a unit in SI with radians: its numbers are not converted."""
    try:
        _, factor, offset, _ = _conversion(text)
    except Exception:  # as above
        return False
    return text != "" and factor == 1 and offset == 0


def are_equal(unit: str, other: str) -> bool:
    """Return True for two units in which a quantity has the same number, as N*m and kg*m^2/s^2."""
    try:
        a, b = _checked_conversion(unit, ""), _checked_conversion(other, "")
    except InputError:
        return unit == other
    return (a.kind, a.factor, a.offset) == (b.kind, b.factor, b.offset)


def _affine(values: np.ndarray, factor: Fraction, offset: Fraction) -> np.ndarray:
    """Return `factor * value + offset`.

    A factor of one and an offset of zero are not applied, so that the values stay the same bit for
    bit, including the sign of zero.
    """
    scaled = values if factor == 1 else values * float(factor)
    return np.asarray(scaled if offset == 0 else scaled + float(offset))


def _subject(channel: str) -> str:
    """The first words of an error message."""
    return f"Channel {channel!r}: " if channel else ""


def _checked_conversion(unit: str, channel: str) -> _Conversion:
    """Return the conversion of a unit to SI.

    Raises:
        InputError: when the unit is unknown, ambiguous or not linear.
    """
    text = unit.strip()
    for word in re.findall(r"°?[^\W\d]\w*", text):
        require(
            word not in _AMBIGUOUS,
            f"{_subject(channel)}the unit {unit!r} is ambiguous. {_AMBIGUOUS.get(word)}",
        )
    prefixed = _prefixed_angle(text)
    require(
        not prefixed,
        f"{_subject(channel)}the unit {unit!r} is parsed as {prefixed}, an angle with an SI "
        "prefix. Write 'deg' for degrees, 'rad' for radians or 'gon' for 1/400 of a turn, and "
        "scale the values where a prefix is meant.",
    )
    try:
        return _conversion(text)
    # Pint raises many types of exception, from its own to those of the tokenizer.
    except Exception as error:
        known = (word for word in _registry() if len(word) > 2 and not word.startswith("dB"))
        words = list(dict.fromkeys((*_COMMON_UNITS, *known)))
        near = difflib.get_close_matches(text, words, n=3, cutoff=0.6)
        hint = (
            f"Did you mean {' or '.join(map(repr, near))}?"
            if near
            else f"Examples: {', '.join(_COMMON_UNITS[:12])}."
        )
        raise InputError(
            f"{_subject(channel)}the unit {unit!r} is not known, or not linear (dB is not). {hint} "
            "Write products as 'kg*m^2' and quotients as 'm/s^2'; leave the unit out, or give '', "
            "where there is none."
        ) from error


@cache
def _prefixed_angle(unit: str) -> str:
    """The first factor of a unit that is an angle with an SI prefix, or "".

    Pint parses `Grad`, the German word for degree, as gigaradian.
    """
    registry = _registry()
    try:
        words = list(registry.parse_units_as_container(_ALIASES.get(unit, unit)))
    except Exception:  # `_conversion` refuses this unit, with the reason
        return ""
    for word in words:
        parsed = registry.parse_unit_name(word)
        if parsed and parsed[0][0] and dict(_kind({word: Fraction(1)})) == {"radian": 1}:
            return word
    return ""


@cache
def _conversion(unit: str) -> _Conversion:
    """Convert a unit factor by factor, so that a torque stays N*m instead of base units."""
    if unit in _NO_UNIT:
        return _Conversion("", Fraction(1), Fraction(0), frozenset())
    registry = _registry()
    factors = registry.parse_units_as_container(_ALIASES.get(unit, unit))
    powers: dict[str, Fraction] = {}
    scale, offset = Fraction(1), Fraction(0)
    for word, power in factors.items():
        name, factor, zero = _simple(word)
        # Only a temperature has an offset, and it is not part of a product: pint parses a
        # temperature inside a product as a difference.
        if zero != 0:
            offset = zero
        scale *= factor**power
        for base, exponent in name.items():
            powers[base] = powers.get(base, Fraction(0)) + exponent * power
    powers = {base: power for base, power in powers.items() if power != 0}
    if powers == {"N": 1, "m": -2}:
        powers = {"Pa": Fraction(1)}
    return _Conversion(_unit_text(powers), Fraction(scale), offset, _kind(powers))


class _Simple(NamedTuple):
    """A simple unit in terms of SI units: `value_si = factor value + zero`.

    Attributes:
        powers: of the SI units, by name.
        factor: SI units in one of it.
        zero: its zero in SI units.
    """

    powers: dict[str, Fraction]
    factor: Fraction
    zero: Fraction


def _simple(word: str) -> _Simple:
    """SI units with powers, factor and offset of one simple unit, such as `foot`."""
    registry = _registry()
    zero, one, two = (registry.Quantity(Fraction(k), word).to_base_units() for k in (0, 1, 2))
    if two.magnitude - one.magnitude != one.magnitude - zero.magnitude:
        raise ValueError("the scale is not linear")
    items = frozenset((str(base), Fraction(power)) for base, power in one.unit_items())
    symbols = {_BASE_SYMBOLS.get(base, base): power for base, power in items}
    powers = {_derived_units()[items]: Fraction(1)} if items in _derived_units() else symbols
    return _Simple(powers, Fraction(one.magnitude - zero.magnitude), Fraction(zero.magnitude))


def _kind(powers: dict[str, Fraction]) -> frozenset[tuple[str, Fraction]]:
    """Base units with powers. The radian is one of them: Hz and rad/s are different kinds."""
    if not powers:
        return frozenset()
    text = " * ".join(f"{base}**({power})" for base, power in powers.items())
    return frozenset(_registry().Quantity(Fraction(1), text).to_base_units().unit_items())


def _unit_text(powers: dict[str, Fraction]) -> str:
    """Return `kg*m^2/s` for `{kg: 1, m: 2, s: -1}`."""
    order = [*_DERIVED_UNITS, *_BASE_SYMBOLS.values()]
    ranked = sorted(
        powers.items(), key=lambda item: (order.index(item[0]) if item[0] in order else 99, item[0])
    )
    above = [_power(base, power) for base, power in ranked if power > 0]
    below = [_power(base, -power) for base, power in ranked if power < 0]
    return "/".join(["*".join(above) or "1", *below]) if powers else ""


def _power(base: str, power: Fraction) -> str:
    """Return one factor as text, such as `m^2`."""
    if power == 1:
        return base
    return f"{base}^{power}" if power.denominator == 1 else f"{base}^({power})"


@cache
def _registry() -> Any:
    """The registry of units, with exact fractions: a foot is 0.3048 m without rounding."""
    import pint  # imported here because it is slow to import

    # pint accepts any type of number
    return pint.UnitRegistry(non_int_type=Fraction)  # pyright: ignore[reportArgumentType]


@cache
def _derived_units() -> dict[frozenset[tuple[str, Fraction]], str]:
    """Names of the derived SI units, by their base units."""
    registry = _registry()
    return {
        frozenset(registry.Quantity(Fraction(1), n).to_base_units().unit_items()): n
        for n in _DERIVED_UNITS
    }
