"""Columns, signs and units of a file by channel, as the arguments of the readers give them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from ..._foundation.checks import require, require_known, require_unique
from ..arguments import by_name, texts_by_name


def columns_by_channel(
    columns: Mapping[str, str] | None, wanted: Sequence[str], path: Path
) -> dict[str, str]:
    """Column of the file by channel, for all channels and the time."""
    given = texts_by_name(columns, "columns", path.name)
    require_known(f"channel in `columns` of {path.name}", given, wanted, "Write {channel: column}.")
    return {name: given.get(name, name) for name in wanted}


def signs_by_channel(
    signs: Mapping[str, int] | None, channels: Sequence[str], path: Path
) -> dict[str, int]:
    """Signs of the channels that have one, 1 or -1."""
    given = by_name(signs, "signs", path.name)
    require_known(f"channel in `signs` of {path.name}", given, channels)
    for name, sign in given.items():
        require(sign in (1, -1), f"{path.name}: the sign of {name!r} is {sign!r}. Give 1 or -1.")
    return given


def units_by_channel(
    units: Mapping[str, str] | None, column_of: Mapping[str, str], path: Path
) -> dict[str, str]:
    """Units by channel, where some may be given by column; constants keep their names."""
    given = texts_by_name(units, "units", path.name)
    channel_of = {column: name for name, column in column_of.items() if column != name}
    names = [name if name in column_of else channel_of.get(name, name) for name in given]
    require_unique(f"unit in {path.name}:", names)
    return dict(zip(names, given.values(), strict=True))
