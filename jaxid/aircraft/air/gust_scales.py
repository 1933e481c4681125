"""Standard deviations and length scales of atmospheric gusts by altitude."""

import abc
from collections.abc import Mapping
from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import require_known
from ..._foundation.traced_checks import require_value
from ..._foundation.types import Array, Float
from ..physics.imperial import FOOT

KNOT = 1852.0 / 3600.0  # m/s, international knot

Severity = Literal["light", "moderate", "severe"]
Value = Array | float | int

# Wind speed at 20 ft and probability that the intensity aloft is exceeded (MIL-F-8785C, 3.7.2 and
# 3.7.3; the severities of its figure 7 as read by Yeager, NASA CR-1998-206937, 1998).
SEVERITIES: Mapping[str, tuple[float, float]] = {
    "light": (15.0 * KNOT, 1e-2),
    "moderate": (30.0 * KNOT, 1e-3),
    "severe": (45.0 * KNOT, 1e-5),
}

# ends of the low- and the high-altitude model (MIL-F-8785C, 3.7.3)
LOWEST_FT, LOW_FT, HIGH_FT = 10.0, 1000.0, 2000.0
DRYDEN_LENGTH = 1750.0 * FOOT  # m, above 2000 ft (MIL-F-8785C, 3.7.2.1)
VON_KARMAN_LENGTH = 2500.0 * FOOT  # m, above 2000 ft (MIL-F-8785C, 3.7.2.1)

# Standard deviation of the gusts aloft [ft/s], a row for each probability of exceedance, a column
# for each altitude: figure 7 of MIL-F-8785C, read off at these points as in the simulation JSBSim
# (FGWinds) and in NASA CR-1998-206937.
EXCEEDANCE = (2e-1, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
EXCEEDANCE_ALTITUDES_FT = (
    500,
    1750,
    3750,
    7500,
    15000,
    25000,
    35000,
    45000,
    55000,
    65000,
    75000,
    80000,
)
EXCEEDANCE_SIGMAS_FT_S = (
    (3.2, 2.2, 1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (4.2, 3.6, 3.3, 1.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (6.6, 6.9, 7.4, 6.7, 4.6, 2.7, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0),
    (8.6, 9.6, 10.6, 10.1, 8.0, 6.6, 5.0, 4.2, 2.7, 0.0, 0.0, 0.0),
    (11.8, 13.0, 16.0, 15.1, 11.6, 9.7, 8.1, 8.2, 7.9, 4.9, 3.2, 2.1),
    (15.6, 17.6, 23.0, 23.6, 22.1, 20.0, 16.0, 15.1, 12.1, 7.9, 6.2, 5.1),
    (18.7, 21.5, 28.4, 30.2, 30.7, 31.0, 25.2, 23.1, 17.5, 10.7, 8.4, 7.2),
)


class GustScales(NamedTuple):
    """Size and strength of the gusts along the three body axes.

    Args:
        lengths: length scales Lu, Lv, Lw, shape (3,) [m].
        sigmas: standard deviations of the gust velocities, shape (3,) [m/s].
    """

    lengths: Float[Array, "3"]
    sigmas: Float[Array, "3"]


class AbstractIntensity(eqx.Module):
    """A rule that gives the scales of the gusts at an altitude."""

    @abc.abstractmethod
    def scales(self, altitude: Value, length_aloft: float) -> GustScales:
        """The scales at an altitude.

        Args:
            altitude: above ground [m].
            length_aloft: length scale far from the ground; it depends on the form of the spectrum
                [m].
        """


class FixedIntensity(AbstractIntensity):
    """Scales that are the same at every altitude.

    Args:
        sigmas: standard deviations of the gusts along the body axes, shape (3,) [m/s].
        lengths: length scales Lu, Lv, Lw, shape (3,) [m].

    Raises:
        InputError: when a standard deviation is negative or a length not positive.
    """

    sigmas: Float[Array, "3"]
    lengths: Float[Array, "3"]

    def __init__(self, sigmas, lengths):
        require_value(
            sigmas, lambda s: s >= 0, "Gust intensity: a sigma is {} m/s. Give zero or more."
        )
        require_value(
            lengths,
            lambda s: s > 0,
            "Gust intensity: a length scale is {} m. Give a positive number.",
        )
        self.sigmas, self.lengths = jnp.asarray(sigmas, float), jnp.asarray(lengths, float)

    def scales(self, altitude, length_aloft):
        return GustScales(self.lengths, self.sigmas)


class MilitaryIntensity(AbstractIntensity):
    r"""Intensities and lengths by altitude h, in feet in these equations, as in the military
    specification.

    Below 1000 ft, from the wind W20 that blows 20 ft above the ground; below 10 ft as at 10 ft:

        Lw = h,    Lu = Lv = h/(0.177 + 0.000823 h)^1.2
        sigma_w = 0.1 W20,    sigma_u = sigma_v = sigma_w/(0.177 + 0.000823 h)^0.4

    Above 2000 ft all lengths are 1750 ft (Dryden) or 2500 ft (von Karman), and the three sigmas are
    the one that is exceeded with a given probability (figure 7, by straight lines between its
    points). In between, lengths and sigmas run in straight lines from their values at 1000 ft to
    those at 2000 ft.

    Near the ground the specification's u axis lies along the mean wind; here it is taken as the
    aircraft's.

    Source: MIL-F-8785C, Flying qualities of piloted airplanes, 1980, 3.7.2 and 3.7.3, figures 7,
    10, 11. The scales of MIL-HDBK-1797 (2 Lw = h and so on) enter its spectra so that these come
    out the same.

    Args:
        wind_at_20ft: W20 [m/s].
        probability: that the intensity aloft is exceeded, from 1e-6 to 0.2.

    Raises:
        InputError: when the wind is negative or the probability outside the figure.
    """

    wind_at_20ft: Float[Array, ""]
    probability: Float[Array, ""]

    def __init__(self, wind_at_20ft: Value, probability: Value):
        require_value(
            wind_at_20ft,
            lambda s: s >= 0,
            "The wind at 20 ft is {} m/s. Give zero or more, in m/s.",
        )
        require_value(
            probability,
            lambda s: (s >= EXCEEDANCE[-1]) & (s <= EXCEEDANCE[0]),
            "The probability of exceedance is {}; MIL-F-8785C has curves from 1e-6 to 0.2. Choose "
            "one in between.",
        )
        self.wind_at_20ft, self.probability = (
            jnp.asarray(wind_at_20ft, float),
            jnp.asarray(probability, float),
        )

    def scales(self, altitude, length_aloft):
        h = jnp.asarray(altitude, float) / FOOT
        share = jnp.clip((h - LOW_FT) / (HIGH_FT - LOW_FT), 0.0, 1.0)
        near = jnp.clip(h, LOWEST_FT, LOW_FT)
        shape = 0.177 + 0.000823 * near
        along = near / shape**1.2 * FOOT
        vertical = 0.1 * self.wind_at_20ft
        aloft = self.sigma_aloft(jnp.maximum(h, HIGH_FT) * FOOT)
        low_lengths = jnp.stack([along, along, near * FOOT])
        low_sigmas = vertical * jnp.stack([shape**-0.4, shape**-0.4, jnp.ones_like(shape)])
        return GustScales(
            (1.0 - share) * low_lengths + share * length_aloft,
            (1.0 - share) * low_sigmas + share * aloft,
        )

    def sigma_aloft(self, altitude: Value) -> Float[Array, ""]:
        """The standard deviation that is exceeded with this probability, by figure 7 of MIL-F-8785C
        [m/s].

        Args:
            altitude: from 500 to 80,000 ft, beyond which the value at the end holds [m].
        """
        h = jnp.asarray(altitude, float) / FOOT
        curves = jax.vmap(
            lambda curve: jnp.interp(h, jnp.asarray(EXCEEDANCE_ALTITUDES_FT, float), curve)
        )(jnp.asarray(EXCEEDANCE_SIGMAS_FT_S))
        steps = jnp.asarray(np.log10(EXCEEDANCE[::-1]))
        return FOOT * jnp.interp(jnp.log10(self.probability), steps, curves[::-1])


def as_intensity(intensity: AbstractIntensity | str) -> AbstractIntensity:
    """Return the intensity of a named severity.

    Light, moderate and severe are winds of 15, 30 and 45 kt at 20 ft near the ground, and
    probabilities of exceedance of 1e-2, 1e-3 and 1e-5 aloft.

    Args:
        intensity: the name of a severity, or an intensity, which is returned unchanged.

    Raises:
        InputError: when the name is not one of the three.
    """
    if isinstance(intensity, AbstractIntensity):
        return intensity
    require_known("gust severity", [intensity], SEVERITIES)
    return MilitaryIntensity(*SEVERITIES[intensity])
