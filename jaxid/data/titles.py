"""Units in the titles of columns, such as `alpha [deg]`, `Time (ms)` and `q_deg_s`."""

import re
from collections.abc import Collection, Mapping
from typing import NamedTuple

from .._foundation.checks import require
from .units import is_si, is_unit

# Units in round brackets that are read, in addition to units in SI and with signs such as `/`.
# Another one may be a word: `speed (R)`, `force (min)`.
_PLAIN = ("deg", "g", "g0", "ft", "kt", "kts", "knots", "lb", "lbs", "lbf", "psf", "psi", "slug")
_PLAIN += ("ms", "us", "mm", "cm", "km", "mph", "rpm", "mV", "mA", "hPa", "kPa", "mbar", "bar")
COMMON = frozenset((*_PLAIN, "degC", "kN", "kW", "kHz", "MPa", "dB"))
_SIGNS = re.compile(r"[/^*²³°µ%]")
# Endings of titles that are units, in lower or in upper case. Left out are endings that are words
# of a log as well, such as `in`, `min` and `g`.
ENDINGS = {unit: unit for unit in ("deg", "ft", "kt", "ms", "mm", "km", "rpm", "psf", "psi", "lbf")}
ENDINGS |= {"degs": "deg/s", "deg_s": "deg/s", "deg/s": "deg/s", "dps": "deg/s", "kts": "kt"}
ENDINGS |= {"deg_s2": "deg/s^2", "deg/s2": "deg/s^2", "deg/s^2": "deg/s^2", "knots": "kt"}
ENDINGS |= {"fps": "ft/s", "ft_s": "ft/s", "ft/s": "ft/s", "kmh": "km/h", "km/h": "km/h"}
_ANY_ENDING = "|".join(re.escape(end) for word in ENDINGS for end in (word, word.upper()))
_ENDING = re.compile(rf".+[_ .\-]({_ANY_ENDING})")


class Title(NamedTuple):
    """The title of a column.

    Attributes:
        name: the title without its unit in brackets.
        unit: the unit in brackets, "" if there is none.
        unclear: text that may be a unit or a word.
    """

    name: str
    unit: str
    unclear: str


def parse_title(title: str) -> Title:
    """Return name and unit of a title.

    Text in square brackets is a unit, but for a number (`xyz[1]`). Text in round brackets is one if
    it is common, in SI, or has a sign of units such as `/`; another known unit there is unclear,
    and so is an ending such as `_deg`.
    """
    square = re.fullmatch(r"(.*?)\s*\[([^\]]*)\]", title)
    if square is not None:
        unit = square[2].strip()
        return Title(square[1], "" if unit.isdigit() else unit, "")
    rounded = re.fullmatch(r"(.*?)\s*\(([^()]*)\)", title)
    if rounded is not None:
        unit = rounded[2].strip()
        if unit in COMMON or _SIGNS.search(unit) or is_si(unit):
            return Title(rounded[1], unit, "")
        return Title(title, "", unit if is_unit(unit) else "")
    ending = _ENDING.fullmatch(title)
    return Title(title, "", "" if ending is None else ENDINGS[ending[1].lower()])


def units_of_titles(
    titles: Mapping[str, str], known: Collection[str], where: str
) -> dict[str, str]:
    """Return the units in titles of columns, by name, without columns that have none.

    Args:
        titles: title by name.
        known: names whose unit is known; their titles are not read.
        where: the file or table, for the message.

    Raises:
        InputError: when a title has what may be a unit.
    """
    units = {
        name: _unit_of_title(title, where) for name, title in titles.items() if name not in known
    }
    return {name: unit for name, unit in units.items() if unit}


def _unit_of_title(title: str, where: str) -> str:
    """Return the unit in the title of a column, "" if there is none."""
    _, unit, unclear = parse_title(title)
    require(
        not unclear,
        f"{where}: the title {title!r} seems to hold the unit {unclear!r}, and no unit is given. "
        f"Give `units={{{title!r}: {unclear!r}}}`, or `''` in its place for numbers in SI.",
    )
    return unit
