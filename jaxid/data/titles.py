"""Units in the titles of columns, such as `alpha [deg]`, `Time (ms)` and `q_deg_s`."""

import json
import re
from collections.abc import Collection, Mapping
from typing import NamedTuple

from .._foundation.checks import InputError
from .units import is_si, is_unit

# Units in round brackets that are read, in addition to units in SI and with signs such as `/`.
# Another one may be a word: `speed (R)`, `force (min)`.
_PLAIN = ("deg", "g", "g0", "ft", "kt", "kts", "knots", "lb", "lbs", "lbf", "psf", "psi", "slug")
_PLAIN += ("ms", "us", "mm", "cm", "km", "mph", "rpm", "mV", "mA", "hPa", "kPa", "mbar", "bar")
COMMON = frozenset((*_PLAIN, "degC", "kN", "kW", "kHz", "MPa", "dB"))
_SIGNS = re.compile(r"[/^*²³°µ%]")
# Endings of titles that are units, in lower or in upper case. Left out are endings that are words
# of a log as well, such as `in`; `us`, `min` and `g` count after names of times and accelerations.
ENDINGS = {unit: unit for unit in ("deg", "ft", "kt", "ms", "mm", "km", "rpm", "psf", "psi", "lbf")}
ENDINGS |= {"degs": "deg/s", "deg_s": "deg/s", "deg/s": "deg/s", "dps": "deg/s", "kts": "kt"}
ENDINGS |= {"deg_s2": "deg/s^2", "deg/s2": "deg/s^2", "deg/s^2": "deg/s^2", "knots": "kt"}
ENDINGS |= {"fps": "ft/s", "ft_s": "ft/s", "ft/s": "ft/s", "kmh": "km/h", "km/h": "km/h"}
_ANY_ENDING = "|".join(re.escape(end) for word in ENDINGS for end in (word, word.upper()))
_ENDING = re.compile(rf".+[_ .\-]({_ANY_ENDING})")
_CASED_ENDING = re.compile(r".+[_ .\-](m[AV]|[hkM]Pa|kN|kW|kHz)")
_AFTER_A_NAME = (
    re.compile(r"(?:.*[_ .\-])?(?:t|dt|time|timestamp|clock)[_ .\-](us|min)", re.IGNORECASE),
    re.compile(r"(?:.*[_ .\-])?(?:[an][xyz]|acc|accel)[_ .\-](g)", re.IGNORECASE),
)


class UnclearUnitError(InputError):
    """Titles of columns that may hold units.

    Args:
        where: the file or table.
        units: the unit that each title may hold, by title.
        is_toml: True where the option stands in a study file.
    """

    def __init__(self, where: str, units: dict[str, str], is_toml: bool = False):
        super().__init__(where, units, is_toml)

    def __str__(self) -> str:
        where, units, is_toml = self.args
        titles, texts = (", ".join(map(repr, words)) for words in (units, units.values()))
        one = len(units) == 1
        return (
            f"{where}: the title{'s' * (not one)} {titles} seem{'s' * one} to hold the "
            f"unit{'s' * (not one)} {texts}, and no unit is given. "
            f"Give `{_option(units, is_toml)}`, or `''` in its place for numbers in SI."
        )

    def in_toml(self) -> "UnclearUnitError":
        """Return the error with the option as it stands in a study file."""
        return UnclearUnitError(*self.args[:2], is_toml=True)


def _option(units: dict[str, str], is_toml: bool) -> str:
    """Return the option that states units, as the user would write it."""
    if not is_toml:
        return f"units={units!r}"
    pairs = ([json.dumps(text, ensure_ascii=False) for text in pair] for pair in units.items())
    return f"units = {{ {', '.join(' = '.join(pair) for pair in pairs)} }}"


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
    and so is an ending such as `_deg`, or `_us` after the name of a time.
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
    return Title(title, "", _unit_of_ending(title))


def _unit_of_ending(title: str) -> str:
    """Return the unit that the ending of a title may be, "" if there is none."""
    ending = _ENDING.fullmatch(title)
    if ending is not None:
        return ENDINGS[ending[1].lower()]
    cased = _CASED_ENDING.fullmatch(title)
    if cased is not None:
        return cased[1]
    named = next(filter(None, (pattern.fullmatch(title) for pattern in _AFTER_A_NAME)), None)
    unit = "" if named is None else named[1].lower()
    return "g0" if unit == "g" else unit


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
    parsed = {name: parse_title(title) for name, title in titles.items() if name not in known}
    unclear = {titles[name]: title.unclear for name, title in parsed.items() if title.unclear}
    if unclear:
        raise UnclearUnitError(where, unclear)
    return {name: title.unit for name, title in parsed.items() if title.unit}
