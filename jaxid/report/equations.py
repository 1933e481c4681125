"""Equations of effects, as their docstrings state them, with the names of an effect inserted."""

import inspect
import re

from ..effects.base import Effect


def equation(effect: Effect) -> str:
    """Return the equation of an effect, "" if its docstring has none.

    It is the first code of the summary that changes or defines something, as
    `d(state)/dt += gain * product`, else the first indented block.

    Args:
        effect: the effect; the names of its channels replace the names of its fields.
    """
    text = (inspect.getdoc(type(effect)) or "").partition("Args:")[0]
    summary = text.partition("\n\n")[0]
    inline = [code for code in re.findall(r"`([^`]+)`", summary) if re.search(r"->|=|[+]", code)]
    blocks = re.findall(r"(?:^ {4,}\S.*\n?)+", text, re.MULTILINE)
    lines = (inline or blocks or [""])[0].splitlines()
    return _inserted("\n".join(line.strip() for line in lines), effect)


def _inserted(text: str, effect: Effect) -> str:
    """Return an equation with the values of an effect's fields that are texts."""
    for name, value in vars(effect).items():
        if isinstance(value, str):
            text = re.sub(rf"\b{re.escape(name)}\b", lambda _, value=value: value, text)
    return text
