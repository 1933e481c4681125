"""`Instruments`: readings of an aircraft's instruments with their errors (report App. D.2)."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ..._foundation.checks import require, require_known
from ..._foundation.types import Array, Bool, Float
from . import errors as errors
from .channels import (
    CHANNEL_TABLE,
    CHANNELS,
    PerChannel,
    checked_channels,
    misalignments,
    numbers,
    positions,
)
from .geometry import Signals, ideal_reading


class Instruments(eqx.Module):
    r"""Instruments with position, misalignment and errors.

        read:     y = (1 + scale) h(signals; position, misalignment) + bias       at an instant
        observe:  lag, then delay, then saturation                                of a whole signal
        measure:  white noise + band-limited noise, then saturation, then quantisation, then dropout

    `read` and `observe` implement a model's `output` and `observe` and are differentiable in every
    number; `measure` simulates records. Without arguments the instruments are perfect and at the
    c.g. Positions, misalignments, scales and biases always have a number. A lag, and each error
    listed after it, exists only if given, and otherwise has no cost and no parameter name; to
    estimate one, give it as zero. Every number is an array leaf with a name such as `bias.alpha`,
    `position.ax.x`, `misalignment.q.psi`, `lag.q`.

    The channels, in the units of `units()`: `alpha` and `beta` are the readings of vanes, with the
    upwash as their scale; `V` is the indicated airspeed; `ax ay az` are specific forces at the
    accelerometers and `az_pilot` at the pilot's station; `altitude` is geometric.

    The report defines scale, bias and noise of the airspeed on its square (D.2.4). Here they act on
    the airspeed itself: a scale error of the square is twice the scale error of the airspeed, and
    an offset `b` of the square is one of `b / (2 V)`, as `noise_levels.BASE` converts them.

    Args:
        channels: recorded channels, a selection of `CHANNELS` in the order of the outputs.
        position: (x, y, z) from the c.g. in body axes, of alpha, beta, ax, ay, az, az_pilot [m].
        misalignment: misalignment angles by channel and name, such as `{"q": {"psi": 0.01}}` [rad]:
            psi and theta of p, pdot, ax; psi and phi of q, qdot, ay; theta and phi of r, rdot, az,
            az_pilot (D.2.2, D.2.3, D.2.7).
        scale: relative error of scale by channel.
        bias: offset by channel [its unit].
        lag: time constant by channel [s].
        delay: delay by channel [s].
        lower, upper: ends of the range by channel [its unit].
        noise: standard deviation of white noise by channel [its unit].
        coloured_noise: standard deviation of band-limited noise by channel [its unit].
        bandwidth: half-power frequency of the band-limited noise, for the same channels [rad/s].
        quantum: smallest recorded difference by channel [its unit].
        dropout: probability that a sample is lost, by channel.

    Raises:
        InputError: for a channel, an angle or a position that does not exist, a value of another
            shape, or a band-limited noise without its bandwidth.
    """

    position: PerChannel
    misalignment: PerChannel
    scale: PerChannel
    bias: PerChannel
    lag: PerChannel
    delay: PerChannel
    lower: PerChannel
    upper: PerChannel
    noise: PerChannel
    coloured_noise: PerChannel
    bandwidth: PerChannel
    quantum: PerChannel
    dropout: PerChannel
    channels: tuple[str, ...] = eqx.field(static=True)

    def __init__(
        self,
        channels: Sequence[str] = CHANNELS,
        *,
        position: Mapping[str, Any] | None = None,
        misalignment: Mapping[str, Mapping[str, Any]] | None = None,
        scale: Mapping[str, Any] | None = None,
        bias: Mapping[str, Any] | None = None,
        lag: Mapping[str, Any] | None = None,
        delay: Mapping[str, Any] | None = None,
        lower: Mapping[str, Any] | None = None,
        upper: Mapping[str, Any] | None = None,
        noise: Mapping[str, Any] | None = None,
        coloured_noise: Mapping[str, Any] | None = None,
        bandwidth: Mapping[str, Any] | None = None,
        quantum: Mapping[str, Any] | None = None,
        dropout: Mapping[str, Any] | None = None,
    ):
        self.channels = checked_channels(channels)
        self.position = positions(position, self.channels)
        self.misalignment = misalignments(misalignment, self.channels)
        of = partial(numbers, self.channels)
        self.scale, self.bias = of("scale", scale, 0.0), of("bias", bias, 0.0)
        self.lag, self.delay = of("lag", lag), of("delay", delay)
        self.lower, self.upper = of("lower", lower), of("upper", upper)
        self.noise, self.coloured_noise = of("noise", noise), of("coloured_noise", coloured_noise)
        self.bandwidth, self.quantum = of("bandwidth", bandwidth), of("quantum", quantum)
        self.dropout = of("dropout", dropout)
        require(
            self.coloured_noise.channels == self.bandwidth.channels,
            f"`coloured_noise` is given for {self.coloured_noise.channels} and `bandwidth` for "
            f"{self.bandwidth.channels}. "
            "Give both for the same channels.",
        )

    @property
    def signals_needed(self) -> frozenset[str]:
        """Names of the signals from which the channels are computed; accelerations only if a
        channel measures them.
        """
        return frozenset(
            name for channel in self.channels for name in CHANNEL_TABLE[channel].signals
        )

    def read(self, signals: Signals) -> Float[Array, " output"]:
        """Return the readings at an instant without lag, delay, range and noise.

        Args:
            signals: the motion at this instant by name; the signals in `signals_needed` are used.

        Returns:
            One reading per channel [`units()`].

        Raises:
            InputError: when a signal is missing.
        """
        require_known("signal (needed by the instruments)", sorted(self.signals_needed), signals)
        true = jnp.stack(
            [jnp.asarray(self._ideal_reading(channel, signals), float) for channel in self.channels]
        )
        return (1.0 + self.scale.values) * true + self.bias.values

    def _ideal_reading(self, channel: str, signals: Signals) -> Float[Array, ""]:
        """Return the reading of one instrument before its scale and bias."""
        position = self.position[channel] if CHANNEL_TABLE[channel].has_position else jnp.zeros(3)
        angles = self.misalignment[channel] if CHANNEL_TABLE[channel].angles else jnp.zeros(2)
        return ideal_reading(channel, signals, position, angles)

    def observe(
        self, t: Float[Array, " time"], y: Float[Array, "time output"]
    ) -> Float[Array, "time output"]:
        """Return the sampled readings after lag, delay and saturation.

        Args:
            t: time [s].
            y: readings, one row per time [`units()`].
        """
        y = errors.lagged(t, y, self.lag, self.channels)
        y = errors.delayed(t, y, self.delay, self.channels)
        return errors.saturated(y, self.lower, self.upper, self.channels)

    def measure(
        self, key: Array, t: Float[Array, " time"], y: Float[Array, "time output"]
    ) -> tuple[Float[Array, "time output"], Bool[Array, "time output"]]:
        """Return a record of the readings: noisy, clipped to the range, quantised, with dropouts.

        Args:
            key: random key; the noise of a channel does not depend on the other channels.
            t: time [s].
            y: readings after `observe`, one row per time [`units()`].

        Returns:
            Measured values, zero for a lost sample, and the mask of the valid samples.
        """
        for_white, for_coloured, for_dropout = jax.random.split(key, 3)
        z, samples = y, t.shape[0]
        if self.noise.channels:
            z = z.at[:, self.noise.columns(self.channels)].add(
                errors.white(for_white, samples, self.noise)
            )
        if self.coloured_noise.channels:
            wander = errors.band_limited(for_coloured, t, self.coloured_noise, self.bandwidth)
            z = z.at[:, self.coloured_noise.columns(self.channels)].add(wander)
        # The noisy signal is clipped again, so that a saturated signal repeats one value, as it
        # does with real instruments.
        z = errors.saturated(z, self.lower, self.upper, self.channels)
        z = errors.quantised(z, self.quantum, self.channels)
        mask = errors.recorded_mask(for_dropout, samples, self.dropout, self.channels)
        return jnp.where(mask, z, 0.0), mask

    def units(self) -> dict[str, str]:
        """Units of the channels, by name."""
        return {channel: CHANNEL_TABLE[channel].unit for channel in self.channels}

    def parameter_units(self) -> dict[str, str]:
        """Units of the parameters of the instruments, by dotted name."""
        units = dict.fromkeys(
            (f"position.{name}" for name in self.position.element_names["values"]), "m"
        )
        units |= dict.fromkeys(
            (f"misalignment.{name}" for name in self.misalignment.element_names["values"]), "rad"
        )
        fixed = {"scale": "", "dropout": "", "lag": "s", "delay": "s", "bandwidth": "rad/s"}
        for kind in ERRORS:
            units |= {
                f"{kind}.{n}": fixed.get(kind, CHANNEL_TABLE[n].unit)
                for n in getattr(self, kind).channels
            }
        return units


ERRORS = (
    "scale",
    "bias",
    "lag",
    "delay",
    "lower",
    "upper",
    "noise",
    "coloured_noise",
    "bandwidth",
    "quantum",
    "dropout",
)
