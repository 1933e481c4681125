"""Levels of instrument error, and random errors of a flight (report Table 6.6)."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax

from ..._foundation.host import on_host
from ..._foundation.types import Array, Float
from ..air.atmosphere import GRAVITY
from ..physics.imperial import DEGREE, FOOT
from .channels import CHANNEL_TABLE, CHANNELS, PerChannel
from .instruments import Instruments


class NoiseLevel(eqx.Module):
    """Standard deviations of the errors of instruments, by channel; a channel without a value has
    no such error.

    Args:
        scale: of the relative error of scale.
        bias: of the offset [the channel's unit].
        noise: of white noise [the channel's unit].
        position: of each coordinate of the position [m].
        misalignment: of each misalignment angle [rad].
    """

    scale: Mapping[str, float]
    bias: Mapping[str, float]
    noise: Mapping[str, float]
    position: Mapping[str, float]
    misalignment: Mapping[str, float]


REPORT_AIRSPEED = 280.0 * FOOT
"""Indicated airspeed at which the errors of the airspeed are converted, the middle of the report's
flights [m/s].

445 to 550 ft/s at 35,000 ft are 255 to 320 ft/s on the indicator, so that an error of `V_i^2` is
converted within 14 %.
"""

# Table 6.6: scale, bias (the noise is the same); base, then high. V: of the squared airspeed.
_ERRORS_DEG_FT = {
    "alpha": ((0.02, 0.05), (0.02, 0.2)),
    "beta": ((0.02, 0.05), (0.02, 0.05)),
    "V": ((0.01, 5.0), (0.01, 6.25)),
    "ax": ((0.005, 0.005), (0.005, 0.005)),
    "ay": ((0.005, 0.005), (0.005, 0.01)),
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
    """Return one of the two levels in SI units, converted from foot, degree and g."""
    si = {
        name: DEGREE if CHANNEL_TABLE[name].unit.startswith("rad") else FOOT
        for name in _ERRORS_DEG_FT
    }
    si |= dict.fromkeys(("ax", "ay", "az", "az_pilot"), GRAVITY)
    errors = {name: rows[row] for name, rows in _ERRORS_DEG_FT.items()}
    scale, bias = errors["V"]
    errors["V"] = (scale / 2.0, bias * FOOT / (2.0 * REPORT_AIRSPEED))
    offset = {name: bias * si[name] for name, (_, bias) in errors.items()}
    return NoiseLevel(
        scale={name: scale for name, (scale, _) in errors.items()},
        bias=offset,
        noise=dict(offset),
        position={
            name: _POSITION_FT[row] * FOOT for name in errors if CHANNEL_TABLE[name].has_position
        },
        misalignment={
            name: _MISALIGNMENT_DEG[row] * DEGREE for name in errors if CHANNEL_TABLE[name].angles
        },
    )


def _with(level: NoiseLevel, channel: str, scale: float, error: float) -> NoiseLevel:
    """Return a level with other errors of one channel; bias and noise have the same size."""
    return NoiseLevel(
        scale={**level.scale, channel: scale},
        bias={**level.bias, channel: error},
        noise={**level.noise, channel: error},
        position=level.position,
        misalignment=level.misalignment,
    )


BASE = _level(0)
"""The base level of Table 6.6 (see `HIGH` for the interpretation of the table)."""

HIGH = _level(1)
"""The high level of Table 6.6.

The table gives two lines for each instrument, the first for the base level and the second for the
high one. Interpretation:

- `a b v` are alpha, beta and V, and x, y, z with bars the accelerometers. `p q r` are listed twice:
  the first pair of lines is the angular acceleration (deg/s^2), the second the rate (deg/s),
  according to the printed units of q and r. The roll rate therefore has 0.75 and the other rates
  0.3.
- V: scale, bias and noise act on the square of the indicated airspeed, as D.2.4 has it, and the
  unit `f/s^2` reads (ft/s)^2. The instruments of this package have errors of the airspeed itself,
  `dV = d(V^2) / (2 V)`, converted at `REPORT_AIRSPEED`: scale 0.005, bias and noise 0.009 ft/s.
  Noise of 5 ft/s in V alone would be four times the residual of CZ in Table 6.11.
- The unit of the roll rate is printed as deg/s^2, a misprint of deg/s.
- The accelerometers' unit is printed as `f/s^2` too, and read as g, in which App. D.2.7 adds bias
  and noise to their readings.
- The lateral accelerometer has 0.005 g (high: 0.01 g), ten times the printed numbers, which lost a
  digit: the residuals of ay in the report are 0.008 to 0.015 g by two ways.
- Derivations from the printed results: docs/errata.md.
- Each axis has two misalignment angles (D.2.2, D.2.7), both of the size given.
- The pilot's accelerometer is not in the table: App. D.2.7.6 gives it the errors of the vertical
  one.
- Altitude, controls and thrust are not in the table: without error.
"""

DEMONSTRATION = _with(
    _with(BASE, "V", scale=0.01, error=5.0 * FOOT), "ay", scale=0.005, error=0.0005 * GRAVITY
)
"""Level of simulated flights that are not the report's: the base level, but with errors of 5 ft/s
and 1 % in the airspeed itself and a lateral accelerometer of 0.0005 g (our choice).
"""


def report_instruments(channels: Sequence[str] = CHANNELS) -> Instruments:
    """Return the report's instruments before errors are drawn: perfect, with vanes 34 ft ahead of
    the c.g. (Table 6.6).

    Args:
        channels: recorded channels, a selection of `CHANNELS`.

    Raises:
        InputError: for a channel that does not exist.
    """
    vane = tuple(FOOT * coordinate for coordinate in _VANE_FT)
    return Instruments(
        channels, position={name: vane for name in ("alpha", "beta") if name in channels}
    )


def draw(key: Array, instruments: Instruments, level: NoiseLevel) -> Instruments:
    """Draw the instruments of one flight: constant errors about the given ones, and the level's
    white noise.

        scale, bias, position, misalignment ~ N(value of `instruments`, level^2)

    Args:
        key: random key; the errors of an instrument do not depend on the other instruments.
        instruments: instruments with the mean errors; channels that are not in the level stay
            unchanged.
        level: standard deviations.

    Returns:
        Instruments of the same channels, with the level's noise on the channels of the level.
    """
    keys = dict(
        zip(("scale", "bias", "position", "misalignment"), jax.random.split(key, 4), strict=True)
    )
    moved = [
        _moved(k, getattr(instruments, kind), getattr(level, kind)) for kind, k in keys.items()
    ]
    sigmas = dict(zip(instruments.noise.channels, instruments.noise.values, strict=True))
    sigmas |= {name: sigma for name, sigma in level.noise.items() if name in instruments.channels}
    noise = PerChannel({name: sigmas[name] for name in instruments.channels if name in sigmas})
    return eqx.tree_at(
        lambda i: [*(getattr(i, kind) for kind in keys), i.noise], instruments, [*moved, noise]
    )


def _moved(
    key: Array, values: PerChannel, sigma: Mapping[str, Float[Array, ""] | float]
) -> PerChannel:
    """Return the values with a normal error added to each."""
    if not values.channels:
        return values
    sizes = [sigma.get(name, 0.0) for name in values.channels]
    errors = jax.random.normal(key, (len(CHANNELS), *values.values.shape[1:]))
    at = tuple(CHANNELS.index(name) for name in values.channels)
    return eqx.tree_at(
        lambda v: v.values, values, _with_errors(values.values, errors, sizes, at=at)
    )


@on_host
def _with_errors(xp, values, errors, sizes, *, at: tuple[int, ...]):
    """Return values with the errors at some positions, each times its size."""
    scale = xp.stack([xp.asarray(size, float) for size in sizes])
    return values + scale.reshape(-1, *(1 for _ in values.shape[1:])) * errors[xp.asarray(at, int)]
