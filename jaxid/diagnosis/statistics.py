"""Measures of fit between measured and computed outputs, channel by channel."""

import equinox as eqx
import numpy as np

from .._foundation.checks import require
from .._foundation.host import on_host
from .._foundation.types import Array, Bool, Float, Int, Numbers

# Derived: deviation of a constant channel by rounding, as a share of its mean, in double precision.
LEAST_SPREAD = 1e-12


class FitStatistics(eqx.Module):
    """Measures of fit, one for each output channel.

    Attributes:
        outputs, units: names and units of the channels.
        count: valid samples.
        rms: root mean square of the residual [output units].
        max_abs: its largest absolute value [output units].
        r_squared: coefficient of determination; NaN if the measured channel is constant.
        theil: Theil's inequality coefficient, 0 for a perfect fit, 1 for none; below about 0.25 is
            called good.
        bias, variance, covariance: shares of the mean square residual due to different means, to
            different standard deviations, and to imperfect correlation; they add up to 1. A good
            fit has nearly all in the last.
        normalised: rms over the standard deviation of the noise, near 1 if no effect is missing;
            NaN without R.
    """

    outputs: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    count: Int[Array, " output"]
    rms: Float[Array, " output"]
    max_abs: Float[Array, " output"]
    r_squared: Float[Array, " output"]
    theil: Float[Array, " output"]
    bias: Float[Array, " output"]
    variance: Float[Array, " output"]
    covariance: Float[Array, " output"]
    normalised: Float[Array, " output"]

    @property
    def fit(self) -> Float[Array, " output"]:
        """Fit by channel, `100 (1 - |z - y| / |z - mean z|)` [percent]; below zero, a constant
        predicts better.
        """
        return _percent(self.r_squared)

    def __str__(self) -> str:
        width = max(len(name) for name in (*self.outputs, "output"))
        columns = (
            "rms",
            "max_abs",
            "r_squared",
            "theil",
            "bias",
            "variance",
            "covariance",
            "normalised",
        )
        heads = ("rms", "max", "R2", "Theil U", "bias", "variance", "covar.", "rms/noise")
        lines = [
            f"{'output':<{width}} {'samples':>8}"
            + "".join(f" {head:>10}" for head in heads)
            + "  unit"
        ]
        known = {column: np.asarray(getattr(self, column)) for column in ("count", *columns)}
        for j, (name, unit) in enumerate(zip(self.outputs, self.units, strict=True)):
            values = "".join(f" {float(known[column][j]):>10.4g}" for column in columns)
            lines.append(f"{name:<{width}} {int(known['count'][j]):>8}{values}  {unit}")
        return "\n".join(lines)


def statistics(
    z: Float[Array, "case time output"],
    y: Float[Array, "case time output"],
    mask: Bool[Array, "case time output"],
    *,
    outputs: tuple[str, ...],
    units: tuple[str, ...] | None = None,
    noise: Float[Array, "output output"] | None = None,
    skip: int = 0,
) -> FitStatistics:
    r"""Compare model outputs with measured ones, pooled over the cases.

        R2 = 1 - sum v^2 / sum (z - mean z)^2,    U = rms(v) / (rms(z) + rms(y)),    v = z - y
        mean v^2 = (mean z - mean y)^2 + (sd z - sd y)^2 + 2 (1 - rho) sd z sd y

    The three terms are the bias, variance and covariance parts (Theil, Economic Forecasts and
    Policy, 1961; Jategaonkar, Flight Vehicle System Identification, chapter 11.)

    Args:
        z: measured outputs, shape (case, time, output) [output units].
        y: model outputs, the same shape and units.
        mask: valid samples, the same shape.
        outputs: names of the channels.
        units: their units; none by default.
        noise: covariance R of the measurement noise, shape (output, output) [products of output
            units].
        skip: samples at the start of each case that are left out.

    Returns:
        The statistics; pure in the arrays.

    Raises:
        InputError: if the number of names or units differs from that of the channels, or `skip`
            leaves no sample.
    """
    rows, channels = z.shape[1:]
    units = ("",) * channels if units is None else tuple(units)
    require(
        len(outputs) == channels,
        f"There are {channels} output channels and {len(outputs)} names. Name each once.",
    )
    require(
        len(units) == channels,
        f"There are {channels} output channels and {len(units)} units. Give one for each.",
    )
    require(
        0 <= skip < rows,
        f"skip is {skip}, and the records have {rows} rows. Choose 0 to {rows - 1}.",
    )
    return FitStatistics(
        outputs=tuple(outputs), units=units, **_measures(z, y, mask, noise, skip=skip)
    )


@on_host
def _percent(xp, r_squared):
    """Return the fit in percent."""
    return 100.0 * (1.0 - xp.sqrt(1.0 - r_squared))


@on_host
def _measures(xp, z, y, mask, noise, *, skip: int) -> dict[str, Numbers]:
    """Return the arrays of `FitStatistics` by name."""
    rows, channels = z.shape[1:]
    mask = mask & (xp.arange(rows) >= skip)[None, :, None]
    count = xp.sum(mask, axis=(0, 1))

    def mean(x):
        return xp.sum(xp.where(mask, x, 0.0), axis=(0, 1)) / count

    v, z_mean, y_mean = xp.where(mask, z - y, 0.0), mean(z), mean(y)
    z_off, y_off = z - z_mean[None, None], y - y_mean[None, None]
    square, product = mean(v**2), mean(z_off * y_off)
    z_sd, y_sd = xp.sqrt(mean(z_off**2)), xp.sqrt(mean(y_off**2))
    deviation = xp.full(channels, xp.nan) if noise is None else xp.sqrt(xp.diagonal(noise))
    return {
        "count": count,
        "rms": xp.sqrt(square),
        "max_abs": xp.max(xp.abs(v), axis=(0, 1)),
        "r_squared": xp.where(z_sd > LEAST_SPREAD * xp.abs(z_mean), 1.0 - square / z_sd**2, xp.nan),
        "theil": xp.sqrt(square) / (xp.sqrt(mean(z**2)) + xp.sqrt(mean(y**2))),
        "bias": (z_mean - y_mean) ** 2 / square,
        "variance": (z_sd - y_sd) ** 2 / square,
        "covariance": 2.0 * (z_sd * y_sd - product) / square,
        "normalised": xp.sqrt(square) / deviation,
    }
