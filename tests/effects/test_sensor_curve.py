"""Static curves of a sensor: curvature and asymmetry about a centre."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.effects import Augmented, SensorCurve, general_effects
from jaxid.models import LinearModel

DIRECT = LinearModel(
    [[0.0]], [[0.0]], [[0.0]], [[1.0]], states=("x",), inputs=("u",), outputs=("y",)
)
TIMES = jnp.arange(5.0)


def shaped(curve, measured, gain):
    """Return the curve with its shape from a measured output."""
    effect = SensorCurve("y", curve, gain=jnp.array(gain))
    return effect.initialise_shape({}, {"y": measured}, 0.1)


def read(effect, values):
    """Return the recorded output for samples of the true output."""
    y = Augmented(DIRECT, (effect,)).observe(TIMES, jnp.asarray(values)[:, None])
    return np.asarray(y[:, 0])


def test_curve_of_signal_through_zero_is_about_zero():
    values = np.array([-4.0, -1.0, 0.0, 1.0, 2.0])
    np.testing.assert_allclose(
        read(shaped("square", values, 0.1), values), values + 0.1 * values**2 / 4.0, rtol=1e-14
    )
    np.testing.assert_allclose(
        read(shaped("absolute", values, 0.1), values), values + 0.1 * np.abs(values), rtol=1e-14
    )


@pytest.mark.parametrize("curve", ["square", "absolute"])
def test_curve_of_signal_away_from_zero_is_about_its_median(curve):
    """About zero, |y| would be a scale error of a positive signal."""
    values = np.array([160.0, 164.0, 165.0, 168.0, 170.0])
    effect = shaped(curve, values, 0.2)
    assert (float(effect.centre), float(effect.range)) == (165.0, 5.0)
    added = read(effect, values) - values
    expected = np.array([5.0, 1.0, 0.0, 3.0, 5.0])
    expected = expected**2 / 5.0 if curve == "square" else expected
    np.testing.assert_allclose(added, 0.2 * expected, rtol=0, atol=1e-12)
    line = np.polynomial.Polynomial.fit(values, added, 1)(values)
    assert np.max(np.abs(added - line)) > 0.3


def test_both_curves_of_every_output_are_candidates():
    names = {effect.name for effect in general_effects(DIRECT, ()) if type(effect) is SensorCurve}
    assert names == {"curvature of y", "asymmetry of y"}
