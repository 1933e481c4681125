"""Reading of signals with clocks of their own from logs: PX4 ULog and ASAM MDF files."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..._foundation.checks import InputError, require, require_known
from .assemble import existing, library

# `topic.field`, or `topic[1].field` for a further instance of a topic, such as a second gyro
ULOG_NAME = re.compile(r"(?P<topic>\w+)(?:\[(?P<instance>\d+)\])?\.(?P<field>.+)")


class Log(NamedTuple):
    """Signals of a log, as `resample` takes them.

    Attributes:
        signals: times [s] and values by name.
        units: units by name, where the file has them.
    """

    signals: dict[str, tuple[np.ndarray, np.ndarray]]
    units: dict[str, str]

    def __str__(self) -> str:
        width = max(map(len, self.signals), default=0)
        lines = []
        for name, (t, _) in self.signals.items():
            span = f"{t[0]:.3f} to {t[-1]:.3f} s" if t.size else "no sample"
            step = f", median step {np.median(np.diff(t)):.4g} s" if t.size > 1 else ""
            unit = f"  [{self.units[name]}]" if name in self.units else ""
            lines.append(f"{name:<{width}}  {t.size:>7} samples, {span}{step}{unit}")
        return "\n".join(lines)


def read_ulog(path: str | Path, signals: Mapping[str, str], *, accept_damage: bool = False) -> Log:
    """Read signals from a PX4 ULog file (pyulog, `jaxid[logs]`).

    Times are seconds from the start of the log, one clock for all topics. A ULog file has no units.

    Args:
        path: the file.
        signals: place of each signal in the file by its name in the result, such as
            `{"p": "vehicle_angular_velocity.xyz[0]"}`; `topic[1].field` is the second instance of a
            topic.
        accept_damage: return what can be read of a file that is damaged, as after a crash.

    Returns:
        The signals.

    Raises:
        InputError: when the file, a topic or a field is missing, the file is not ULog or is
            damaged, a field has no numbers, or pyulog is not installed.
    """
    path, wanted = existing(path), _ulog_places(signals)
    log = _parsed_ulog(path, sorted({topic for topic, _, _ in wanted.values()}))
    require(
        accept_damage or not log.file_corruption,
        f"{path.name} is damaged: a part of it cannot be read. Copy it from the vehicle again, or "
        "give accept_damage=True to use the rest.",
    )
    topics = {_ulog_topic(data.name, data.multi_id): data.data for data in log.data_list}
    labels = [_ulog_topic(topic, instance) for topic, instance, _ in wanted.values()]
    if not set(labels) <= set(topics):
        everything = _parsed_ulog(path, None).data_list
        known = sorted(_ulog_topic(data.name, data.multi_id) for data in everything)
        require_known(f"topic in {path.name}", labels, known)
    series = {}
    for (name, (_, _, field)), label in zip(wanted.items(), labels, strict=True):
        columns = topics[label]
        require_known(f"field of {label} in {path.name}", [field], sorted(columns))
        t = (columns["timestamp"].astype(float) - float(log.start_timestamp)) * 1e-6
        series[name] = (t, _numbers(columns[field], signals[name], path))
    return Log(series, {})


def read_mdf(path: str | Path, signals: Mapping[str, str | tuple[str, int]]) -> Log:
    """Read signals from an ASAM MDF file, version 2 to 4 (asammdf, `jaxid[logs]`).

    Times are seconds from the start of the measurement; raw values are converted by the rules of
    the file.

    Args:
        path: the file.
        signals: name of the channel in the file by the name in the result; `(channel, group)`
            where several groups have a channel of this name.

    Returns:
        The signals, with the units of the file.

    Raises:
        InputError: when the file or a channel is missing, a name stands for several channels, the
            file is not MDF or is damaged, a channel has no numbers, or asammdf is not installed.
    """
    path = existing(path)
    asammdf = library("asammdf", path, extra="logs")
    series, units = {}, {}
    with path.open("rb") as stream:  # asammdf leaves a file open that it cannot read
        try:
            file = asammdf.MDF(stream)
        except Exception as error:  # asammdf raises what its parsing meets
            raise _unreadable(path, "MDF", error) from error
        for name, place in signals.items():
            channel, group = (place, None) if isinstance(place, str) else place
            group = _mdf_group(path, file, channel, group)
            try:
                signal = file.get(channel, group=group)
            except Exception as error:
                raise _unreadable(path, "MDF", error) from error
            values = _numbers(signal.samples, channel, path)
            series[name] = (np.asarray(signal.timestamps, float), values)
            if signal.unit:
                units[name] = str(signal.unit)
    return Log(series, units)


def _ulog_places(signals: Mapping[str, str]) -> dict[str, tuple[str, int, str]]:
    """Return topic, instance and field of each signal."""
    places = {}
    for name, place in signals.items():
        match = ULOG_NAME.fullmatch(place)
        if match is None:
            raise InputError(
                f"{place!r}, the place of {name!r} in the log, is not a topic and a field. Write "
                "it as 'vehicle_angular_velocity.xyz[0]'; the command ulog_info lists the topics."
            )
        places[name] = (match["topic"], int(match["instance"] or 0), match["field"])
    return places


def _ulog_topic(topic: str, instance: int) -> str:
    return f"{topic}[{instance}]" if instance else topic


def _parsed_ulog(path: Path, topics: list[str] | None) -> Any:
    """Return the contents of a ULog file: some topics, or all."""
    pyulog = library("pyulog", path, extra="logs")
    try:
        return pyulog.ULog(str(path), topics)
    except Exception as error:  # pyulog raises what its parsing meets
        raise _unreadable(path, "ULog", error) from error


def _mdf_group(path: Path, file: Any, channel: str, group: int | None) -> int:
    """Return the group of a channel, which must be the only one unless it is given."""
    require_known(f"channel in {path.name}", [channel], sorted(file.channels_db))
    groups = sorted({own for own, _ in file.channels_db[channel]})
    if group is None:
        require(
            len(groups) == 1,
            f"{path.name}: the channel {channel!r} is in the groups {', '.join(map(str, groups))}. "
            f"Name one, as ({channel!r}, {groups[0]}).",
        )
        return groups[0]
    known = [str(own) for own in groups]
    require_known(f"group with the channel {channel!r} in {path.name}", [str(group)], known)
    return group


def _numbers(values: np.ndarray, name: str, path: Path) -> np.ndarray:
    """Return a vector of numbers."""
    values = np.asarray(values)
    require(
        values.dtype.kind in "biuf" and values.ndim == 1,
        f"{path.name}: {name!r} has shape {values.shape} and type {values.dtype}, and a signal is "
        "a vector of numbers. Choose another one.",
    )
    return values.astype(float)


def _unreadable(path: Path, kind: str, error: Exception) -> InputError:
    words = str(error).splitlines()[0] if str(error) else type(error).__name__
    return InputError(f"{path.name} cannot be read as {kind}: {words}. Export it again.")
