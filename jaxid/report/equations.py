"""Formulas of effects, as their docstrings state them."""

import inspect
import re
from typing import NamedTuple

from ..effects.base import Effect


class Formula(NamedTuple):
    """A formula and the words after it; one of them may be empty."""

    formula: str
    words: str


def equation(effect: Effect) -> str:
    """Return the formulas of an effect, one a line, "" if its docstring has none.

    Args:
        effect: the effect; the names of its channels replace the names of its fields.
    """
    names = {name: value for name, value in vars(effect).items() if isinstance(value, str)}
    lines = []
    for formula, words in formulas(type(effect)):
        inserted = re.sub(r"\w+", lambda word: names.get(word[0], word[0]), formula)
        lines.append("    ".join(filter(None, (inserted, words))))
    return "\n".join(lines)


def formulas(kind: type[Effect]) -> tuple[Formula, ...]:
    """Return the formulas at the start of the docstrings of a class and its bases.

    They are the code with an equals sign or an arrow in the summary, and the indented lines, which
    hold several formulas after a comma and two spaces, and words after three spaces.
    """
    parts = []
    for base in reversed(kind.__mro__):
        if issubclass(base, Effect):
            text = inspect.cleandoc(base.__doc__ or "")
            body = re.split(r"\n *(?:Args|Attributes|Source):", text)[0]
            summary = " ".join(body.split("\n\n")[0].split())
            parts += filter(_is_formula, re.findall(r"`([^`]+)`", summary))
            for line in re.findall(r"^    +(\S.*)$", body, re.MULTILINE):
                parts += re.split(r",  +", line)
    return tuple(dict.fromkeys(map(_formula, parts)))


def _formula(text: str) -> Formula:
    """Return the formula of a part of a line, and the words after it."""
    first, *words = re.split(r"   +", text.strip(" ,"))
    formula, before = (first, []) if _is_formula(first) else ("", [first])
    return Formula(formula, " ".join([*before, *words]))


def _is_formula(text: str) -> bool:
    return any(sign in text for sign in ("=", "->", "+ gain"))
