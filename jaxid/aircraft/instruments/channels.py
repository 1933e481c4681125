"""The channels that an aircraft's instruments record, and tables of numbers by channel."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import require, require_known, require_unique
from ..._foundation.host import on_host
from ..._foundation.traced_checks import require_value
from ..._foundation.types import Array, Float

AXES = ("x", "y", "z")
NOT_NEGATIVE = ("lag", "noise", "coloured_noise", "bandwidth", "quantum", "dropout")


class Channel(NamedTuple):
    """Static properties of one channel.

    Attributes:
        unit: SI, angles in radians.
        signals: names of the signals from which it is computed.
        has_position: True if the reading depends on the position of the instrument.
        angles: the two angles by which its axis may be misaligned, () for a channel without axis.
    """

    unit: str
    signals: tuple[str, ...]
    has_position: bool = False
    angles: tuple[str, ...] = ()


# A rotation about the sensitive axis does not change the reading: each axis has two misalignment
# angles (D.2.2.1, D.2.7).
ALONG = {"x": ("psi", "theta"), "y": ("psi", "phi"), "z": ("theta", "phi")}
RATES, ANGULAR = ("p", "q", "r"), ("pdot", "qdot", "rdot")
FLOW = ("u_air", "v_air", "w_air")
FORCE = ("ax", "ay", "az")

CHANNEL_TABLE: dict[str, Channel] = {
    "alpha": Channel("rad", FLOW + RATES, has_position=True),
    "beta": Channel("rad", FLOW + RATES, has_position=True),
    "V": Channel("m/s", ("V", "density", "mach")),
    **{
        name: Channel("rad/s", RATES, angles=ALONG[axis])
        for name, axis in zip(RATES, AXES, strict=True)
    },
    **{
        name: Channel("rad/s^2", ANGULAR, angles=ALONG[axis])
        for name, axis in zip(ANGULAR, AXES, strict=True)
    },
    **{name: Channel("rad", (name,)) for name in ("phi", "pitch", "psi")},
    **{
        name: Channel("m/s^2", FORCE + RATES + ANGULAR, has_position=True, angles=ALONG[axis])
        for name, axis in zip((*FORCE, "az_pilot"), (*AXES, "z"), strict=True)
    },
    "altitude": Channel("m", ("altitude",)),
    **{name: Channel("rad", (name,)) for name in ("stabilator", "aileron", "rudder")},
    "thrust": Channel("N", ("thrust",)),
}
CHANNELS: tuple[str, ...] = tuple(CHANNEL_TABLE)


class PerChannel(eqx.Module):
    """Numbers by channel, such as the biases or the positions.

    A channel without a value takes no memory and has no parameter name. The dotted name of a number
    ends in its channel, and in its part for values with parts: `bias.alpha`, `position.ax.x`,
    `misalignment.q.psi`. Get the value of a channel by `instruments.bias["alpha"]`.

    Args:
        values: by channel, each of the same shape, () or (part,).
        parts: names of the parts by channel, for values of shape (part,).
    """

    values: Float[Array, "channel *part"]
    channels: tuple[str, ...] = eqx.field(static=True)
    parts: tuple[tuple[str, ...], ...] = eqx.field(static=True)

    transparent: ClassVar[tuple[str, ...]] = ("values",)

    def __init__(
        self, values: Mapping[str, Any], parts: Mapping[str, tuple[str, ...]] | None = None
    ):
        self.channels = tuple(values)
        self.parts = tuple(parts[name] for name in values) if parts is not None else ()
        width = () if parts is None else (len(self.parts[0]) if self.parts else 0,)
        self.values = _table([*values.values()], shape=(len(values), *width))

    @property
    def element_names(self) -> dict[str, tuple[str, ...]]:
        """Names of the values, in the order of the flattened array."""
        if not self.parts:
            return {"values": self.channels}
        pairs = zip(self.channels, self.parts, strict=True)
        return {"values": tuple(f"{name}.{part}" for name, parts in pairs for part in parts)}

    def __getitem__(self, channel: str) -> Float[Array, "*part"]:
        """Return the value of one channel.

        Raises:
            InputError: when the channel has no value.
        """
        require_known("value for the channel", [channel], self.channels)
        return self.values[self.channels.index(channel)]

    def columns(self, outputs: tuple[str, ...]) -> np.ndarray:
        """Return the indices of its channels among the outputs."""
        return np.array([outputs.index(name) for name in self.channels], int)


@on_host
def _table(xp, values, shape: tuple[int, ...]):
    """Return numbers by channel as one array."""
    return xp.asarray(values, float).reshape(shape)


def checked_channels(channels: Sequence[str]) -> tuple[str, ...]:
    """Return the channels as a tuple.

    Raises:
        InputError: when a channel does not exist or occurs twice, with the valid names.
    """
    require(
        not isinstance(channels, str),
        f"`channels` is the string {channels!r}. Give a tuple of names: ({channels!r},).",
    )
    require(len(channels) > 0, f"`channels` is empty. Name at least one of {', '.join(CHANNELS)}.")
    require_known("instrument channel", channels, CHANNELS)
    require_unique("instrument channel", channels)
    return tuple(channels)


def numbers(
    channels: tuple[str, ...],
    kind: str,
    given: Mapping[str, Any] | None,
    default: float | None = None,
) -> PerChannel:
    """Return the values of one kind of error, in the order of the channels.

    Args:
        channels: the recorded channels.
        kind: name of the kind, for error messages.
        given: one number by channel.
        default: value of the channels without one; None leaves these channels out.

    Raises:
        InputError: for a name that is not among the channels, a value that is not a scalar, or a
            negative value of a kind that must not be negative.
    """
    given = {name: jnp.asarray(value, float) for name, value in (given or {}).items()}
    require_known(f"channel (in `{kind}`)", given, channels)
    for name, value in given.items():
        _check_number(kind, name, value)
    named = [name for name in channels if name in given or default is not None]
    return PerChannel({name: given.get(name, default) for name in named})


def _check_number(kind: str, name: str, value: Array) -> None:
    """Raise an InputError if the value is not a scalar or outside the range of its kind."""
    require(value.ndim == 0, f"`{kind}` of {name!r} has shape {value.shape}. Give one number.")
    if kind in NOT_NEGATIVE:
        most = 1.0 if kind == "dropout" else np.inf
        end = "to 1" if most == 1.0 else "upwards"
        words = f"`{kind}` of {name!r} is {{}}. Give a number from 0 {end}."
        require_value(value, lambda number: (number >= 0) & (number <= most), words)


def positions(given: Mapping[str, Any] | None, channels: tuple[str, ...]) -> PerChannel:
    """Return the positions of all channels that have one; the default is the c.g.

    Args:
        given: (x, y, z) from the c.g. in body axes by channel [m].
        channels: the recorded channels.

    Raises:
        InputError: for a channel that has no position, or a position that is not three numbers.
    """
    given = {name: jnp.asarray(place, float) for name, place in (given or {}).items()}
    placed = [name for name in channels if CHANNEL_TABLE[name].has_position]
    require_known("channel with a position", given, placed)
    for name, place in given.items():
        require(
            place.shape == (3,),
            f"`position` of {name!r} has shape {place.shape}. Give (x, y, z) in m.",
        )
    return PerChannel(
        {name: given.get(name, (0.0, 0.0, 0.0)) for name in placed}, dict.fromkeys(placed, AXES)
    )


def misalignments(
    given: Mapping[str, Mapping[str, Any]] | None, channels: tuple[str, ...]
) -> PerChannel:
    """Return the misalignment angles of all channels that have an axis; the default is zero.

    Args:
        given: by channel, its angles by name [rad], such as `{"q": {"psi": 0.01}}`.
        channels: the recorded channels.

    Raises:
        InputError: for a channel that has no axis, or an angle that does not turn this axis.
    """
    given = given or {}
    turned = {name: CHANNEL_TABLE[name].angles for name in channels if CHANNEL_TABLE[name].angles}
    require_known("channel with an axis", given, turned)
    for name, angles in given.items():
        require_known(f"misalignment angle of {name!r}", angles, turned[name])
    values = {
        name: jnp.stack(
            [jnp.asarray(given.get(name, {}).get(angle, 0.0), float) for angle in angles]
        )
        for name, angles in turned.items()
    }
    return PerChannel(values, turned)
