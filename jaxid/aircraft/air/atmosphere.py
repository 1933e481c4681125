"""The air: temperature, pressure and density by altitude, and the pressures at an airspeed
indicator.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from ..._foundation.types import Array, Float

GRAVITY = 9.80665  # m/s^2, standard acceleration of free fall (CGPM 1901)

# ICAO Standard Atmosphere, Doc 7488, 3rd ed., 1993.
SEA_LEVEL_TEMPERATURE = 288.15  # K
SEA_LEVEL_PRESSURE = 101325.0  # Pa
SEA_LEVEL_DENSITY = 1.225  # kg/m^3
LAPSE_RATE = 0.0065  # K/m
TROPOPAUSE = 11000.0  # geopotential m
GAS_CONSTANT = 287.05287  # J/(kg K)
HEAT_RATIO = 1.4
EARTH_RADIUS = 6356766.0  # m, in the relation of geometric to geopotential altitude


class Air(NamedTuple):
    """The air at one place.

    Attributes:
        temperature: [K].
        pressure: static [Pa].
        density: [kg/m^3].
        sound_speed: [m/s].
    """

    temperature: Float[Array, ""]
    pressure: Float[Array, ""]
    density: Float[Array, ""]
    sound_speed: Float[Array, ""]


class AbstractAtmosphere(eqx.Module):
    """State of the air as a function of altitude."""

    @abc.abstractmethod
    def air(self, altitude: Float[Array, ""]) -> Air:
        """The air at a geometric altitude [m]."""


class StandardAtmosphere(AbstractAtmosphere):
    r"""The ICAO Standard Atmosphere up to 20 km: temperature falls linearly to 11 km and is
    constant above.

        T = T0 - L h,   p = p0 (T/T0)^(g/RL)                up to the tropopause
        T = T_s,        p = p_s exp(-g (h - h_s) / R T_s)   above
        h = R_E z / (R_E + z),    density = p / (R (T + warmer))

    Pressure is that of the standard day; a warmer day has less density at the same pressure
    altitude.

    Args:
        warmer: temperature above the standard day's [K].

    Source: ICAO Doc 7488, 1993.
    """

    warmer: Float[Array, ""]

    def __init__(self, warmer: Float[Array, ""] | float = 0.0):
        self.warmer = jnp.asarray(warmer, float)

    def air(self, altitude: Float[Array, ""]) -> Air:
        height = EARTH_RADIUS * altitude / (EARTH_RADIUS + altitude)
        below, above = jnp.minimum(height, TROPOPAUSE), jnp.maximum(height - TROPOPAUSE, 0.0)
        standard = SEA_LEVEL_TEMPERATURE - LAPSE_RATE * below
        tropospheric = (standard / SEA_LEVEL_TEMPERATURE) ** (GRAVITY / (GAS_CONSTANT * LAPSE_RATE))
        pressure = (
            SEA_LEVEL_PRESSURE
            * tropospheric
            * jnp.exp(-GRAVITY * above / (GAS_CONSTANT * standard))
        )
        temperature = standard + self.warmer
        density = pressure / (GAS_CONSTANT * temperature)
        return Air(
            temperature, pressure, density, jnp.sqrt(HEAT_RATIO * GAS_CONSTANT * temperature)
        )


def compressibility(mach: Float[Array, ""]) -> Float[Array, ""]:
    """Return the ratio of impact pressure to dynamic pressure, to the fourth power of the Mach
    number (D.2.4).

        f_c = 1 + M^2/4 + M^4/40,    impact pressure = f_c density V^2 / 2

    Args:
        mach: M, below one.
    """
    return 1.0 + mach**2 / 4.0 + mach**4 / 40.0


def impact_pressure(
    density: Float[Array, ""], V: Float[Array, ""], mach: Float[Array, ""]
) -> Float[Array, ""]:
    """Return the impact pressure of a pitot tube, total less static: `f_c(M) density V^2 / 2` [Pa]
    (D.2.4).

    Args:
        density: of the air [kg/m^3].
        V: true airspeed [m/s].
        mach: Mach number.
    """
    return 0.5 * density * V**2 * compressibility(mach)


def indicated_airspeed(
    density: Float[Array, ""], V: Float[Array, ""], mach: Float[Array, ""]
) -> Float[Array, ""]:
    """Return the reading of an ideal airspeed indicator, `V_i^2 = V^2 sigma f_c(M)` with `sigma =
    density / 1.225` [m/s] (D.2.4).

    Args:
        density: of the air [kg/m^3].
        V: true airspeed [m/s].
        mach: Mach number.
    """
    return jnp.sqrt(2.0 * impact_pressure(density, V, mach) / SEA_LEVEL_DENSITY)


def true_airspeed(indicated: Float[Array, ""], air: Air, iterations: int = 8) -> Float[Array, ""]:
    """Return the true airspeed at the reading `indicated` of an ideal indicator (Table 3.2, `V_b`)
    [m/s].

        V = V_i / sqrt(sigma f_c(V / c))

    is solved by repeated substitution; the error falls by more than a factor of M^2/4 in each step.

    Args:
        indicated: V_i [m/s].
        air: the air in which it was measured.
        iterations: number of substitutions.
    """
    still = indicated / jnp.sqrt(air.density / SEA_LEVEL_DENSITY)
    V = still
    for _ in range(iterations):
        V = still / jnp.sqrt(compressibility(V / air.sound_speed))
    return V
