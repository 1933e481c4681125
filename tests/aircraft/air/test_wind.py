"""Wind and discrete gusts: shear, the logarithmic profile, shape, peak and length."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft import BoundaryLayerWind, Wind, one_minus_cosine, one_minus_cosine_rise
from jaxid.models.names import parameter_names

FT = 0.3048


def test_wind_is_calm_by_default_and_linear_with_altitude():
    np.testing.assert_array_equal(Wind().velocity(jnp.array(1234.0)), [0, 0, 0])
    wind = Wind(3.0, -4.0, 0.5, north_shear=0.01, east_shear=-0.02, reference=100.0)
    np.testing.assert_allclose(wind.velocity(jnp.array(100.0)), [3.0, -4.0, 0.5], rtol=1e-15)
    np.testing.assert_allclose(wind.velocity(jnp.array(300.0)), [5.0, -8.0, 0.5], rtol=1e-15)
    np.testing.assert_allclose(
        jax.jacfwd(wind.velocity)(jnp.array(50.0)), [0.01, -0.02, 0.0], rtol=1e-15
    )
    assert parameter_names(wind) == (
        "north",
        "east",
        "down",
        "north_shear",
        "east_shear",
        "down_shear",
        "reference",
    )


def test_boundary_layer_wind_has_logarithmic_profile():
    wind = BoundaryLayerWind(6.0, 8.0, ground=50.0)
    at = lambda feet: np.asarray(wind.velocity(jnp.array(50.0 + feet * FT)))  # noqa: E731
    np.testing.assert_allclose(at(20.0), [6.0, 8.0, 0.0], rtol=1e-12)
    # ln 100 = 2 ln 10, with z0 = 2 ft
    np.testing.assert_allclose(at(200.0), 2.0 * at(20.0), rtol=1e-12)
    np.testing.assert_allclose(at(5000.0), at(1000.0), rtol=1e-14)
    np.testing.assert_allclose(at(-9.0), at(3.0), rtol=1e-14)


def test_one_minus_cosine_rises_to_peak_and_falls_to_zero():
    V, H, start = 100.0, 25.0, 1.0
    gust = lambda t: one_minus_cosine(jnp.asarray(t), start, H, V, 8.0)  # noqa: E731
    # After a quarter of its length it is half the peak at H; it ends after 2H, which is 0.5 s.
    np.testing.assert_allclose(
        gust([0.0, 1.0, 1.125, 1.25, 1.375, 1.5, 9.0]), [0, 0, 4, 8, 4, 0, 0], atol=1e-14
    )
    fine = jnp.linspace(1.0, 1.5, 10_001)
    # its mean is half its peak
    np.testing.assert_allclose(np.trapezoid(gust(fine), fine), 8.0 * H / V, rtol=1e-12)
    np.testing.assert_allclose(
        jax.grad(lambda s: one_minus_cosine(jnp.array(1.125), s, H, V, 8.0))(1.0),
        -8 / 2 * np.pi * V / H,
    )


def test_one_minus_cosine_rise_stays_at_amplitude():
    gust = one_minus_cosine_rise(
        jnp.array([[0.0, 1.0, 1.125], [1.25, 1.5, 9.0]]), 1.0, 25.0, 100.0, -8.0
    )
    np.testing.assert_allclose(gust, [[0, 0, -4], [-8, -8, -8]], atol=1e-14)


def test_invalid_gust_or_wind_raises_error():
    for gust in (one_minus_cosine, one_minus_cosine_rise):
        with pytest.raises(InputError, match=r"length is 0\.0 m.*positive"):
            gust(jnp.zeros(3), 0.0, 0.0, 100.0, 1.0)
        with pytest.raises(InputError, match=r"speed V is -1\.0 m/s.*positive"):
            gust(jnp.zeros(3), 0.0, 1.0, -1.0, 1.0)
    with pytest.raises(InputError, match=r"nan is not a finite number"):
        Wind(north=float("nan"))
    with pytest.raises(InputError, match=r"roughness length is 2\.0 m.*ROUGHNESS_OTHER"):
        BoundaryLayerWind(1.0, 0.0, roughness=2.0)
