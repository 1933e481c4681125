"""The standard atmosphere against its printed table, and the pressures of an airspeed indicator."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.aircraft.air.atmosphere import (
    HEAT_RATIO,
    SEA_LEVEL_DENSITY,
    StandardAtmosphere,
    compressibility,
    impact_pressure,
    indicated_airspeed,
    true_airspeed,
)

# Geometric altitude [m], temperature [K], pressure [Pa], density [kg/m^3], speed of sound [m/s]:
# U.S. Standard Atmosphere, 1976 (NOAA-S/T 76-1562), Table I; equal to ICAO's below 32 km, printed
# to five figures.
PRINTED = [
    (0.0, 288.150, 101325.0, 1.2250, 340.29),
    (5000.0, 255.676, 54048.0, 0.73643, 320.55),
    (10000.0, 223.252, 26500.0, 0.41351, 299.53),
    (15000.0, 216.650, 12112.0, 0.19476, 295.07),
    (20000.0, 216.650, 5529.3, 0.088910, 295.07),
]


@pytest.mark.parametrize("row", PRINTED)
def test_air_equals_printed_table(row):
    air = StandardAtmosphere().air(jnp.array(row[0]))
    # half a unit of the last printed figure
    np.testing.assert_allclose(jnp.stack(air), row[1:], rtol=3e-5)


def test_warm_day_has_lower_density_and_same_pressure():
    cold, warm = (
        StandardAtmosphere().air(jnp.array(3000.0)),
        StandardAtmosphere(warmer=20.0).air(jnp.array(3000.0)),
    )
    assert float(warm.pressure) == float(cold.pressure)
    ratio = cold.temperature / (cold.temperature + 20.0)
    np.testing.assert_allclose(warm.density / cold.density, ratio, rtol=1e-14)


def test_pressure_at_tropopause_has_no_kink():
    slope = jax.grad(lambda h: StandardAtmosphere().air(h).pressure)
    # 11 km of geopotential altitude lie between
    below, above = slope(jnp.array(11018.9)), slope(jnp.array(11019.2))
    np.testing.assert_allclose(below, above, rtol=1e-4)


def test_impact_pressure_equals_isentropic_to_sixth_power_of_mach():
    mach, air = jnp.array(0.5), StandardAtmosphere().air(jnp.array(8000.0))
    V = mach * air.sound_speed
    isentropic = air.pressure * ((1.0 + 0.5 * (HEAT_RATIO - 1.0) * mach**2) ** 3.5 - 1.0)
    # The series' next term is M^6/1600; the pressure's own constants (287.05287, 1.4) are exact
    # here.
    np.testing.assert_allclose(
        impact_pressure(air.density, V, mach), isentropic, rtol=2 * 0.5**6 / 1600.0
    )
    assert float(compressibility(jnp.array(0.0))) == 1.0


def test_indicated_airspeed_is_inverted_by_true_airspeed():
    air = StandardAtmosphere().air(jnp.array(10668.0))
    V = jnp.array(167.6)
    shown = indicated_airspeed(air.density, V, V / air.sound_speed)
    assert float(shown) < float(V) * np.sqrt(float(air.density) / SEA_LEVEL_DENSITY) * 1.05
    # eight contractions by less than M^2/4 = 0.08
    np.testing.assert_allclose(true_airspeed(shown, air), V, rtol=1e-9)
