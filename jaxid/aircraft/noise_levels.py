"""Levels of instrument error, and a flight's own errors drawn from them (report Table 6.6)."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.types import Array, Float
from .atmosphere import GRAVITY
from .imperial import DEGREE, FOOT
from .instrument_channels import CHANNELS, TABLE, PerChannel
from .instruments import Instruments


class NoiseLevel(eqx.Module):
    """Standard deviations of the errors of instruments, by channel; a channel that is absent has no such error.

    Args:
        scale: of the relative error of scale.
        bias: of the offset [the channel's unit].
        noise: of white noise [the channel's unit].
        position: of each coordinate of a place [m].
        misalignment: of each angle of an axis [rad].
    """

    scale: Mapping[str, float]
    bias: Mapping[str, float]
    noise: Mapping[str, float]
    position: Mapping[str, float]
    misalignment: Mapping[str, float]


# Table 6.6: scale, bias (the noise is the same); base, then high.
_ERRORS_DEG_FT = {
    "alpha": ((0.02, 0.05), (0.02, 0.2)),
    "beta": ((0.02, 0.05), (0.02, 0.05)),
    "V": ((0.01, 5.0), (0.01, 6.25)),
    "ax": ((0.005, 0.005), (0.005, 0.005)),
    "ay": ((0.005, 0.0005), (0.005, 0.001)),
    "az": ((0.005, 0.005), (0.005, 0.025)),
    "az_pilot": ((0.005, 0.005), (0.005, 0.025)),
    "pdot": ((0.005, 0.1), (0.005, 0.3)),
    "p": ((0.005, 0.1), (0.005, 0.75)),
    "qdot": ((0.005, 0.1), (0.005, 0.3)),
    "q": ((0.005, 0.1), (0.005, 0.3)),
    "rdot": ((0.005, 0.1), (0.005, 0.3)),
    "r": ((0.005, 0.1), (0.005, 0.3)),
    "phi": ((0.005, 0.5), (0.005, 0.9)),
    "pitch": ((0.005, 0.15), (0.005, 0.45)),
    "psi": ((0.005, 0.15), (0.005, 0.45)),
}
_POSITION_FT, _MISALIGNMENT_DEG = (0.5, 1.0), (0.6, 0.9)
_VANE_FT = (34.0, 0.5, 0.2)  # mean position of both vanes, the last columns of the table


def _level(row: int) -> NoiseLevel:
    """One of the two levels in SI units; foot, degree and g end here."""
    si = {name: DEGREE if TABLE[name].unit.startswith("rad") else FOOT for name in _ERRORS_DEG_FT}
    si |= dict.fromkeys(("ax", "ay", "az", "az_pilot"), GRAVITY)
    errors = {name: rows[row] for name, rows in _ERRORS_DEG_FT.items()}
    offset = {name: bias * si[name] for name, (_, bias) in errors.items()}
    return NoiseLevel(
        scale={name: scale for name, (scale, _) in errors.items()},
        bias=offset,
        noise=dict(offset),
        position={name: _POSITION_FT[row] * FOOT for name in errors if TABLE[name].has_position},
        misalignment={name: _MISALIGNMENT_DEG[row] * DEGREE for name in errors if TABLE[name].angles},
    )


BASE = _level(0)
"""The base level of Table 6.6 (see `HIGH` for how the table is read)."""

HIGH = _level(1)
"""The high level of Table 6.6.

The table gives two lines for each instrument, the first for the base level and the second for the high one. How we read it:

- `a b v` are alpha, beta and V, and x, y, z with bars the accelerometers. `p q r` stand there twice: the first pair of
  lines is the angular acceleration (deg/s^2), the second the rate (deg/s), as the printed units of q and r say. So the roll
  rate's 0.75 is its own, where the other rates have 0.3.
- The unit of V is printed as `f/s^2`, and that of the roll rate as deg/s^2: slips for ft/s and deg/s.
- The accelerometers' unit is printed as `f/s^2` too, and read as g, in which App. D.2.7 adds bias and noise to their
  readings. As ft/s^2 the lateral one would be true to 15 millionths of g, beside gyros of 0.1 deg/s; and Table 6.8 finds
  0.0145 g of it.
- Each axis has two misalignment angles (D.2.2, D.2.7), both of the size given.
- The pilot's accelerometer is not in the table: App. D.2.7.6 gives it the errors of the vertical one.
- Altitude, controls and thrust are not in the table: without error.
"""


def report_instruments(channels: Sequence[str] = CHANNELS) -> Instruments:
    """The report's instruments before a flight draws its errors: vanes 34 ft ahead of the c.g. (Table 6.6), else perfect.

    Args:
        channels: what is recorded, a selection of `CHANNELS`.

    Raises:
        InputError: for a channel that does not exist.
    """
    vane = tuple(FOOT * coordinate for coordinate in _VANE_FT)
    return Instruments(channels, position={name: vane for name in ("alpha", "beta") if name in channels})


def draw(key: Array, instruments: Instruments, level: NoiseLevel) -> Instruments:
    """A flight's own instruments: constant errors drawn about the given ones, and the level's white noise.

        scale, bias, position, misalignment ~ N(the instruments' own, level^2)

    Args:
        key: random key; an instrument's errors do not depend on which others there are.
        instruments: those about which to draw; channels that the level does not list stay as they are.
        level: standard deviations.

    Returns:
        Instruments of the same channels, with the level's noise on those that it lists.
    """
    keys = dict(zip(("scale", "bias", "position", "misalignment"), jax.random.split(key, 4), strict=True))
    moved = [_moved(k, getattr(instruments, kind), getattr(level, kind)) for kind, k in keys.items()]
    own = dict(zip(instruments.noise.channels, instruments.noise.values, strict=True))
    own |= {name: sigma for name, sigma in level.noise.items() if name in instruments.channels}
    noise = PerChannel({name: own[name] for name in instruments.channels if name in own})
    return eqx.tree_at(lambda i: [*(getattr(i, kind) for kind in keys), i.noise], instruments, [*moved, noise])


def _moved(key: Array, values: PerChannel, sigma: Mapping[str, Float[Array, ""] | float]) -> PerChannel:
    """Values with a normal error added to each."""
    if not values.channels:
        return values
    size = jnp.stack([jnp.asarray(sigma.get(name, 0.0), float) for name in values.channels])
    parts = values.values.shape[1:]
    errors = jax.random.normal(key, (len(CHANNELS), *parts))[jnp.array([CHANNELS.index(n) for n in values.channels])]
    return eqx.tree_at(lambda v: v.values, values, values.values + size.reshape(-1, *(1 for _ in parts)) * errors)
