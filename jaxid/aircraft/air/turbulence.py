"""Gusts along a flight: white, Dryden and von Karman turbulence as six signals over sample times,
from a random key.

The signals are velocities and rotations of the air relative to the ground, along body axes, of a
field that is frozen while the aircraft flies through it at speed V. They are input channels of the
aircraft, named in `GUSTS`.
"""

from collections.abc import Mapping
from types import MappingProxyType

import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import require, require_known
from ..._foundation.traced_checks import require_value
from ..._foundation.types import Array, Float
from ..physics.imperial import FOOT
from .forming_filters import first_order, second_order
from .gust_scales import (
    DRYDEN_LENGTH,
    VON_KARMAN_LENGTH,
    AbstractIntensity,
    GustScales,
    Severity,
    Value,
    as_intensity,
)
from .random_sinusoids import random_sinusoids, sum_of_sinusoids

GUSTS = ("gust_u", "gust_v", "gust_w", "gust_p", "gust_q", "gust_r")

REPORT_GUST = 21.2 * FOOT  # m/s, one standard deviation (report, Table 6.6)
# Table 6.6 prints u and v. Section 6.3.2 has vertical and horizontal velocities, which would
# replace one of the two by `gust_w`; the report does not specify which.
REPORT_GUSTS: Mapping[str, float] = MappingProxyType({"gust_u": REPORT_GUST, "gust_v": REPORT_GUST})


def white_gusts(
    key: Array, t: Float[Array, " time"], sigma: Mapping[str, Value]
) -> Float[Array, "time 6"]:
    """Draw independent normal numbers at the samples: the report's process noise (Table 6.6).

    The effect of such a sequence depends on the sample time. Held between samples h apart, its
    spectral density at low frequency is `2 sigma^2 h` per Hz, so that half the sample time needs a
    sigma larger by sqrt(2) for the same motion. The report's samples are 0.1 s apart.

    Args:
        key: a JAX random key.
        t: sample times, shape (time,) [s].
        sigma: standard deviation by name of the signal, a name of `GUSTS`; zero for a name left out
            [m/s, rad/s].

    Returns:
        The gusts, shape (time, 6), columns as `GUSTS` [m/s, rad/s].

    Raises:
        InputError: when a name is not in `GUSTS`, or a standard deviation is negative.
    """
    require_known("gust", sigma, GUSTS)
    for name, value in sigma.items():
        require_value(
            value, lambda s: s >= 0, f"White gusts: sigma of {name!r} is {{}}. Give zero or more."
        )
    spread = jnp.stack([jnp.asarray(sigma.get(name, 0.0), float) for name in GUSTS])
    return spread[None] * jax.random.normal(key, (t.size, 6), float)


def dryden(
    key: Array,
    t: Float[Array, " time"],
    V: Value,
    altitude: Value,
    intensity: AbstractIntensity | Severity,
    *,
    span: Value,
) -> Float[Array, "time 6"]:
    r"""Draw gusts with Dryden spectra, from white noise through the forming filters, exact at any
    sample times.

    With n independent white noises of unit strength, `a = V/L` of each component, span b, and s the
    derivative in time:

        u = sigma_u sqrt(2/a) n/(1 + s/a),      v, w = sigma/sqrt(a) (1 + sqrt(3) s/a)/(1 + s/a)^2 n
        q = -(s/V) w/(1 + 4b s/(pi V)),         r = (s/V) v/(1 + 3b s/(pi V))
        p = sigma_w sqrt(0.8 pi/V) (pi/4b)^(1/6)/Lw^(1/3) n/(1 + 4b s/(pi V))

    The signs are those of a rotation of the air: `q = -dw/dx`, `r = dv/dx`. Speed and altitude are
    constant over the flight.

    Source: MIL-F-8785C, 1980, 3.7.1.2 and 3.7.4; MIL-HDBK-1797, 1997, has the same spectra in other
    scales.

    Args:
        key: a JAX random key.
        t: sample times, in any spacing, shape (time,) [s].
        V: speed relative to the air [m/s].
        altitude: above ground [m].
        intensity: "light", "moderate" or "severe", or another intensity, such as
            `FixedIntensity`.
        span: wing span b [m].

    Returns:
        The gusts, shape (time, 6), columns as `GUSTS` [m/s, rad/s].

    Raises:
        InputError: when the severity is not known, speed or span are not positive, or time runs
            backwards.
    """
    _check(t, V, span)
    V, span = jnp.asarray(V, float), jnp.asarray(span, float)
    scales = as_intensity(intensity).scales(altitude, DRYDEN_LENGTH)
    pole, step = V / scales.lengths, jnp.diff(t)
    noise = jax.random.normal(key, (t.size, 8), float)
    chains = jnp.stack([noise[:, 1:4], noise[:, 4:7]])
    (v, w), (vdot, wdot) = jax.vmap(second_order, (0, None, 0, 0))(
        chains, step, pole[1:], _rate_poles(V, span)
    )
    u, (_, sv, sw) = first_order(noise[:, 0], step, pole[0]), scales.sigmas
    p = _roll_gust(noise[:, 7], step, V, span, scales)
    return jnp.stack(
        [scales.sigmas[0] * u, sv * v, sw * w, p, -sw * wdot / V, sv * vdot / V], axis=-1
    )


def von_karman(
    key: Array,
    t: Float[Array, " time"],
    V: Value,
    altitude: Value,
    intensity: AbstractIntensity | Severity,
    *,
    span: Value,
    highest: Value | None = None,
    count: int = 256,
) -> Float[Array, "time 6"]:
    r"""Draw gusts with von Karman spectra, as sums of sinusoids of random frequency, amplitude and
    phase.

    One-sided, in wave number Om [rad/m], with `y = 1.339 L Om`:

        Phi_u        = sigma_u^2 2L/pi (1 + y^2)^(-5/6)
        Phi_v, Phi_w = sigma^2 L/pi (1 + 8/3 y^2) (1 + y^2)^(-11/6)

    q and r follow from w and v, and p is an independent process, as in `dryden`. The spectra fall
    with the power -5/3, which no filter of finite order reproduces: the handbook's rational filters
    deviate beyond a few tens of V/L, which is a few Hz at altitude. The mean spectrum of the sum of
    sinusoids over many gusts is exact from `1e-3 V/L` rad/s (0.06 % of the power lies below) to
    `highest`. Power above `highest` is left out rather than folded back, so the variance is the
    variance of this band.

    Source: MIL-F-8785C, 1980, 3.7.1.1 and 3.7.4.

    Args:
        key: a JAX random key.
        t: sample times, in any spacing, shape (time,) [s].
        V: speed relative to the air [m/s].
        altitude: above ground [m].
        intensity: "light", "moderate" or "severe", or another intensity, such as
            `FixedIntensity`.
        span: wing span b [m].
        highest: end of the band; half the mean sample rate when left out [Hz].
        count: number of sinusoids of each component.

    Returns:
        The gusts, shape (time, 6), columns as `GUSTS` [m/s, rad/s].

    Raises:
        InputError: when the severity is not known, speed, span, `highest` or the number of
            sinusoids are not positive, or time runs backwards.
    """
    _check(t, V, span)
    require(
        count >= 1,
        f"Von Karman gusts of {count} sinusoids: give at least one, and some hundred for a "
        "smooth spectrum.",
    )
    V, span = jnp.asarray(V, float), jnp.asarray(span, float)
    scales = as_intensity(intensity).scales(altitude, VON_KARMAN_LENGTH)
    if highest is None:
        require(
            t.size > 1,
            "Von Karman gusts at one sample time: give `highest` [Hz], as there is no sample rate.",
        )
        highest = 0.5 * (t.size - 1) / (t[-1] - t[0])
    require_value(
        highest,
        lambda s: s > 0,
        "Von Karman gusts: the band ends at {} Hz. Give a positive `highest`.",
    )
    end = jnp.asarray(highest, float)
    *keys, roll = jax.random.split(key, 4)
    lag = 1.0 / jnp.concatenate([jnp.ones(1), _rate_poles(V, span)])
    along = jnp.array([True, False, False])

    def component(key, length, sigma, lag, along):
        f, width, normal = random_sinusoids(
            key, 1e-3 * V / (2.0 * jnp.pi * length), end, count, logarithmic=True
        )
        omega, y2 = 2.0 * jnp.pi * f, (1.339 * length * 2.0 * jnp.pi * f / V) ** 2
        shape = jnp.where(
            along, 2.0 * (1.0 + y2) ** (-5 / 6), (1.0 + 8 / 3 * y2) * (1.0 + y2) ** (-11 / 6)
        )
        # Phi dOm, with dOm = 2 pi df / V
        c, s = (jnp.sqrt(2.0 * length / V * shape * width)[:, None] * normal).T
        # The lagged derivative i omega/(1 + i omega lag), in real and imaginary part.
        real, imaginary = (
            omega**2 * lag / (1.0 + (omega * lag) ** 2),
            omega / (1.0 + (omega * lag) ** 2),
        )
        cosines = jnp.stack([c, real * c + imaginary * s], axis=1)
        sines = jnp.stack([s, real * s - imaginary * c], axis=1)
        return sigma * sum_of_sinusoids(t, f, cosines, sines)

    u, v, w = jax.vmap(component)(jnp.stack(keys), scales.lengths, scales.sigmas, lag, along)
    p = _roll_gust(jax.random.normal(roll, (t.size,), float), jnp.diff(t), V, span, scales)
    return jnp.stack([u[:, 0], v[:, 0], w[:, 0], p, -w[:, 1] / V, v[:, 1] / V], axis=-1)


def _rate_poles(V: Float[Array, ""], span: Float[Array, ""]) -> Float[Array, "2"]:
    """Return the poles of yaw and pitch gust at which the span smooths the rotations [rad/s]."""
    return jnp.pi * V / (span * jnp.array([3.0, 4.0]))


def _roll_gust(noise, step, V, span, scales: GustScales) -> Float[Array, " time"]:
    """Return the rolling gust at the sample times, white noise through one lag (MIL-F-8785C,
    3.7.4) [rad/s].
    """
    length, smoothing = scales.lengths[2], 4.0 * span / jnp.pi
    # The integral over Om of sigma^2/L 0.8 (L/smoothing)^(1/3)/(1 + (smoothing Om)^2).
    variance = 0.4 * jnp.pi * (length / smoothing) ** (1 / 3) / (length * smoothing)
    return scales.sigmas[2] * jnp.sqrt(variance) * first_order(noise, step, V / smoothing)


def _check(t, V, span) -> None:
    """Raise an InputError for sample times, a speed or a span for which no gust can be drawn."""
    require(t.size >= 1, "There are no sample times for the gusts. Give at least one.")
    require_value(
        t, lambda s: np.diff(s) >= 0, "The sample times of the gusts run backwards. Sort them."
    )
    require_value(
        V, lambda s: s > 0, "The gusts are met at a speed of {} m/s. Give a positive speed V."
    )
    require_value(span, lambda s: s > 0, "The wing span is {} m. Give a positive span.")
