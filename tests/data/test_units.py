"""Conversion of units: known factors, unchanged SI values, refused units."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import constants as si

from jaxid._foundation.checks import InputError
from jaxid.data import convert, to_si

FACTORS = {
    "deg": (si.degree, "rad"),
    "deg/s": (si.degree, "rad/s"),
    "deg/s^2": (si.degree, "rad/s^2"),
    "rpm": (2 * si.pi / 60, "rad/s"),
    "ft": (si.foot, "m"),
    "ft/s": (si.foot, "m/s"),
    "kt": (si.knot, "m/s"),
    "km/h": (si.kmh, "m/s"),
    "g0": (si.g, "m/s^2"),
    "gee": (si.g, "m/s^2"),
    "lbf": (si.lbf, "N"),
    "psf": (si.lbf / si.foot**2, "Pa"),
    "lbf/ft^2": (si.lbf / si.foot**2, "Pa"),
    "psi": (si.psi, "Pa"),
    "slug": (si.slug, "kg"),
    "slug*ft^2": (si.slug * si.foot**2, "kg*m^2"),
    "ft*lbf": (si.foot * si.lbf, "N*m"),
    "Nm": (1.0, "N*m"),
    "mV": (1e-3, "V"),
    "ms": (1e-3, "s"),
    "kHz": (1e3, "Hz"),
    "%": (1e-2, ""),
    "N/V": (1.0, "N/V"),
    "1/s": (1.0, "1/s"),
    "": (1.0, ""),
    "-": (1.0, ""),
}


@pytest.mark.parametrize("unit", FACTORS)
def test_unit_converts_by_known_factor_and_si_name(unit):
    factor, name = FACTORS[unit]
    values, symbol = to_si([1.0, -2.0], unit, "q")
    assert symbol == name
    np.testing.assert_allclose(values, [factor, -2 * factor], rtol=4e-15)


@given(st.sampled_from(sorted(FACTORS)), st.lists(st.floats(allow_nan=True, width=64), min_size=1))
def test_si_values_stay_equal_bit_for_bit(unit, values):
    name = FACTORS[unit][1]
    back, again = to_si(values, name, "q")
    assert again == name
    assert back.tobytes() == np.asarray(values).tobytes()


@given(st.sampled_from(sorted(FACTORS)), st.lists(st.floats(-1e9, 1e9), min_size=1))
def test_conversion_and_its_inverse_return_same_values(unit, values):
    there = convert(values, unit, FACTORS[unit][1])
    np.testing.assert_allclose(there, to_si(values, unit, "q")[0], rtol=1e-15)
    np.testing.assert_allclose(convert(there, FACTORS[unit][1], unit), values, rtol=1e-14)


def test_temperatures_have_offset_and_temperature_differences_have_none():
    assert to_si(15.0, "degC", "T") == (288.15, "K")
    np.testing.assert_allclose(to_si([32.0, 212.0], "degF", "T")[0], [273.15, 373.15], rtol=1e-15)
    np.testing.assert_allclose(convert(50.0, "degF", "degC"), 10.0, rtol=1e-13)
    assert to_si(3.0, "W/degC", "loss") == (3.0, "W/K")
    assert to_si(15.0, "°C", "T") == (288.15, "K")  # C alone is ambiguous
    np.testing.assert_allclose(to_si(212.0, "°F", "T")[0], 373.15, rtol=1e-15)


def test_percent_and_millibar_are_read_by_their_usual_names():
    """pint parses `pct` as pico-ton and `mb` as millibarn."""
    assert to_si(50.0, "pct", "throttle") == (0.5, "")
    assert to_si(1013.25, "mb", "p0") == (101325.0, "Pa")


def test_units_of_electricity_are_printed_as_they_are_read():
    for unit in ("coulomb", "farad"):
        assert to_si(1.0, unit, "q") == (1.0, unit)
        assert to_si(*to_si(1.0, f"milli{unit}", "q"), "q") == (0.001, unit)


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        ("knts", ["'speed'", "'knts'", "'kt'", "products as 'kg*m^2'"]),
        ("g", ["'speed'", "ambiguous", "'g0'", "'gram'"]),
        ("U/min", ["'speed'", "ambiguous", "'rpm'"]),
        ("G", ["ambiguous", "'g0'", "'gauss'"]),
        ("W/C", ["ambiguous", "'degC'", "'coulomb'"]),
        ("F", ["ambiguous", "'degF'", "'farad'"]),
        ("R", ["ambiguous", "'degR'"]),
        ("M", ["ambiguous", "Mach number"]),
        ("nm", ["ambiguous", "'nmi'", "'nanometer'"]),
        ("m/g", ["'speed'", "'g0'"]),
        ("dB", ["'speed'", "'dB'", "not linear"]),
        ("((", ["'speed'", "'(('", "Examples: deg"]),
        ("5*m", ["'speed'", "'5*m'"]),
    ],
)
def test_invalid_units_are_refused_with_reason(unit, words):
    with pytest.raises(InputError) as caught:
        to_si([1.0], unit, "speed")
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(("unit", "to"), [("rad/s", "Hz"), ("deg", ""), ("N", "m"), ("K", "deg")])
def test_conversion_between_different_kinds_is_refused(unit, to):
    with pytest.raises(InputError, match=r"Channel 'x'.*cannot be converted.*same kind"):
        convert([1.0], unit, to, "x")


def test_energy_converts_to_torque_units_of_the_same_kind():
    assert convert(2.0, "J", "N*m") == 2.0


@pytest.mark.parametrize("unit", ["Grad", "Grad/s", "mrad", "kdeg", "V/Mrad", "milliradian"])
def test_angle_with_si_prefix_is_refused(unit):
    """Pint reads `Grad`, the German word for degree, as gigaradian."""
    with pytest.raises(InputError, match=r"Channel 'alpha'.*angle with an SI prefix.*Write 'deg'"):
        to_si([1.0], unit, "alpha")


def test_angle_without_prefix_is_accepted():
    for unit, factor in {"arcsec": si.arcsec, "grade": si.pi / 200, "turn": 2 * si.pi}.items():
        np.testing.assert_allclose(to_si([1.0], unit, "alpha")[0], factor, rtol=1e-14)
