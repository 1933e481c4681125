"""Checks of the types of arguments, for callers without a type checker."""

from collections.abc import Mapping, Sequence
from typing import Any

from .._foundation.checks import require

# The remedy for a record without a channel that the model names.
OTHER_NAMES = (
    "A column of a file that has another name is named in `columns`, of `read_csv` or a study file."
)


def channel_names(names: Any, argument: str, where: str) -> tuple[str, ...]:
    """Return channel names as a tuple.

    A string is refused, which would be split into its letters, a mapping, whose values would be
    dropped, and a set, which has no order.

    Args:
        names: the argument.
        argument: its name.
        where: record or file, for the message.

    Raises:
        InputError: when it is no sequence of texts.
    """
    require(
        not isinstance(names, str),
        f"{where}: `{argument}` is the string {names!r}. Give a tuple of names, such as "
        f"({names!r},).",
    )
    require(
        not isinstance(names, Mapping),
        f"{where}: `{argument}` is a mapping. Give its names, such as tuple({argument}), and its "
        f"values as one array, such as np.column_stack([*{argument}.values()]).",
    )
    require(
        isinstance(names, Sequence) and not isinstance(names, bytes),
        f"{where}: `{argument}` is {_shown(names)}. Give a tuple of names, such as ('x',), in the "
        "order of the columns.",
    )
    for name in names:
        require(
            isinstance(name, str) and name != "",
            f"{where}: {_shown(name)} in `{argument}` is not a channel name. Give a non-empty "
            "string.",
        )
    return tuple(names)


def texts_by_name(values: Any, argument: str, where: str) -> dict[str, str]:
    """Return a mapping of names to texts; None is an empty one.

    Raises:
        InputError: when it is no such mapping.
    """
    mapping = by_name(values, argument, where)
    for key, value in mapping.items():
        require(
            isinstance(value, str),
            f"{where}: `{argument}` gives {key!r} the value {_shown(value)}. Give a text, such as "
            "'deg'.",
        )
    return mapping


def by_name(values: Any, argument: str, where: str) -> dict[str, Any]:
    """Return a mapping of names; None is an empty one.

    Raises:
        InputError: when it is no mapping, or a key is no text.
    """
    require(
        values is None or isinstance(values, Mapping),
        f"{where}: `{argument}` is {_shown(values)}. Give a dictionary, such as {{'x': ...}}.",
    )
    for key in values or {}:
        require(
            isinstance(key, str),
            f"{where}: {_shown(key)} in `{argument}` is not a name. Give a text.",
        )
    return dict(values or {})


def text(value: Any, argument: str, where: str) -> str:
    """Return a text.

    Raises:
        InputError: when it is none.
    """
    require(isinstance(value, str), f"{where}: `{argument}` is {_shown(value)}. Give a text.")
    return value


def _shown(value: Any) -> str:
    """Return value and type for a message, shortened."""
    return f"{repr(value)[:60]} (type {type(value).__name__})"
