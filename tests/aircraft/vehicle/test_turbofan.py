"""The turbofan: gearing, lag and thrust against the numbers of Stevens and Lewis. Its trims are in
test_trims_f16.py.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.aircraft.airframes import f16_engine, f16_thrust
from jaxid.aircraft.vehicle.turbofan import Turbofan, commanded_power
from jaxid.models.tables import Table

POUND_FORCE = 4.4482216152605  # N, exactly
AIR = {"altitude": jnp.array(3048.0), "mach": jnp.array(0.6)}  # 10,000 ft: -170, 9839 and 18910 lbf


@pytest.fixture(scope="module")
def engine():
    return Turbofan(f16_thrust(), 0.3)


@pytest.fixture(scope="module")
def rate(engine):
    """Rate of the power at a power and a throttle, by finite numbers and by its derivative."""

    def of(power, throttle):
        return engine.rates(jnp.stack([power]), jnp.stack([throttle - engine.setting]), AIR)[0]

    return jax.jit(lambda *at: (of(*at), jnp.stack(jax.grad(of, (0, 1))(*at))))


def throttle_of(power):
    """The throttle at which this power is commanded."""
    return power / 64.94 if power < 50.0 else (power + 117.38) / 217.38


def test_commanded_power_equals_gearing_of_book():
    powers = [
        float(commanded_power(jnp.array(throttle))) for throttle in (0.0, 0.5, 0.77, 1.0, 1.2, -0.1)
    ]
    np.testing.assert_allclose(powers, [0.0, 32.47, 50.0038, 100.0, 100.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("throttle", [0.1, 0.5, 0.76, 0.8, 1.0])
def test_steady_power_equals_commanded_power(engine, throttle):
    resting = engine.trimmed(jnp.array(throttle)).resting()
    np.testing.assert_allclose(resting[0], commanded_power(jnp.array(throttle)))
    np.testing.assert_allclose(
        engine.rates(resting, jnp.array([throttle - 0.3]), AIR), 0.0, atol=1e-12
    )


@pytest.mark.parametrize(
    ("power", "commanded", "expected"),
    [
        (20.0, 40.0, 1.0 * 20.0),  # within 25 %
        (5.0, 42.5, 0.55 * 37.5),  # halfway between 25 and 50 %: 1.9 - 0.036 * 37.5
        (40.0, 5.0, 1.0 * -35.0),  # on the way down the core is always quick
        # the goal of the core is 60 % before the afterburner lights: 1.9 - 0.036 * 30
        (30.0, 90.0, 0.82 * 30.0),
        (5.0, 90.0, 0.1 * 55.0),
        (60.0, 90.0, 5.0 * 30.0),  # afterburner
        (90.0, 20.0, 5.0 * -50.0),  # to 40 % until the afterburner is out
    ],
)
def test_power_rate_equals_lag_of_book(rate, power, commanded, expected):
    value, slope = rate(jnp.array(power), jnp.array(throttle_of(commanded)))
    np.testing.assert_allclose(value, expected, rtol=1e-12)
    assert np.all(np.isfinite(slope))


@pytest.mark.parametrize(
    ("power", "pounds"),
    [(0.0, -170.0), (25.0, (9839 - 170) / 2), (50.0, 9839.0), (75.0, 14374.5), (100.0, 18910.0)],
)
def test_thrust_is_linear_between_ratings(engine, power, pounds):
    np.testing.assert_allclose(
        engine.thrust(jnp.array([power]), AIR), POUND_FORCE * pounds, rtol=1e-12
    )


def test_f16_engine_has_thrust_and_momentum():
    engine = f16_engine(0.2)
    np.testing.assert_allclose(engine.momentum, 160.0 * 1.3558179483, rtol=1e-9)  # slug ft^2/s
    np.testing.assert_allclose(engine.source.resting(), [0.2 * 64.94])
    assert (engine.source.states, engine.source.inputs, engine.source.limits) == (
        ("power",),
        ("throttle",),
        (0.0, 1.0),
    )


def test_invalid_setting_raises_error():
    with pytest.raises(InputError, match=r"throttle setting is 1\.5"):
        Turbofan(f16_thrust(), 1.5)
    with pytest.raises(InputError, match="must hold idle, mil, max"):
        Turbofan(Table([0.0, 1.0], [(0.0, 1.0)], ("mach",)))
